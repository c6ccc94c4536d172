"""Belief about the confusion matrices Theta.

In: confusion counts, of all objects together or object by object. Out: `ConfusionPosterior`, whose
`select` returns the two arrays (mean rows and their precision) that planning needs. Percepts of one
object depend on its `trait`. Modules that draw, check and save are loaded when they are used:
`draws`, `checks`, `hierarchical` (PyMC), `idata` (ArviZ).
"""

from meal_bayes.posterior.dirichlet import ConfusionPosterior

__all__ = ["ConfusionPosterior"]

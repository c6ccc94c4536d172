"""Posterior of the confusion matrices Theta.

The input is confusion counts, of all objects together or of each object. The output is a
`ConfusionPosterior`, whose method `select` returns the two arrays that planning needs: mean rows
and their precision. `trait` models that the percepts of one object are dependent. The modules that
draw from a posterior, check it or save it are imported when they are used: `draws`, `checks`,
`hierarchical` (PyMC), `idata` (ArviZ).
"""

from meal_bayes.posterior.dirichlet import ConfusionPosterior

__all__ = ["ConfusionPosterior"]

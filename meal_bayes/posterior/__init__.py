"""Belief about the confusion matrices Theta.

In: confusion counts, of all objects together or object by object. Out: `ConfusionPosterior`, whose
`select` returns the two arrays (mean rows and their precision) that planning needs. Percepts of one
object depend on its `trait`. Modules that draw, check and save are loaded when they are used:
`draws`, `checks`, `hierarchical` (PyMC), `idata` (ArviZ).
"""

from importlib import import_module
from typing import TYPE_CHECKING

from meal_bayes.posterior.dirichlet import ConfusionPosterior

if TYPE_CHECKING:
    from meal_bayes.posterior.draws import draw_grid
    from meal_bayes.posterior.hierarchical import fit_hierarchical

__all__ = ["ConfusionPosterior", "draw_grid", "fit_hierarchical"]
_LATER = {"draw_grid": "draws", "fit_hierarchical": "hierarchical"}  # in which modules


def __getattr__(name: str) -> object:
    if name in _LATER:
        return getattr(import_module(f"{__name__}.{_LATER[name]}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

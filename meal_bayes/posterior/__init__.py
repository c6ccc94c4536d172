"""Belief about the confusion matrices Theta.

In: confusion counts, of all objects together or object by object. Out: `ConfusionPosterior`, whose
`select` hands the two arrays (mean rows and their precision) of a query to the planning half.
"""

from meal_bayes.posterior.dependence import log_likelihood, misperception
from meal_bayes.posterior.dirichlet import ConfusionPosterior, row_precision
from meal_bayes.posterior.dispersion import DispersionFit, fit_dispersion

__all__ = [
    "ConfusionPosterior",
    "DispersionFit",
    "fit_dispersion",
    "log_likelihood",
    "misperception",
    "row_precision",
]

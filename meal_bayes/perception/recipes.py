"""The recipes by name; scikit-learn loads only where one of them needs it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.perception.ensemble import BehaviorFit
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacked import fit_stacked, stacked_outputs

Floats = NDArray[np.float64]
Fit = Callable[[BehaviorRecordings, PerceptionSettings], BehaviorFit]
Outputs = Callable[
    [BehaviorRecordings, NDArray[np.int64], PerceptionSettings], tuple[Floats, Floats]
]


class Recipe(NamedTuple):
    """How one behavior is fitted, and how its outputs for a percept table are made."""

    fit: Fit  # see `fit_stacked`
    outputs: Outputs  # see `stacked_outputs`


def recipe_of(settings: PerceptionSettings) -> Recipe:
    """Return the recipe that the settings name."""
    if settings.recipe == "paper":
        from meal_bayes.perception.paper import (  # noqa: PLC0415  scikit-learn takes a second
            fit_paper,
            paper_outputs,
        )

        return Recipe(fit_paper, paper_outputs)
    if settings.recipe == "classifier":
        from meal_bayes.perception.classifier import (  # noqa: PLC0415  the same
            classifier_outputs,
            fit_classifier,
        )

        return Recipe(fit_classifier, classifier_outputs)
    return Recipe(fit_stacked, stacked_outputs)

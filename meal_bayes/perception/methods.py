"""The methods by name; scikit-learn loads only where one of them needs it."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.perception.ensemble import BehaviorFit
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacked import fit_stacked, stacked_outputs

Floats = NDArray[np.float64]


class Method(NamedTuple):
    """How one behavior is fitted (see `fit_stacked`), and scored (see `stacked_outputs`)."""

    fit: Callable[[BehaviorRecordings, PerceptionSettings], BehaviorFit]
    outputs: Callable[
        [BehaviorRecordings, NDArray[np.int64], PerceptionSettings], tuple[Floats, Floats]
    ]


def method_of(settings: PerceptionSettings) -> Method:
    """Return the method that the settings name."""
    if settings.method == "paper":
        from meal_bayes.perception import paper  # noqa: PLC0415  scikit-learn takes a second

        return Method(paper.fit_paper, paper.paper_outputs)
    if settings.method == "classifier":
        from meal_bayes.perception import classifier  # noqa: PLC0415  the same

        return Method(classifier.fit_classifier, classifier.classifier_outputs)
    return Method(fit_stacked, stacked_outputs)

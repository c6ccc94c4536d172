"""What a training set holds of one behavior, brought into the kernels' spaces."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.perception.modality import FeatureSpace, fit_space


@dataclass(frozen=True, slots=True)
class BehaviorRecordings:
    """Recordings of one behavior, sorted by object."""

    objects: NDArray[np.int64]  # (n,) rising
    labels: NDArray[np.int8]  # (n,P) 1 true, 0 false, -1 unknown
    spaces: Mapping[str, FeatureSpace]  # by modality

    def __post_init__(self) -> None:
        set_frozen(
            self, objects=freeze(self.objects, np.int64), labels=freeze(self.labels, np.int8)
        )

    def grams(self) -> NDArray[np.float64]:
        """Kernels between the recordings, (M,n,n)."""
        return np.stack([space.gram() for space in self.spaces.values()])


def recordings_of(
    dataset: Dataset, training_set: TrainingSet, behavior: str, kernel: str
) -> BehaviorRecordings | None:
    """Collect a behavior's recordings; None where the training set has none."""
    rows = np.flatnonzero(training_set.behavior == dataset.domain.behavior_index(behavior))
    if not len(rows):
        return None
    rows = rows[np.argsort(training_set.object[rows], kind="stable")]
    objects, recordings = training_set.object[rows], training_set.recording[rows]
    spaces = {
        modality: fit_space(values[objects, recordings], kernel)
        for (name, modality), values in dataset.features.items()
        if name == behavior
    }
    return BehaviorRecordings(objects.astype(np.int64), training_set.labels[rows], spaces)

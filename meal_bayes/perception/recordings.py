"""What a training set holds of one behavior."""

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
    grams: NDArray[np.float64]  # (M,n,n) kernels between them, a modality each

    def __post_init__(self) -> None:
        set_frozen(
            self,
            objects=freeze(self.objects, np.int64),
            labels=freeze(self.labels, np.int8),
            grams=freeze(self.grams),
        )


def rows_of(dataset: Dataset, training_set: TrainingSet, behavior: str) -> NDArray[np.intp]:
    """Rows of a training set that hold a behavior; a training set is sorted by object."""
    return np.flatnonzero(training_set.behavior == dataset.domain.behavior_index(behavior))


def recordings_of(
    dataset: Dataset, training_set: TrainingSet, behavior: str, kernel: str
) -> tuple[BehaviorRecordings, dict[str, FeatureSpace]] | None:
    """Collect a behavior's recordings and their spaces; None where the training set has none."""
    rows = rows_of(dataset, training_set, behavior)
    if not len(rows):
        return None
    objects, recordings = training_set.object[rows], training_set.recording[rows]
    spaces = {
        modality: fit_space(values[objects, recordings], kernel)
        for (name, modality), values in dataset.features.items()
        if name == behavior
    }
    grams = np.stack([space.gram() for space in spaces.values()])
    return BehaviorRecordings(objects.astype(np.int64), training_set.labels[rows], grams), spaces

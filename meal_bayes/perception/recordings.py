"""What a training set holds of one behavior."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.display import short_repr
from meal_bayes.perception.modality import FeatureSpace, fit_space, widened


@dataclass(frozen=True, slots=True)
class BehaviorRecordings:
    """Recordings of one behavior, sorted by object and recording.

    Attributes
    ----------
    objects : (n,) rising.
    labels : (n,P) 1 true, 0 false, -1 unknown.
    grams : (M,n,n) kernels between them, a modality each.
    rows : (n,d) features of all modalities side by side, standardized; none for what works on the
        kernels alone.
    """

    objects: NDArray[np.int64]
    labels: NDArray[np.int8]
    grams: NDArray[np.float64]
    rows: NDArray[np.float64] | None = None

    __repr__ = short_repr

    def __post_init__(self) -> None:
        set_frozen(
            self,
            objects=freeze(self.objects, np.int64),
            labels=freeze(self.labels, np.int8),
            grams=freeze(self.grams),
        )

    def of(self, attributes: NDArray[np.integer]) -> "BehaviorRecordings":
        """Keep the labels of some attributes."""
        return replace(self, labels=self.labels[:, attributes])

    def widened(self, factor: float) -> "BehaviorRecordings":
        """Compare the same recordings by wider kernels."""
        return replace(self, grams=widened(self.grams, factor))


def number_in_object(objects: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of each row (n,) within its object, from 0; objects rise.

    >>> number_in_object(np.array([3, 3, 5, 8, 8])).tolist()
    [0, 1, 0, 0, 1]
    """
    return np.arange(len(objects)) - np.searchsorted(objects, objects)


def rows_of(dataset: Dataset, training_set: TrainingSet, behavior: str) -> NDArray[np.intp]:
    """Rows of a training set that hold a behavior; a training set is sorted by object."""
    return np.flatnonzero(training_set.behavior == dataset.domain.behavior_index(behavior))


def all_recordings_of(
    dataset: Dataset, training_set: TrainingSet, kernel: str
) -> dict[str, tuple[BehaviorRecordings, dict[str, FeatureSpace]]]:
    """Collect each sensing behavior's recordings and their spaces; no entry where there is none."""
    found = {}
    for behavior in dataset.domain.behaviors:
        rows = rows_of(dataset, training_set, behavior.name)
        if not len(rows) or not behavior.modalities:
            continue
        objects, recordings = training_set.object[rows], training_set.recording[rows]
        spaces = {
            modality: fit_space(values[objects, recordings], kernel)
            for (name, modality), values in dataset.features.items()
            if name == behavior.name
        }
        grams = np.stack([space.gram() for space in spaces.values()])
        labels = training_set.labels[rows]
        beside = np.hstack([space.rows for space in spaces.values()])
        own = BehaviorRecordings(objects.astype(np.int64), labels, grams, beside)
        found[behavior.name] = own, spaces
    return found

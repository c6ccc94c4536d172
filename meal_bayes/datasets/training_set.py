"""The paper's D: which recordings the robot has, and the labels that people gave them."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import ByValue, freeze, label_values, set_frozen, whole_array
from meal_bayes.datasets.dataset import Dataset, check_positions
from meal_bayes.errors import DataError
from meal_bayes.look import short_repr


@dataclass(frozen=True, slots=True)
class TrainingSet(ByValue):
    """The paper's D: the recordings that the robot has, and the labels that people gave them.

    They are sorted by (object, behavior, recording).

    Attributes
    ----------
    object, behavior, recording : NDArray[np.int32]
        (n,) int32, positions from 0.
    labels : NDArray[np.int8]
        (n,P) int8, 1 true, 0 false, -1 not labeled.

    Raises
    ------
    DataError
        Lengths that do not agree, labels other than 1, 0 and -1, or two rows of one instance.
    """

    object: NDArray[np.int32]
    behavior: NDArray[np.int32]
    recording: NDArray[np.int32]
    labels: NDArray[np.int8]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        names = ("object", "behavior", "recording")
        columns = [whole_array(name, getattr(self, name), len(self.object)) for name in names]
        keys = np.array(columns, dtype=np.int32).reshape(3, -1).T  # (n,3)
        labels = label_values(self.labels)
        if labels.ndim != 2 or len(labels) != len(keys):  # (n,P)
            raise DataError(
                f"Labels have shape {labels.shape}; expected ({len(keys)}, attributes), "
                "a row for each instance."
            )
        unique, rows = np.unique(keys, axis=0, return_index=True)
        if (unique < 0).any():
            raise DataError("Objects, behaviors and recordings are places, counted from 0.")
        if len(unique) < len(keys):
            raise DataError("A recording has two rows of labels; give each one.")
        for name, column in zip(names, unique.T, strict=True):
            set_frozen(self, **{name: freeze(column, np.int32)})
        set_frozen(self, labels=freeze(labels[rows], np.int8))

    @classmethod
    def everything(cls, dataset: Dataset, objects: Iterable[int] | None = None) -> "TrainingSet":
        """Return all recordings of some objects (of all by default), with all known labels."""
        chosen = range(len(dataset.objects)) if objects is None else [*objects]
        check_positions(chosen, len(dataset.objects), "objects")
        sensing = dataset.domain.recorded
        axes = np.meshgrid(sorted({*chosen}), sensing, np.arange(dataset.recordings), indexing="ij")
        keys = np.stack(axes).reshape(3, -1).astype(np.int32)
        keys = keys[:, keys[2] < dataset.recording_counts[keys[0], keys[1]]]
        return cls(keys[0], keys[1], keys[2], dataset.labels[keys[0]])

    def __len__(self) -> int:
        """Return the number of instances, n."""
        return len(self.object)

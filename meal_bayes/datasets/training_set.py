"""The paper's D: the recordings that the robot has, and the labels that people gave them.

Splits say which objects teach and which are asked about: always whole objects, never samples.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, label_values, set_frozen
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.display import short_repr
from meal_bayes.errors import DataError, SettingsError

PARTS = 3  # pre, train, test


@dataclass(frozen=True, slots=True)
class TrainingSet:
    """A set of labeled instances, sorted by (object, behavior, recording).

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
        columns = [self.object, self.behavior, self.recording]
        keys = np.array(columns, dtype=np.int32).reshape(3, -1).T  # (n,3)
        labels = label_values(self.labels)
        if labels.ndim != 2 or len(labels) != len(keys):  # (n,P)
            raise DataError(
                f"Labels have shape {labels.shape}; expected ({len(keys)}, attributes), "
                "a row for each instance."
            )
        unique, rows = np.unique(keys, axis=0, return_index=True)
        if len(unique) < len(keys):
            raise DataError("A recording has two rows of labels; give each one.")
        for name, column in zip(("object", "behavior", "recording"), unique.T, strict=True):
            set_frozen(self, **{name: freeze(column, np.int32)})
        set_frozen(self, labels=freeze(labels[rows], np.int8))

    @classmethod
    def everything(cls, dataset: Dataset, objects: Iterable[int] | None = None) -> "TrainingSet":
        """Return all recordings of some objects (of all by default), with all known labels."""
        chosen = range(len(dataset.objects)) if objects is None else sorted(set(objects))
        sensing = dataset.domain.recorded
        axes = np.meshgrid(list(chosen), sensing, np.arange(dataset.recordings), indexing="ij")
        keys = np.stack(axes).reshape(3, -1).astype(np.int32)
        keys = keys[:, keys[2] < dataset.recording_counts[keys[0], keys[1]]]
        return cls(keys[0], keys[1], keys[2], dataset.labels[keys[0]])

    def __len__(self) -> int:
        """Return the number of instances, n."""
        return len(self.object)


@dataclass(frozen=True, slots=True)
class ObjectSplit:
    """Obj^pre, Obj^train and Obj^test: three disjoint sets of object indices, sorted."""

    pre: NDArray[np.intp]
    train: NDArray[np.intp]
    test: NDArray[np.intp]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        parts = [freeze(np.sort(part), np.intp) for part in (self.pre, self.train, self.test)]
        joined = np.concatenate(parts)
        if len(np.unique(joined)) != len(joined):
            raise SettingsError("An object is in two parts of the split; expected disjoint parts.")
        set_frozen(self, pre=parts[0], train=parts[1], test=parts[2])

    @classmethod
    def random(
        cls,
        dataset: Dataset,
        rng: np.random.Generator,
        *,
        sizes: Sequence[int] | None = None,
        minimum: int = 0,
        attributes: Sequence[str] | None = None,
        tries: int = 10_000,
    ) -> "ObjectSplit":
        """Draw a split, anew until each part has `minimum` positives of each attribute.

        Sizes are those of pre, train, test, by default three parts as equal as can be; attributes
        those that must have positives, by default all. A `SettingsError` where sizes do not fit, or
        no draw met the minimum.
        """
        count = len(dataset.objects)
        if sizes is None:
            sizes = [len(part) for part in np.array_split(np.arange(count), PARTS)]
        if len(sizes) != PARTS or min(sizes) < 1 or sum(sizes) > count:
            raise SettingsError(
                f"Split sizes {list(sizes)} do not fit {count} objects; "
                "expected three numbers, each at least 1, that add to no more."
            )
        names = dataset.domain.attributes if attributes is None else tuple(attributes)
        columns = dataset.domain.columns(names)
        positive = (dataset.labels[:, columns] == 1).astype(np.intp)  # (O,P)
        for name, total in zip(names, positive.sum(axis=0), strict=True):
            if total < PARTS * minimum:
                raise SettingsError(
                    f"Only {total} objects are {name!r}; {minimum} in each of three parts need "
                    f"{PARTS * minimum}; lower the minimum, or leave the attribute out."
                )
        ends = np.cumsum(sizes)
        fewest, worst = -1, ""
        for _ in range(tries):
            order = rng.permutation(count)
            counts = np.add.reduceat(positive[order[: ends[-1]]], [0, *ends[:-1]])  # (3,P)
            least = int(counts.min(initial=minimum))
            if least >= minimum:
                return cls(*np.split(order, ends)[:PARTS])
            if least > fewest:
                fewest, worst = least, names[int(counts.min(axis=0).argmin())]
        raise SettingsError(
            f"No split of {tries} has {minimum} objects of every attribute in each part; the best "
            f"has {fewest} of {worst!r}; lower the minimum, or leave the attribute out."
        )

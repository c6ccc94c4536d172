"""The recordings of one behavior in a training set."""

from collections.abc import Hashable, Mapping
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.display import short_repr
from meal_bayes.perception.modality import FeatureSpace, fit_space, widened, with_joint
from meal_bayes.perception.settings import PerceptionSettings

Name = TypeVar("Name", bound=Hashable)

_SEED = 0  # of the order in which neighbors are dealt to folds


@dataclass(frozen=True, slots=True)
class BehaviorRecordings:
    """Recordings of one behavior, sorted by object and recording.

    Attributes
    ----------
    objects : (n,) rising.
    labels : (n,P) 1 true, 0 false, -1 unknown.
    spaces : (M,) of the modalities, each with rows (n,d).
    landmarks : (m,) rows that all others are compared with; None where there are few recordings,
        which are all compared with each other.
    width : factor by which their kernels are wider.
    """

    objects: NDArray[np.int64]
    labels: NDArray[np.int8]
    spaces: tuple[FeatureSpace, ...]
    landmarks: NDArray[np.int64] | None = None
    width: float = 1.0

    __repr__ = short_repr

    def __post_init__(self) -> None:
        set_frozen(
            self,
            objects=freeze(self.objects, np.int64),
            labels=freeze(self.labels, np.int8),
        )

    @property
    def large(self) -> bool:
        """Whether folds of objects are left out rather than single ones."""
        return self.landmarks is not None

    @property
    def features(self) -> NDArray[np.float64]:
        """Standardized features of all modalities side by side, (n,d)."""
        return np.hstack([space.rows for space in self.spaces])

    @property
    def compared(self) -> tuple[FeatureSpace, ...]:
        """Spaces that hold the rows which recordings are compared with."""
        if self.landmarks is None:
            return self.spaces
        return tuple(space.at(self.landmarks) for space in self.spaces)

    def kernels(self, *, joint: bool = False) -> NDArray[np.float64]:
        """Compute the kernels (M,n,m) with what recordings are compared with.

        With `joint`, the kernel of all modalities at once is one more.
        """
        if self.landmarks is None:
            kernels = np.stack([space.gram() for space in self.spaces])
        else:
            pairs = zip(self.compared, self.spaces, strict=True)
            kernels = np.stack([near.similarity(space.rows) for near, space in pairs])
        kernels = widened(kernels, self.width)
        return with_joint(kernels) if joint else kernels

    def of(self, attributes: NDArray[np.integer]) -> "BehaviorRecordings":
        """Keep the labels of some attributes."""
        return replace(self, labels=self.labels[:, attributes])

    def widened(self, factor: float) -> "BehaviorRecordings":
        """Compare the same recordings by wider kernels."""
        return replace(self, width=factor * self.width)


def number_in_object(objects: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the number of each row (n,) within its object, from 0; objects rise.

    >>> number_in_object(np.array([3, 3, 5, 8, 8])).tolist()
    [0, 1, 0, 0, 1]
    """
    return np.arange(len(objects)) - np.searchsorted(objects, objects)


def dealt(names: NDArray[np.integer], folds: int) -> NDArray[np.int64]:
    """Return the fold of each name (n,), a number from 0.

    As neighbors are alike, `folds` of them in a row are in as many folds; in which order is drawn,
    as a data set may repeat itself every so many objects.

    >>> sorted(dealt(np.arange(20, 24), 4).tolist())
    [0, 1, 2, 3]
    """
    top = int(names.max(initial=0)) // folds + 1
    rng = np.random.default_rng(_SEED)
    order = np.concatenate([rng.permutation(folds) for _ in range(top)])
    return np.asarray(order[names])


def rows_of(dataset: Dataset, training_set: TrainingSet, behavior: str) -> NDArray[np.intp]:
    """Return the rows of a training set that hold a behavior; they are sorted by object."""
    return np.flatnonzero(training_set.behavior == dataset.domain.behavior_index(behavior))


def with_landmarks(
    behaviors: Mapping[Name, BehaviorRecordings], settings: PerceptionSettings
) -> dict[Name, BehaviorRecordings]:
    """Choose landmarks for all behaviors if one of them is above the settings' exact sizes.

    They are spaced evenly over the recordings. Other methods than "stacked" compare all recordings
    with each other at any size.
    """
    sizes = [(len(np.unique(one.objects)), len(one.objects)) for one in behaviors.values()]
    if all(o <= settings.exact_objects and n <= settings.exact_recordings for o, n in sizes):
        return dict(behaviors)
    found = {}
    for name, recordings in behaviors.items():
        n = len(recordings.objects)
        number = min(settings.landmarks, n) if settings.method == "stacked" else n
        landmarks = np.linspace(0, n - 1, number).round().astype(np.int64)
        found[name] = replace(recordings, landmarks=landmarks)
    return found


def groups_of(
    behaviors: Mapping[Name, BehaviorRecordings], objects: int, settings: PerceptionSettings
) -> NDArray[np.int64]:
    """Return what each object (O,) is left out with: itself, or a fold where there are many."""
    names = np.arange(objects)
    many = any(recordings.large for recordings in behaviors.values())
    return dealt(names, settings.folds) if many else names


def all_recordings_of(
    dataset: Dataset, training_set: TrainingSet, settings: PerceptionSettings
) -> dict[str, BehaviorRecordings]:
    """Collect each sensing behavior's recordings; no entry where there is none."""
    found = {}
    for behavior in dataset.domain.behaviors:
        rows = rows_of(dataset, training_set, behavior.name)
        if not len(rows) or not behavior.modalities:
            continue
        objects = training_set.object[rows].astype(np.int64)
        recordings = training_set.recording[rows]
        spaces = tuple(
            fit_space(
                dataset.features[behavior.name, modality][objects, recordings], settings.kernel
            )
            for modality in behavior.modalities
        )
        found[behavior.name] = BehaviorRecordings(objects, training_set.labels[rows], spaces)
    return with_landmarks(found, settings)

"""The recordings of each behavior in a training set, and their feature spaces."""

import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.display import short_repr
from meal_bayes.perception.modality import FeatureSpace, fit_space, widened, with_joint
from meal_bayes.perception.settings import PerceptionSettings

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


def groups_of(
    behaviors: Iterable[BehaviorRecordings], objects: int, settings: PerceptionSettings
) -> NDArray[np.int64]:
    """Return what each object is left out with: itself, or a fold where there are many.

    Returns
    -------
    NDArray[np.int64]
        (O,).
    """
    names = np.arange(objects)
    many = any(recordings.large for recordings in behaviors)
    return dealt(names, settings.folds) if many else names


@dataclass(frozen=True, slots=True)
class Kernels:
    """All n = O R recordings of a data set in feature spaces that many refits share.

    A robot refits its classifiers after every batch. Its feature spaces (means, standard
    deviations, kernel widths, whitening) need no labels: they are fitted once, or again as
    recordings come in.

    Attributes
    ----------
    dataset : Dataset
        Of the recordings.
    spaces : Mapping[tuple[str, str], FeatureSpace]
        (behavior, modality) -> space with rows (n,d).
    """

    dataset: Dataset
    spaces: Mapping[tuple[str, str], FeatureSpace]

    __repr__ = short_repr

    @classmethod
    def of(
        cls, dataset: Dataset, gathered: TrainingSet, *, kernel: str = "rbf", whiten: bool = False
    ) -> "Kernels":
        """Fit the spaces to the recordings that a robot has, without labels.

        A behavior without recordings has no kernels: percepts of it are at even odds.

        Parameters
        ----------
        dataset : Dataset
            All recordings.
        gathered : TrainingSet
            Those that the robot has.
        kernel : str
            "rbf" or "polynomial".
        whiten : bool
            Shrink directions in which repeats of one object differ.

        Returns
        -------
        Kernels
            With all recordings of the data set.
        """
        spaces = {}
        n = len(dataset.objects) * dataset.recordings
        for behavior, modality in dataset.features:
            rows = gathered.behavior == dataset.domain.behavior_index(behavior)
            if rows.any():
                values, objects = dataset.features[behavior, modality], gathered.object[rows]
                known = values[objects, gathered.recording[rows]]
                space = _space((behavior, modality), known, kernel, objects if whiten else None)
                spaces[behavior, modality] = space.over(values.reshape(n, -1))
        return cls(dataset, spaces)

    def spaces_of(self, behavior: str, rows: NDArray[np.int64]) -> tuple[FeatureSpace, ...]:
        """Return the spaces of a behavior's modalities with some recordings (r,)."""
        return tuple(space.at(rows) for (name, _), space in self.spaces.items() if name == behavior)


def gather(
    dataset: Dataset,
    training_set: TrainingSet,
    settings: PerceptionSettings,
    kernels: Kernels | None = None,
) -> dict[int, BehaviorRecordings]:
    """Collect the recordings of each sensing behavior, by its index; no entry where there is none.

    If one behavior is above the settings' exact sizes, all have landmarks, spaced evenly over the
    recordings. Other methods than "stacked" compare all recordings with each other at any size.

    Parameters
    ----------
    dataset : Dataset
        Features of the recordings.
    training_set : TrainingSet
        Which recordings, and their labels.
    settings : PerceptionSettings
        Kernel and sizes.
    kernels : Kernels, optional
        Spaces that were fitted before; by default they are fitted to these recordings.

    Returns
    -------
    dict[int, BehaviorRecordings]
        In the order of the domain's behaviors.
    """
    gathered = {}
    for e, behavior in enumerate(dataset.domain.behaviors):
        rows = np.flatnonzero(training_set.behavior == e)  # they are sorted by object
        if not len(rows) or not behavior.modalities:
            continue
        objects = training_set.object[rows].astype(np.int64)
        numbers = training_set.recording[rows]
        if kernels is not None:
            spaces = kernels.spaces_of(behavior.name, objects * dataset.recordings + numbers)
        else:
            contexts = [(behavior.name, modality) for modality in behavior.modalities]
            spaces = tuple(
                _space(context, dataset.features[context][objects, numbers], settings.kernel)
                for context in contexts
            )
        if spaces:
            gathered[e] = BehaviorRecordings(objects, training_set.labels[rows], spaces)
    if any(
        len(np.unique(recordings.objects)) > settings.exact_objects
        or len(recordings.objects) > settings.exact_recordings
        for recordings in gathered.values()
    ):
        for e, recordings in gathered.items():
            n = len(recordings.objects)
            number = min(settings.landmarks, n) if settings.method == "stacked" else n
            landmarks = np.linspace(0, n - 1, number).round().astype(np.int64)
            gathered[e] = replace(recordings, landmarks=landmarks)
    return gathered


def _space(
    context: tuple[str, str],
    features: NDArray[np.floating],
    kernel: str,
    objects: NDArray[np.integer] | None = None,
) -> FeatureSpace:
    """Fit the space of a (behavior, modality); warn where no feature varies."""
    space = fit_space(features, kernel, objects)
    if len(features) > 1 and not len(space.kept):
        warnings.warn(
            f"None of the {features.shape[1]} features of {context} varies over "
            f"{len(features)} recordings: the modality says nothing. Check its sensor.",
            stacklevel=2,
        )
    return space

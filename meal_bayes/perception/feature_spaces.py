"""The recordings of each behavior in a training set, and the kernels between them.

A `FeatureSpace` standardizes the features of a modality; `joint_kernel` combines the kernels of
modalities.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, FrozenArrays, Ints, tiny_is_zero
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.look import short_repr, warn_user
from meal_bayes.perception.settings import PerceptionSettings

_FAR = 5.0  # standard deviations at which features are clipped
_WITHIN = 0.3  # e of the whitening, in units of a feature's variance; .03 to .3 are as good
_CONSTANT = 1e-9  # largest standard deviation of a dropped feature, relative to its largest value
_FEWEST_STEPS = 4  # smallest standard deviation, in steps of single precision
_ENOUGH = 8  # recordings; with fewer, even a binary sensor may have shown only one value
_COMPARED = 2048  # largest number of recordings whose distances determine a median
_SEED = 0  # seed of the assignment of neighbors to folds


@dataclass(frozen=True, slots=True)
class Whitening(FrozenArrays):
    """The linear map I + basis' gain basis, which scales r directions by 1 + gain.

    The map is applied by its factors, because r is often much smaller than d: products with d x d
    matrices would take a quarter of an online run on ISPY32.
    """

    basis: Floats  # (r,d), orthonormal
    gain: Floats  # (r,)

    def of(self, rows: Floats) -> Floats:
        """Whiten rows (B,d)."""
        return np.asarray(rows + ((rows @ self.basis.T) * self.gain) @ self.basis)


@dataclass(frozen=True, slots=True)
class FeatureSpace(FrozenArrays):
    """Standardized recordings and the kernel between them, without labels.

    Features are transformed by sign(x) log(1 + |x|), because audio and haptic features span several
    orders of magnitude, then standardized and clipped at 5 standard deviations. Constant features
    are dropped. With within-object whitening, directions in which repeated recordings of an object
    differ are scaled down.

    Attributes
    ----------
    varying : Ints
        (d,) positions of the features that vary, among D.
    center, scale : Floats
        (d,) means and standard deviations of these features.
    rows : Floats
        (n,d) recordings, standardized and whitened.
    kernel : str
        "rbf" or "polynomial".
    width : float
        Width of the RBF kernel: the median distance between two recordings times a learned factor.
    whitening : Whitening | None
        The map of within-object whitening; None without whitening.
    """

    varying: Ints
    center: Floats
    scale: Floats
    rows: Floats
    kernel: str
    width: float
    whitening: Whitening | None = None

    def standardize(self, features: NDArray[np.floating]) -> Floats:
        """Transform raw features (B,D) to this space, (B,d)."""
        rows = _standard(_squash(features)[:, self.varying], self.center, self.scale)
        return np.asarray(rows if self.whitening is None else self.whitening.of(rows))

    def similarity(self, rows: Floats) -> Floats:
        """Compute the kernel of standardized rows (B,d) with this space's recordings, (B,n)."""
        product = rows @ self.rows.T
        if self.kernel == "polynomial":  # (1 + x.y / d)^2, the paper's
            return (1.0 + product / max(len(self.varying), 1)) ** 2
        # exp(-|x - y|^2 / width^2)
        return np.exp(-_squared_distance(rows, self.rows) / self.width**2)

    def at(self, rows: NDArray[np.integer]) -> "FeatureSpace":
        """Return the space with some of its recordings (r,)."""
        return replace(self, rows=self.rows[rows])


def fit_space(
    features: NDArray[np.floating], kernel: str, objects: NDArray[np.integer] | None = None
) -> FeatureSpace:
    """Fit the space of raw recordings (n,D); with whitening if their objects (n,) are given."""
    squashed = _squash(features)
    sd = squashed.std(axis=0)
    varying = np.flatnonzero(sd > _CONSTANT * np.abs(squashed).max(axis=0, initial=0.0))
    center = squashed[:, varying].mean(axis=0)
    scale = sd[varying]
    rows = _standard(squashed[:, varying], center, scale)
    whitening = None if objects is None else _whitening(rows, objects)
    rows = rows if whitening is None else whitening.of(rows)
    width = _median_distance(rows)
    return FeatureSpace(
        varying, center, scale, rows, kernel=kernel, width=width, whitening=whitening
    )


def joint_kernel(kernels: Floats) -> Floats:
    """Compute the kernel of all modalities together, (M,r,c) -> (r,c).

    It is the RBF kernel of their features side by side, with the mean of the squared distances,
    each in units of the modality's width. With this kernel, attributes with a weak signal in every
    modality can be learned from fewer objects than with a stacker alone [Gonen2011].
    """
    return np.asarray(np.prod(kernels, axis=0) ** (1.0 / len(kernels)))


def _whitening(rows: Floats, objects: NDArray[np.integer]) -> Whitening | None:
    """Return the map that scales directions with within-object variance v by sqrt(e / (v + e)).

    The result is None if no object has repeated recordings. With few repeats, most directions do
    not change.
    """
    _, index, count = np.unique(objects, return_inverse=True, return_counts=True)
    mean = np.zeros((len(count), rows.shape[1]))
    np.add.at(mean, index, rows)
    mean /= count[:, None]
    repeated = count[index] > 1
    if not repeated.any():
        return None
    # Deviations from the mean of the object; the mean of each object uses one degree of freedom.
    freedom = repeated.sum() - (count > 1).sum()
    _, values, basis = np.linalg.svd((rows - mean[index])[repeated], full_matrices=False)
    gain = np.sqrt(_WITHIN / (values**2 / freedom + _WITHIN)) - 1.0
    return Whitening(basis, gain)


def _squash(features: NDArray[np.floating]) -> Floats:
    values = np.asarray(features, dtype=np.float64)
    return np.asarray(np.sign(values) * np.log1p(np.abs(values)))


def _standard(squashed: Floats, center: Floats, scale: Floats) -> Floats:
    return np.asarray(np.clip((squashed - center) / scale, -_FAR, _FAR))


def _squared_distance(a: Floats, b: Floats) -> Floats:
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None, :]
    return np.asarray(np.maximum(squares - 2.0 * a @ b.T, 0.0))


def _median_distance(rows: Floats) -> float:
    """Return the median distance between recordings.

    If the median is 0, the mean is returned instead, and 1 if all recordings are equal. From many
    recordings, an evenly spaced selection is used.
    """
    rows = rows[:: -(-len(rows) // _COMPARED) or 1]
    # Each pair once, no recording with itself.
    upper = np.triu_indices(len(rows), 1)
    distance = np.sqrt(_squared_distance(rows, rows)[upper])
    for width in (np.median(distance), np.mean(distance)) if len(distance) else ():
        if width > _CONSTANT:
            return float(width)
    return 1.0


Spaces = Mapping[tuple[str, str], FeatureSpace]  # (behavior, modality) -> rows (O*R,d)
Rows = Sequence[Floats | None]  # each modality's standardized rows (B,d); None: it is missing


@dataclass(frozen=True, slots=True)
class BehaviorRecordings(FrozenArrays):
    """Recordings of one behavior, sorted by object and recording.

    Attributes
    ----------
    objects : Ints
        (n,) objects in increasing order.
    labels : NDArray[np.int8]
        (n,P) 1 true, 0 false, -1 unknown.
    spaces : tuple[FeatureSpace, ...]
        (M,) spaces of the modalities, each with rows (n,d).
    questions : tuple[str, ...]
        (P,) names of attribute and behavior for error messages.
    landmarks : Ints | None
        (m,) rows with which all others are compared; None if all recordings are compared with each
        other.
    width : float
        Factor by which the widths of the kernels are multiplied.
    """

    objects: Ints
    labels: NDArray[np.int8]
    spaces: tuple[FeatureSpace, ...]
    questions: tuple[str, ...]
    landmarks: Ints | None = None
    width: float = 1.0

    __repr__ = short_repr

    @property
    def large(self) -> bool:
        """Whether folds of objects are left out instead of single objects."""
        return self.landmarks is not None

    @property
    def compared(self) -> tuple[FeatureSpace, ...]:
        """Spaces with the rows with which recordings are compared."""
        if self.landmarks is None:
            return self.spaces
        return tuple(space.at(self.landmarks) for space in self.spaces)

    def kernels(self, *, joint: bool = False) -> Floats:
        """Compute the kernels (M,n,m) between recordings and those they are compared with.

        If `joint`, the kernel of all modalities together is added, unless there is only one.
        """
        pairs = zip(self.compared, self.spaces, strict=True)
        kernels = np.stack([near.similarity(space.rows) for near, space in pairs])
        if self.width != 1.0:  # an RBF wider by f: exp(-d^2 / (f w)^2) = k^(1 / f^2)
            kernels **= self.width**-2.0
        if not joint or len(kernels) == 1:
            return kernels
        return np.concatenate([kernels, joint_kernel(kernels)[None]])

    def by_known_labels(self) -> Iterator[tuple[Ints, "BehaviorRecordings"]]:
        """Yield attributes (a,) whose labels are known for the same recordings, with their labels.

        These attributes share the inverse of the kernel. If all labels are known, all attributes
        are in one set.
        """
        patterns, pattern = np.unique(self.labels >= 0, axis=1, return_inverse=True)
        for index in np.flatnonzero(patterns.any(axis=0)):
            attributes = np.flatnonzero(pattern.ravel() == index)
            questions = tuple(self.questions[p] for p in attributes)
            yield attributes, replace(self, labels=self.labels[:, attributes], questions=questions)

    def widened(self, factor: float) -> "BehaviorRecordings":
        """Return the same recordings with kernels that are wider by a factor."""
        return replace(self, width=factor * self.width)


def number_in_object(objects: Ints) -> Ints:
    """Return the number of each row (n,) within its object, from 0; objects are in order."""
    return np.arange(len(objects)) - np.searchsorted(objects, objects)


def assign_folds(names: NDArray[np.integer], folds: int) -> Ints:
    """Assign a fold to each name (n,), a number from 0.

    Neighboring objects may be similar, so each run of `folds` consecutive objects is spread over
    all folds. The order within a run is random, because a data set may have a periodic order.

    >>> sorted(assign_folds(np.arange(20, 24), 4).tolist())
    [0, 1, 2, 3]
    """
    top = int(names.max(initial=0)) // folds + 1
    rng = np.random.default_rng(_SEED)
    order = np.concatenate([rng.permutation(folds) for _ in range(top)])
    return np.asarray(order[names])


def groups_of(
    behaviors: Iterable[BehaviorRecordings], objects: int, settings: PerceptionSettings
) -> Ints:
    """Return the group in which each object (O,) is left out: itself, or a fold of objects."""
    names = np.arange(objects)
    large = any(recordings.large for recordings in behaviors)
    return assign_folds(names, settings.folds) if large else names


def _coarse(features: Floats) -> bool:
    """Return whether a feature (n,D) varies by only a few steps of its floating-point precision."""
    spread = features.std(axis=0, dtype=np.float64)
    step = np.spacing(np.abs(features).max(axis=0, initial=0.0))
    return bool(((spread > 0) & (spread < _FEWEST_STEPS * step)).any())


@tiny_is_zero
def fit_spaces(
    dataset: Dataset, gathered: TrainingSet, *, kernel: str = "rbf", whiten: bool = False
) -> Spaces:
    """Fit feature spaces without labels; a behavior without recordings gets no space.

    When new labels arrive, a robot fits its classifiers again but keeps the spaces. The spaces are
    fitted to the recordings `gathered` by the robot, and contain all n = O R recordings of the data
    set. With `whiten`, directions in which repeated recordings of an object differ are scaled down.
    """
    spaces = {}
    for context, values in dataset.features.items():
        rows = gathered.behavior == dataset.domain.behavior_index(context[0])
        if not rows.any():
            continue
        objects = gathered.object[rows]
        raw = values[objects, gathered.recording[rows]]
        space = fit_space(raw, kernel, objects if whiten else None)
        if len(raw) >= _ENOUGH and not len(space.varying):
            warn_user(  # without a number, so that refits do not repeat it
                f"None of the features of {context} varies (in single precision): the modality "
                "contains no information. Check its sensor, or subtract a large offset.",
            )
        elif _coarse(raw):
            warn_user(
                f"Features of {context} vary only by a few steps of single precision, so most of "
                "their information is lost. Subtract their offset first.",
            )
        standardized = space.standardize(values.reshape(-1, values.shape[2]))
        spaces[context] = replace(space, rows=standardized)
    return spaces


@tiny_is_zero
def gather(
    dataset: Dataset,
    training_set: TrainingSet,
    settings: PerceptionSettings,
    spaces: Spaces | None = None,
    *,
    pairs: bool = False,
) -> dict[int, BehaviorRecordings]:
    """Collect the recordings of each behavior that senses, by the index of the behavior.

    Behaviors without recordings have no entry. If one behavior exceeds the settings' exact sizes,
    all behaviors have landmarks, which are spaced evenly over the recordings. The number of objects
    matters only if `pairs` of them will be left out. Methods other than "stacked" always compare
    all recordings with each other. By default, `spaces` are fitted to the training set.
    """
    if spaces is None:
        kernel = "polynomial" if settings.method == "paper" else "rbf"
        spaces = fit_spaces(dataset, training_set, kernel=kernel)
    gathered = {}
    for e, behavior in enumerate(dataset.domain.behaviors):
        rows = np.flatnonzero(training_set.behavior == e)  # they are sorted by object
        objects = training_set.object[rows].astype(np.int64)
        rows_in_space = objects * dataset.recordings + training_set.recording[rows]
        modalities = tuple(
            space.at(rows_in_space) for (name, _), space in spaces.items() if name == behavior.name
        )
        if len(rows) and modalities:
            labels = training_set.labels[rows]
            questions = tuple(
                f"{name!r} by {behavior.name!r}" for name in dataset.domain.attributes
            )
            gathered[e] = BehaviorRecordings(objects, labels, modalities, questions)
    if any(
        len(recordings.objects) > settings.exact_recordings
        or (pairs and len(np.unique(recordings.objects)) > settings.exact_objects)
        for recordings in gathered.values()
    ):
        for e, recordings in gathered.items():
            n = len(recordings.objects)
            number = min(settings.landmarks, n) if settings.method == "stacked" else n
            landmarks = np.linspace(0, n - 1, number).round().astype(np.int64)
            gathered[e] = replace(recordings, landmarks=landmarks)
    return gathered

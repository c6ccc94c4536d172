"""The recordings of each behavior in a training set, and the kernels that compare them.

The features of a modality are made comparable in a `FeatureSpace`; kernels of modalities are joined
by `joint_kernel`.
"""

import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, FrozenArrays, Ints, tiny_is_zero
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.look import short_repr
from meal_bayes.perception.settings import PerceptionSettings

_FAR = 5.0  # standard deviations at which features are clipped
_WITHIN = 0.3  # e of the whitening, in units of a feature's variance; .03 to .3 do as well
_CONSTANT = 1e-9  # standard deviation, relative to the largest value, of a feature that is dropped
_FEWEST_STEPS = 4  # of single precision, that a standard deviation has at least
_ENOUGH = 8  # recordings, of fewer a sensor of 0 and 1 may well have shown one of them alone
_COMPARED = 2048  # recordings whose distances are compared for a median
_SEED = 0  # of the order in which neighbors go to folds


@dataclass(frozen=True, slots=True)
class Whitening(FrozenArrays):
    """The map I + basis' gain basis of rows, which stretches r directions by 1 + gain.

    Applied by its factors, as r is often far below d: products of d x d would take a quarter of an
    online run on ISPY32.
    """

    basis: Floats  # (r,d), orthonormal
    gain: Floats  # (r,)

    def of(self, rows: Floats) -> Floats:
        """Whiten rows (B,d)."""
        return np.asarray(rows + ((rows @ self.basis.T) * self.gain) @ self.basis)


@dataclass(frozen=True, slots=True)
class FeatureSpace(FrozenArrays):
    """Standardized recordings and the kernel between them, without labels.

    Features are squashed by sign(x) log(1 + |x|), as audio and haptics span decades, then
    standardized and clipped at 5 standard deviations; constant ones are dropped. Where repeats of
    objects are known, directions in which they differ are shrunk (within-object whitening).

    Of D features those at `varying` (d,) vary; `rows` (n,d) are the recordings, standardized and
    whitened. The width of an RBF is the median distance between two recordings times a learned
    factor.
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
    """Fit the space of raw recordings (n,D); whitened where their objects (n,) are given."""
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
    """Compute the kernel of all modalities at once, (M,r,c) -> (r,c).

    It is the RBF kernel of their features side by side: distances in units of each one's width,
    squared and averaged. Attributes with a weak signal in every modality are learned by it from
    fewer objects than a stacker needs [Gonen2011].
    """
    return np.asarray(np.prod(kernels, axis=0) ** (1.0 / len(kernels)))


def _whitening(rows: Floats, objects: NDArray[np.integer]) -> Whitening | None:
    """Return what scales directions of within-object variance v by sqrt(e / (v + e)).

    None where no object is repeated. With few repeats most directions stay as they are.
    """
    _, index, count = np.unique(objects, return_inverse=True, return_counts=True)
    mean = np.zeros((len(count), rows.shape[1]))
    np.add.at(mean, index, rows)
    mean /= count[:, None]
    repeated = count[index] > 1
    if not repeated.any():
        return None
    # Deviations of repeats from their object's mean; each object takes one degree of freedom.
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
    """Return the median distance of two recordings; their mean where it is 0; 1 where all coincide.

    Many recordings are thinned out evenly.
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

    Objects (n,) rise; labels (n,P) are 1 true, 0 false, -1 unknown; spaces (M,) are those of the
    modalities, each with rows (n,d). Questions (P,) name attribute and behavior. Landmarks (m,) are
    rows that all others are compared with; None where there are few recordings, which are all
    compared with each other. Kernels are wider by the factor `width`.
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
        """Whether folds of objects are left out rather than single ones."""
        return self.landmarks is not None

    @property
    def compared(self) -> tuple[FeatureSpace, ...]:
        """Spaces that hold the rows which recordings are compared with."""
        if self.landmarks is None:
            return self.spaces
        return tuple(space.at(self.landmarks) for space in self.spaces)

    def kernels(self, *, joint: bool = False) -> Floats:
        """Compute the kernels (M,n,m) with what recordings are compared with.

        With `joint`, the kernel of all modalities at once is one more; a single one is its own.
        """
        pairs = zip(self.compared, self.spaces, strict=True)
        kernels = np.stack([near.similarity(space.rows) for near, space in pairs])
        if self.width != 1.0:  # an RBF wider by f: exp(-d^2 / (f w)^2) = k^(1 / f^2)
            kernels **= self.width**-2.0
        if not joint or len(kernels) == 1:
            return kernels
        return np.concatenate([kernels, joint_kernel(kernels)[None]])

    def by_known_labels(self) -> Iterator[tuple[Ints, "BehaviorRecordings"]]:
        """Yield attributes (a,) whose labels are known together, with their labels.

        They share their classifiers; where all labels are known these are all attributes.
        """
        patterns, pattern = np.unique(self.labels >= 0, axis=1, return_inverse=True)
        for index in np.flatnonzero(patterns.any(axis=0)):
            attributes = np.flatnonzero(pattern.ravel() == index)
            questions = tuple(self.questions[p] for p in attributes)
            yield attributes, replace(self, labels=self.labels[:, attributes], questions=questions)

    def widened(self, factor: float) -> "BehaviorRecordings":
        """Compare the same recordings by wider kernels."""
        return replace(self, width=factor * self.width)


def number_in_object(objects: Ints) -> Ints:
    """Return the number of each row (n,) within its object, from 0; objects rise."""
    return np.arange(len(objects)) - np.searchsorted(objects, objects)


def assign_folds(names: NDArray[np.integer], folds: int) -> Ints:
    """Assign a fold to each name (n,), a number from 0.

    As neighbors are alike, `folds` of them in a row are in as many folds; in which order is drawn,
    as a data set may repeat itself every so many objects.

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
    """Return what each object (O,) is left out with: itself, or a fold where there are many."""
    names = np.arange(objects)
    large = any(recordings.large for recordings in behaviors)
    return assign_folds(names, settings.folds) if large else names


def _coarse(features: Floats) -> bool:
    """Return whether a feature (n,D) varies, but by less than its last bits can tell apart."""
    spread = features.std(axis=0, dtype=np.float64)
    step = np.spacing(np.abs(features).max(axis=0, initial=0.0))
    return bool(((spread > 0) & (spread < _FEWEST_STEPS * step)).any())


@tiny_is_zero
def fit_spaces(
    dataset: Dataset, gathered: TrainingSet, *, kernel: str = "rbf", whiten: bool = False
) -> Spaces:
    """Fit feature spaces, which need no labels; a behavior without recordings has none.

    A robot refits its classifiers as labels come in, and keeps the spaces. They hold all n = O R
    recordings of the data set, and are fitted to those that the robot has gathered. Whitening
    shrinks directions in which repeats of one object differ.
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
            warnings.warn(
                f"None of the features of {context} varies (in single precision): the modality "
                "contains no information. Check its sensor, or subtract a large offset.",
                stacklevel=2,  # no number in it, so that refits do not repeat it
            )
        elif _coarse(raw):
            warnings.warn(
                f"Features of {context} vary only by a few steps of single precision, so most of "
                "their information is lost. Subtract their offset first.",
                stacklevel=2,
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
    """Collect the recordings of each sensing behavior, by its index; no entry where there is none.

    If one behavior is above the settings' exact sizes, all have landmarks, spaced evenly over the
    recordings. The number of objects counts only where `pairs` of them will be left out. Other
    methods than "stacked" compare all recordings with each other at any size. Without `spaces` they
    are fitted to the training set.
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

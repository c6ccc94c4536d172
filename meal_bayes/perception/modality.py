"""Kernels of recordings: the features of a modality made comparable, and modalities joined."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen

_FAR = 5.0  # standard deviations at which features are clipped
_WITHIN = 0.3  # e of the whitening, in units of a feature's variance; .03 to .3 do as well
_CONSTANT = 1e-9  # standard deviation, relative to the largest value, of a feature that is dropped
_COMPARED = 2048  # recordings whose distances are compared for a median

Floats = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class FeatureSpace:
    """Standardized recordings and the kernel between them, without labels.

    Features are squashed by sign(x) log(1 + |x|), as audio and haptics span decades, then
    standardized and clipped at 5 standard deviations; constant ones are dropped. Where repeats of
    objects are known, directions in which they differ are shrunk (within-object whitening).

    Of D features those at `varying` (d,) vary; `rows` (n,d) are the recordings, standardized, after
    `mix` (d,d), the whitening. The width of an RBF is the median distance between two recordings
    times a learned factor.
    """

    varying: NDArray[np.int64]
    center: Floats
    scale: Floats
    rows: Floats
    kernel: str
    width: float
    mix: Floats | None = None

    def __post_init__(self) -> None:
        set_frozen(self, varying=freeze(self.varying, np.int64))
        for name in ("center", "scale", "rows", "mix"):
            if getattr(self, name) is not None:
                set_frozen(self, **{name: freeze(getattr(self, name))})

    def standardize(self, features: NDArray[np.floating]) -> Floats:
        """Transform raw features (B,D) to this space, (B,d)."""
        squashed = _squash(features)[:, self.varying]
        rows = np.clip((squashed - self.center) / self.scale, -_FAR, _FAR)
        return np.asarray(rows if self.mix is None else rows @ self.mix)

    def widened(self, factor: float) -> "FeatureSpace":
        """Return the space with a wider kernel."""
        return replace(self, width=factor * self.width)

    def similarity(self, rows: Floats) -> Floats:
        """Compute the kernel of standardized rows (B,d) with this space's recordings, (B,n)."""
        product = rows @ self.rows.T
        if self.kernel == "polynomial":
            return (1.0 + product / max(len(self.varying), 1)) ** 2
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
    center, scale = squashed[:, varying].mean(axis=0), sd[varying]
    rows = np.clip((squashed[:, varying] - center) / scale, -_FAR, _FAR)
    mix = None if objects is None else _whitening(rows, objects)
    rows = rows if mix is None else rows @ mix
    return FeatureSpace(varying, center, scale, rows, kernel, _median_distance(rows), mix)


def joint_kernel(kernels: Floats) -> Floats:
    """Compute the kernel of all modalities at once, (M,r,c) -> (r,c).

    It is the RBF kernel of their features side by side: distances in units of each one's width,
    squared and averaged. Attributes with a weak signal in every modality are learned by it from
    fewer objects than a stacker needs [Gonen2011].
    """
    return np.asarray(np.prod(kernels, axis=0) ** (1.0 / len(kernels)))


def _whitening(rows: Floats, objects: NDArray[np.integer]) -> Floats | None:
    """Return (d,d), which scales directions of within-object variance v by sqrt(e / (v + e)).

    None where no object is repeated. With few repeats most directions stay as they are.
    """
    _, index, count = np.unique(objects, return_inverse=True, return_counts=True)
    mean = np.zeros((len(count), rows.shape[1]))
    np.add.at(mean, index, rows)
    mean /= count[:, None]
    repeated = count[index] > 1
    if not repeated.any():
        return None
    freedom = repeated.sum() - (count > 1).sum()
    _, values, basis = np.linalg.svd((rows - mean[index])[repeated], full_matrices=False)
    gain = np.sqrt(_WITHIN / (values**2 / freedom + _WITHIN)) - 1.0
    mix: Floats = basis.T @ (gain[:, None] * basis)
    mix[np.diag_indices_from(mix)] += 1.0
    mix.setflags(write=False)  # so that no space copies what may have millions of entries
    return mix


def _squash(features: NDArray[np.floating]) -> Floats:
    values = np.asarray(features, dtype=np.float64)
    return np.asarray(np.sign(values) * np.log1p(np.abs(values)))


def _squared_distance(a: Floats, b: Floats) -> Floats:
    squares = (a**2).sum(axis=1)[:, None] + (b**2).sum(axis=1)[None, :]
    return np.asarray(np.maximum(squares - 2.0 * a @ b.T, 0.0))


def _median_distance(rows: Floats) -> float:
    """Return the median distance of two recordings; their mean where it is 0; 1 where all coincide.

    Many recordings are thinned out evenly.
    """
    rows = rows[:: -(-len(rows) // _COMPARED) or 1]
    upper = np.triu_indices(len(rows), 1)
    distance = np.sqrt(_squared_distance(rows, rows)[upper])
    for width in (np.median(distance), np.mean(distance)) if len(distance) else ():
        if width > _CONSTANT:
            return float(width)
    return 1.0

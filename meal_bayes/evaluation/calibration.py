"""Whether beliefs mean what they say: likelihood, Brier score, expected calibration error."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.errors import SettingsError

Array = NDArray[np.float64]

CLIP = 1e-6  # of beliefs, in the logarithm


def negative_log_likelihood(positive: ArrayLike, truth: ArrayLike) -> Array:
    """Give -ln of the belief in the truth, nats, of each case; no belief counts as surer than 1e-6.

    >>> negative_log_likelihood([0.75, 0.5], [True, False]).round(3).tolist()
    [0.288, 0.693]
    """
    b, v = _cases(positive, truth)
    return np.asarray(-np.log(np.clip(np.where(v, b, 1 - b), CLIP, 1 - CLIP)))


def brier(positive: ArrayLike, truth: ArrayLike) -> Array:
    """Give (b - v)^2 of each case.

    >>> brier([0.75, 0.5], [True, False]).tolist()
    [0.0625, 0.25]
    """
    b, v = _cases(positive, truth)
    return np.asarray((b - v) ** 2)


def calibration_error(positive: ArrayLike, truth: ArrayLike, *, bins: int = 10) -> float:
    """Give the ECE: |mean belief - share true| of equal bins of the belief, weighted by their size.

    >>> calibration_error([0.9, 0.9, 0.1, 0.1], [True, True, False, True])
    0.25
    """
    b, v = _cases(positive, truth)
    return float(np.abs(np.bincount(_bin(b, bins), b - v)).sum() / len(b))


def expected_calibration_error(
    positive: ArrayLike, rng: np.random.Generator, *, bins: int = 10, draws: int = 200
) -> float:
    """Give the mean ECE that a calibrated belief of these values would show, by simulation.

    The ECE is never 0 with few cases: only what exceeds this figure is miscalibration.
    """
    b = np.asarray(positive, float)
    member = np.eye(bins)[_bin(b, bins)]  # (n,bins)
    gaps = [(b - (rng.random(len(b)) < b)) @ member for _ in range(draws)]
    return float(np.abs(gaps).sum(axis=1).mean() / len(b))


def _bin(b: Array, bins: int) -> NDArray[np.intp]:
    return np.minimum((b * bins).astype(np.intp), bins - 1)


def _cases(positive: ArrayLike, truth: ArrayLike) -> tuple[Array, NDArray[np.bool_]]:
    b, v = np.asarray(positive, float), np.asarray(truth, bool)
    if b.shape != v.shape or b.ndim != 1 or not len(b):
        raise SettingsError(f"{b.shape} beliefs and {v.shape} truths; give one truth for each.")
    return b, v

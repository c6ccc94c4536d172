"""Scores of beliefs: likelihood, Brier score, expected calibration error (ECE)."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import Floats, check_amount, real_array, real_vector
from meal_bayes.errors import SettingsError
from meal_bayes.seeds import stream

BINS = 10  # equal ones, of beliefs
_ROUNDING = 1e-9  # of a sum of probabilities
CLIP = 1e-6  # of beliefs, in the logarithm


def negative_log_likelihood(positive: ArrayLike, truth: ArrayLike) -> Floats:
    """Compute -ln Pr(truth) of each case, (n,), nats; beliefs are clipped to [1e-6, 1 - 1e-6].

    >>> negative_log_likelihood([0.75, 0.5], [True, False]).round(3).tolist()
    [0.288, 0.693]
    """
    b, v = checked_cases(positive, truth)
    return np.asarray(-np.log(np.clip(np.where(v, b, 1 - b), CLIP, 1 - CLIP)))


def brier(positive: ArrayLike, truth: ArrayLike) -> Floats:
    """Compute the squared error of the belief in each case, (n,).

    >>> brier([0.75, 0.5], [True, False]).tolist()
    [0.0625, 0.25]
    """
    b, v = checked_cases(positive, truth)
    return np.asarray((b - v) ** 2)


def calibration_error(positive: ArrayLike, truth: ArrayLike) -> float:
    """Compute the ECE: mean |mean belief - fraction true| over ten bins, weighted by their size.

    >>> calibration_error([0.9, 0.9, 0.1, 0.1], [True, True, False, True])
    0.25
    """
    b, v = checked_cases(positive, truth)
    _check_beliefs(b)
    # Of a bin of n_k cases, n_k |mean belief - fraction true| is |sum of (belief - truth)|.
    return float(np.abs(np.bincount(bins_of(b), b - v)).sum() / len(b))


def expected_calibration_error(
    positive: ArrayLike, rng: np.random.Generator, *, draws: int = 200
) -> float:
    """Estimate by simulation the mean ECE that these beliefs would have if they were calibrated.

    With few cases, this mean is above 0; only a larger ECE indicates miscalibration.

    Parameters
    ----------
    positive : ArrayLike
        (n,) beliefs, Pr(true).
    rng : np.random.Generator
        Random generator that draws the truths.
    draws : int
        Number of simulations.
    """
    b = real_vector("positive", positive)
    _check_beliefs(b)
    check_amount("draws", draws)
    member = np.eye(BINS)[bins_of(b)]  # (n,bins)
    gaps = [(b - (rng.random(len(b)) < b)) @ member for _ in range(draws)]
    return float(np.abs(gaps).sum(axis=1).mean() / len(b))


def calibrated_error(positive: ArrayLike, seed: int = 0) -> float:
    """Return the ECE that calibrated beliefs of these values (n,) would show, in all tables."""
    return expected_calibration_error(positive, stream(seed, "calibrated belief"))


def _check_beliefs(b: Floats) -> None:
    """Refuse what cannot be put into bins."""
    if not len(b) or not ((b >= -_ROUNDING) & (b <= 1 + _ROUNDING)).all():
        raise SettingsError(f"positive is {b!r:.60}; give at least one probability, from 0 to 1.")


def bins_of(b: Floats) -> NDArray[np.intp]:
    """Return the bin of each belief (n,): the columns of `plots.reliability_diagram`, too."""
    return np.minimum((b * BINS).astype(np.intp), BINS - 1)


def checked_cases(positive: ArrayLike, truth: ArrayLike) -> tuple[Floats, NDArray[np.bool_]]:
    """Convert beliefs and truths to arrays, (n,) each, and check their shapes."""
    b = real_array("positive", positive)
    v = real_array("truth", truth) != 0
    if b.shape != v.shape or b.ndim != 1 or not len(b):
        raise SettingsError(f"{b.shape} beliefs and {v.shape} truths; give one truth for each.")
    return b, v

"""Errors and intervals of clustered values: trials of one object are not independent."""

import dataclasses
import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from meal_bayes.errors import SettingsError

Array = NDArray[np.float64]


class Interval(NamedTuple):
    """An estimate with its standard error and interval; NaN where the data do not determine it."""

    estimate: float
    se: float
    low: float
    high: float


def plain(values: Mapping[str, Any]) -> dict[str, Any]:
    """Convert named values for JSON: None for what is NaN or infinite.

    >>> plain({"agent": "morc", "se": float("nan")})
    {'agent': 'morc', 'se': None}
    """
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


class Measures:
    """Base of rows of measures, which are dataclasses."""

    __slots__ = ()

    def as_dict(self) -> dict[str, str | int | float | None]:
        """Return the measures by name, for JSON: None for NaN."""
        return plain(dataclasses.asdict(self))  # type: ignore[call-overload]


def clustered_se(values: ArrayLike, clusters: ArrayLike) -> float:
    """Compute the standard error of the mean over clusters; NaN for a single one.

    With every value its own cluster it is the usual one.

    >>> round(clustered_se([1, 0, 1, 1], [0, 1, 2, 3]), 3)
    0.25
    """
    x, index = _clusters(values, clusters)
    sums = np.bincount(index, x - x.mean())
    if len(sums) < 2:
        return float("nan")
    return float(np.sqrt(len(sums) / (len(sums) - 1) * (sums**2).sum()) / len(x))


def paired_difference(
    first: ArrayLike, second: ArrayLike, clusters: ArrayLike, *, mass: float = 0.95
) -> Interval:
    """Estimate the mean of first - second over pairs, with Student's interval over clusters."""
    difference = np.asarray(first, float) - np.asarray(second, float)
    mean, se = float(difference.mean()), clustered_se(difference, clusters)
    reach = se * stdtrit(max(len(np.unique(clusters)) - 1, 1), 0.5 + mass / 2)
    return Interval(mean, se, mean - float(reach), mean + float(reach))


def bootstrap_interval(
    values: ArrayLike,
    clusters: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: Callable[[Array], float] = np.mean,
    draws: int = 2000,
    mass: float = 0.95,
) -> Interval:
    """Compute the percentile interval of a statistic of (n, ...) values, drawing clusters again."""
    x = np.asarray(values, float)
    _, index = np.unique(np.asarray(clusters), return_inverse=True)
    if len(index) != len(x) or len(x) == 0:
        raise SettingsError(f"{len(x)} values and {len(index)} cluster names; give one for each.")
    members = [np.flatnonzero(index == c) for c in range(index.max() + 1)]
    drawn = np.empty(draws)
    for i in range(draws):
        picked = rng.integers(len(members), size=len(members))
        drawn[i] = statistic(x[np.concatenate([members[c] for c in picked])])
    low, high = np.quantile(drawn, [0.5 - mass / 2, 0.5 + mass / 2])
    return Interval(float(statistic(x)), float(drawn.std(ddof=1)), float(low), float(high))


def wilson_interval(hits: int, n: int, *, mass: float = 0.95) -> Interval:
    """Compute Wilson's interval of a fraction of independent cases.

    >>> [round(v, 3) for v in wilson_interval(0, 10)[2:]]
    [0.0, 0.278]
    """
    from scipy.stats import binomtest  # noqa: PLC0415  takes a third of a second

    if not 0 <= hits <= n or n == 0:
        raise SettingsError(f"{hits} hits of {n}; expected 0 <= hits <= n and n > 0.")
    low, high = binomtest(hits, n).proportion_ci(mass, method="wilson")
    fraction = hits / n
    return Interval(fraction, math.sqrt(fraction * (1 - fraction) / n), float(low), float(high))


def _clusters(values: ArrayLike, clusters: ArrayLike) -> tuple[Array, NDArray[np.intp]]:
    x = np.asarray(values, float)
    _, index = np.unique(np.asarray(clusters), return_inverse=True)
    if x.shape != index.shape or x.ndim != 1 or len(x) == 0:
        raise SettingsError(
            f"{x.shape} values and {index.shape} cluster names; give one name for each value."
        )
    return x, index

"""Errors and intervals of clustered values: trials of one object are not independent."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from meal_bayes.arrays import Floats, real_vector
from meal_bayes.errors import SettingsError
from meal_bayes.look import AMOUNT, json_value

MASS = 0.95  # of intervals, on all pages
MASS_TEXT = f"{100 * MASS:g} %"
LOW_QUANTILE = (1 - MASS) / 2
HIGH_QUANTILE = (1 + MASS) / 2
ROUNDING = 1e-9  # of a fraction, s; what is smaller is 0


class Interval(NamedTuple):
    """An estimate with its standard error and interval; NaN if the data do not determine them."""

    estimate: float
    se: float
    low: float
    high: float

    def text(self, form: str = AMOUNT, *, signed: bool = False) -> str:
        """Return the estimate and its interval, such as "0.912 [0.880, 0.940]".

        >>> Interval(-11.2, 5.0, -21.0, -1.4).text(signed=True)
        '-11.2 [-21.0, -1.4]'
        """
        form = f"+{form}" if signed else form
        ends = "" if math.isnan(self.low) else f" [{self.low:{form}}, {self.high:{form}}]"
        return f"{self.estimate:{form}}{ends}"

    def __neg__(self) -> "Interval":
        """Return the interval of the opposite difference, second - first."""
        return Interval(-self.estimate, self.se, -self.high, -self.low)


class Measures:
    """Base of rows of measures, which are dataclasses."""

    __slots__ = ()

    def as_dict(self) -> dict[str, Any]:
        """Return the measures by name, for JSON: None for NaN."""
        facts: dict[str, Any] = json_value(dataclasses.asdict(self))  # type: ignore[call-overload]
        return facts


@dataclasses.dataclass(frozen=True, slots=True)
class Estimate:
    """An estimate, from which intervals at any level can be computed.

    Attributes
    ----------
    estimate : float
        The estimated value.
    se : float
        Standard error of the estimate; NaN if the data do not determine it.
    clusters : int
        Number of independent clusters of trials, such as objects or splits.
    fixed : float
        Part of the variance that further clusters do not reduce.
    fraction : bool
        Whether the estimate is a probability. The interval is then Wilson's, with the number of
        independent cases that would have the same standard error. If all values are equal, this
        number is replaced by the number of clusters.
    sides : tuple[Estimate, Estimate] | None
        Estimates of gains and of losses, for a difference of fractions. The interval combines their
        intervals [Zou2008], so it has a width above 0 even if there are no gains and losses.
    cluster : str
        Kind of the clusters, in the plural: "objects", "splits" or "trials".
    method : str
        Description of the method of the interval.
    """

    estimate: float
    se: float
    clusters: int
    fixed: float = 0.0
    fraction: bool = False
    cluster: str = "objects"
    method: str = "Student's t over clusters"
    sides: "tuple[Estimate, Estimate] | None" = None

    def interval(self, mass: float = MASS) -> Interval:
        """Return the two-sided interval that contains the given probability mass."""
        if self.sides is not None:
            gain, loss = (side.interval(mass) for side in self.sides)
            # Var(gain - loss) = se_g^2 + se_l^2 - 2 rho se_g se_l, solved for the correlation; they
            # count as independent where one side has no error.
            both = gain.se * loss.se
            rho = (gain.se**2 + loss.se**2 - self.se**2) / (2 * both) if both > 0 else 0.0
            down = _joined(gain.estimate - gain.low, loss.high - loss.estimate, rho)
            up = _joined(gain.high - gain.estimate, loss.estimate - loss.low, rho)
            return Interval(self.estimate, self.se, self.estimate - down, self.estimate + up)
        t = float(stdtrit(max(self.clusters - 1, 1), 0.5 + mass / 2))
        if not self.fraction:
            half = self.se * t
            return Interval(self.estimate, self.se, self.estimate - half, self.estimate + half)
        # Wilson: the p' with |p - p'| <= t sqrt(p' (1 - p') / n), a quadratic in p'.
        p = self.estimate
        n = self.cases
        middle = p + t * t / (2 * n)
        width = t * math.sqrt(p * (1 - p) / n + t * t / (4 * n * n))
        ends = np.clip(np.array([middle - width, middle + width]) / (1 + t * t / n), 0.0, 1.0)
        return Interval(p, self.se, *ends.tolist())

    @property
    def cases(self) -> float:
        """Number of independent cases with which a fraction would have the same standard error."""
        p = self.estimate
        if self.se > ROUNDING and 0 < p < 1:
            return p * (1 - p) / self.se**2
        return max(self.clusters, 1.0)


def _joined(gain: float, loss: float, rho: float) -> float:
    """Return the half width of a difference, of those of its sides and their correlation.

    By [Zou2008] it is sqrt(g^2 + l^2 - 2 rho g l), as for standard errors.
    """
    return math.sqrt(max(gain * gain + loss * loss - 2 * rho * (gain * loss), 0.0))


def clustered(values: ArrayLike, clusters: ArrayLike, *, fraction: bool = False) -> Estimate:
    """Estimate the mean of values in independent clusters, such as objects.

    The standard error is NaN for a single cluster. If every value is a cluster of its own, it is
    the usual standard error of a mean.

    Parameters
    ----------
    values : ArrayLike
        (n,) values, one for each trial.
    clusters : ArrayLike
        (n,) name of each value's cluster, such as the name of an object.
    fraction : bool
        Whether the mean is a probability; its interval then stays in [0, 1].

    Raises
    ------
    SettingsError
        There are no values, or the numbers of values and of names differ.

    Examples
    --------
    >>> round(clustered([1, 0, 1, 1], [0, 1, 2, 3]).se, 3)
    0.25
    """
    x = real_vector("values", values)
    index = _numbered(clusters)
    if len(x) != len(index) or len(x) == 0:
        raise SettingsError(f"{len(x)} values and {len(index)} cluster names; give one for each.")
    # The cluster-robust (sandwich) variance: n / (n - 1) times the sum over clusters of squared
    # sums of deviations, over the number of values squared.
    sums = np.bincount(index, x - x.mean())
    n = len(sums)
    se = math.sqrt(n / (n - 1) * (sums**2).sum()) / len(x) if n > 1 else math.nan
    method = "Wilson's on clusters" if fraction else "Student's t over clusters"
    return Estimate(float(x.mean()), se, n, fraction=fraction, method=method)


def _numbered(clusters: ArrayLike) -> NDArray[np.intp]:
    """Return the number (n,) of each cluster, by its name; refuse what are no names."""
    try:
        names = np.asarray(clusters)
        index = np.unique(names, return_inverse=True)[1]
    except (TypeError, ValueError):  # names of several kinds, lists of unequal lengths
        names = np.empty(())
    if names.ndim != 1:
        raise SettingsError(f"clusters is {clusters!r:.60}; give a list of names of one kind.")
    return index


def running_means(values: ArrayLike, clusters: ArrayLike) -> tuple[Floats, Floats]:
    """Return the mean of the first 1, 2, ... values, and its standard error, (n,) each.

    The errors are those of `clustered`; NaN while there is one cluster.

    >>> means, errors = running_means([1, 0, 1, 1], [0, 1, 2, 3])
    >>> means.tolist()[-1], errors.round(3).tolist()[-1]
    (0.75, 0.25)
    """
    x = real_vector("values", values)
    index = _numbered(clusters)
    means = np.empty(len(x))
    errors = np.full(len(x), np.nan)
    size = np.zeros(len(x))  # n_c, values of each cluster so far
    total = np.zeros(len(x))  # S_c, their sum
    # With the mean m, sum_c (S_c - m n_c)^2 = sum S_c^2 - 2 m sum S_c n_c + m^2 sum n_c^2.
    squares = 0.0
    products = 0.0
    sizes = 0.0
    whole = 0.0  # sum of the values
    n = 0  # clusters so far
    for i, (value, c) in enumerate(zip(x.tolist(), index.tolist(), strict=True)):
        squares += (total[c] + value) ** 2 - total[c] ** 2
        products += (total[c] + value) * (size[c] + 1) - total[c] * size[c]
        sizes += 2 * size[c] + 1
        n += size[c] == 0
        size[c] += 1
        total[c] += value
        whole += value
        m = whole / (i + 1)
        means[i] = m
        if n > 1:
            deviations = max(squares - 2 * m * products + m * m * sizes, 0.0)
            errors[i] = math.sqrt(n / (n - 1) * deviations) / (i + 1)
    return means, errors


def paired_fractions(values: ArrayLike, estimate: Callable[[Floats], Estimate]) -> Estimate:
    """Estimate a difference of fractions from paired values in [-1, 1], by gains and losses.

    `estimate` is a function that estimates a mean, such as `clustered` or `resampled`.

    >>> nobody = paired_fractions([0, 0, 0, 0], lambda x: clustered(x, [0, 0, 1, 1])).interval(0.5)
    >>> round(nobody.low, 2), round(nobody.high, 2)
    (-0.33, 0.33)
    """
    x = real_vector("values", values)
    gains, losses = (
        dataclasses.replace(estimate(np.maximum(side, 0)), fraction=True) for side in (x, -x)
    )
    effect = estimate(x)
    method = f"{effect.method}; Wilson's of gains and of losses"
    return dataclasses.replace(effect, sides=(gains, losses), method=method)


def resampled(values: ArrayLike, ratio: float) -> Estimate:
    """Estimate a mean over splits of the same objects, with the corrected resampled variance.

    Splits share objects, so the usual standard error of a mean is too small. The mean of J splits
    has the variance (1/J + ratio) s^2 [Nadeau2003], where s^2 is the variance of the values and
    `ratio` is the number of test objects divided by that of training objects. More splits reduce
    only the first term. The correction is needed if differences are caused by the training objects,
    and is conservative if each split draws new data (`benchmarks/compare.py`).

    >>> resampled([0.0, 2.0], 0.5).se
    1.4142135623730951
    """
    x = real_vector("values", values)
    if not ratio >= 0:
        raise SettingsError(f"ratio is {ratio!r:.60}; give a number, 0 or more.")
    if len(x) == 0:
        return Estimate(math.nan, math.nan, 0, cluster="splits", method="corrected resampled t")
    variance = float(x.var(ddof=1)) if len(x) > 1 else math.nan
    # (1/J + ratio) s^2; of these ratio s^2 stays, however many splits there are.
    return Estimate(
        float(x.mean()),
        math.sqrt(variance * (1 / len(x) + ratio)),
        len(x),
        fixed=variance * ratio,
        cluster="splits",
        method="corrected resampled t",
    )


def spent(look: int) -> float:
    """Return the level of a look at growing data: looks 1, 2, ... spend 1/2, 1/4, ... of it.

    However many follow, together they decide falsely in 1 - `MASS` of all cases at most.
    """
    return (1 - MASS) * 0.5**look


def wilson_interval(hits: int, n: int) -> Interval:
    """Compute Wilson's interval (`MASS`) of a fraction of independent cases."""
    from scipy.stats import binomtest  # noqa: PLC0415  takes a third of a second

    low, high = binomtest(hits, n).proportion_ci(MASS, method="wilson")
    fraction = hits / n
    return Interval(fraction, math.sqrt(fraction * (1 - fraction) / n), float(low), float(high))

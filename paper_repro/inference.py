"""Intervals turned into levels: of one effect, of a family, of means whose tasks differ."""

import dataclasses
import math
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import brentq
from scipy.special import ndtri, stdtr, stdtrit

from meal_bayes.arrays import Floats
from meal_bayes.evaluation import (
    Estimate,
    Interval,
    clustered,
    difference,
    estimate_mean,
    paired_fractions,
)
from meal_bayes.evaluation.statistics import MASS
from meal_bayes.experiments.offline import UNIT
from meal_bayes.trials import TrialOutcomes

LEVEL = 1 - MASS
_TINY = 1e-9  # a level below all that are asked for, where Student's will do
POWER = 0.8  # with which further splits are to decide, in pages too
_MOST = 10_000  # splits that anybody would run


def level_above(effect: Estimate, bound: float) -> float:
    """Return the smallest level at which an effect's two-sided interval lies above a bound.

    Above 1 is none: also where all values are equal, so that nothing tells how they would spread.
    """
    distance = effect.estimate - bound
    se = effect.se
    if effect.fraction and 0 < bound < 1:
        # Wilson's interval ends where the bound's own binomial error reaches to the estimate.
        se = math.sqrt(bound * (1 - bound) / effect.cases)
    if math.isinf(bound):
        return 0.0 if bound < 0 else 2.0
    # An interval that joins two of Wilson's has no formula for its level: it is searched for.
    if effect.sides is not None and distance > 0 and effect.interval(1 - _TINY).low <= bound:
        return float(brentq(lambda level: effect.interval(1 - level).low - bound, _TINY, 1.0))
    if not se > 0:
        return 2.0
    return 2 * float(stdtr(max(effect.clusters - 1, 1), -distance / se))


def level_below(effect: Estimate, bound: float) -> float:
    """Return the smallest level at which an effect's two-sided interval lies below a bound."""
    if effect.fraction:
        return level_above(dataclasses.replace(effect, estimate=1 - effect.estimate), 1 - bound)
    sides = effect.sides and effect.sides[::-1]
    return level_above(dataclasses.replace(effect, estimate=-effect.estimate, sides=sides), -bound)


def needed(effect: Estimate, bound: float, level: float) -> int | None:
    """Return the splits that decide on which side of a bound an effect is, at 80 % power.

    A further split narrows the spread that splits have, whatever they have a mean of. None where no
    number below 10,000 would, as the difference is nothing or the fixed part is too much, and where
    only more objects would, which nobody can draw.
    """
    p = effect.estimate
    distance = abs(effect.estimate - bound)
    if effect.cluster != "splits" or not (effect.se > 0 and distance > 0):
        return None
    splits = np.arange(effect.clusters + 1, _MOST)
    # Splits share their objects: of J of them the variance is a fixed part and one that falls by J.
    se = np.sqrt(effect.fixed + (effect.se**2 - effect.fixed) * effect.clusters / splits)
    # Wilson's interval of a fraction ends at the bound where the bound's own error reaches to it.
    error = math.sqrt(bound * (1 - bound) / (p * (1 - p))) if effect.fraction else 1.0
    reach = (stdtrit(splits - 1, 1 - level / 2) * error + ndtri(POWER)) * se
    decided = np.flatnonzero(distance >= reach)
    return int(splits[decided[0]]) if len(decided) else None


def holm(levels: ArrayLike, level: float = LEVEL) -> Floats:
    """Return the level of each test of a family, so that it has a false one at `level` [Holm1979].

    >>> holm([0.04, 0.001, 0.02], 0.05).round(4).tolist()  # of their smallest levels
    [0.05, 0.0167, 0.025]
    """
    p = np.asarray(levels, float)
    order = np.argsort(p, kind="stable")
    # The smallest of m levels is compared with level / m, the next one with level / (m - 1), ...
    adjusted = level / np.arange(len(p), 0, -1)  # by rank
    failed = np.flatnonzero(p[order] > adjusted)
    if len(failed):  # no test behind the first that fails has a level of its own
        adjusted[failed[0] :] = adjusted[failed[0]]
    return adjusted[np.argsort(order)]


def bootstrap_interval(
    values: ArrayLike,
    clusters: ArrayLike,
    rng: np.random.Generator,
    *,
    statistic: Callable[[Floats], float] = np.mean,
    draws: int = 2000,
) -> Interval:
    """Compute the 95 % percentile interval of a statistic of (n, ...), drawing clusters again."""
    x = np.asarray(values, float)
    index = np.unique(clusters, return_inverse=True)[1]
    members = [x[index == c] for c in range(index.max() + 1)]
    # Trials of one cluster come along together, so that how alike they are stays in the spread.
    drawn = np.empty(draws)
    for i in range(draws):
        chosen = rng.integers(len(members), size=len(members))
        drawn[i] = statistic(np.concatenate([members[c] for c in chosen]))
    low, high = np.quantile(drawn, [0.5 - MASS / 2, 0.5 + MASS / 2])
    return Interval(float(statistic(x)), float(drawn.std(ddof=1)), float(low), float(high))


def change_of_means(
    first: ArrayLike,
    first_clusters: ArrayLike,
    second: ArrayLike,
    second_clusters: ArrayLike,
    *,
    fraction: bool = False,
) -> Estimate:
    """Estimate the mean of first - second where the tasks differ; clusters in both are paired."""
    sides = []  # mean of each cluster, on either side
    for values, clusters in ((first, first_clusters), (second, second_clusters)):
        x = np.asarray(values, float)
        names = np.asarray(clusters)
        sides.append({name: x[names == name].mean() for name in np.unique(names)})
    shared = sorted(set(sides[0]) & set(sides[1]))
    if not shared:
        return Estimate(math.nan, math.nan, 0)
    estimate = partial(clustered, clusters=shared)
    changes = [sides[0][name] - sides[1][name] for name in shared]
    return paired_fractions(changes, estimate) if fraction else estimate(changes)


def drawn_mean(run: TrialOutcomes, measure: str) -> Estimate:
    """Estimate a mean where percepts are drawn: of the paper's objects, trials as units.

    These objects are then the whole population, each trial draws its object, its question and its
    percepts, and more trials narrow the interval without end.
    """
    return _of_trials(estimate_mean(_alone(run), measure))


def drawn_difference(first: TrialOutcomes, second: TrialOutcomes, *, measure: str) -> Estimate:
    """Estimate the mean of first - second where percepts are drawn, over the tasks of both."""
    return _of_trials(difference(_alone(first), _alone(second), measure=measure))


def drawn_change(first: Estimate, second: Estimate) -> Estimate:
    """Estimate first - second of two runs whose trials are drawn independently of each other."""
    both = first.fraction and second.fraction
    return Estimate(
        first.estimate - second.estimate,
        math.hypot(first.se, second.se),
        min(first.clusters, second.clusters),
        cluster="trials",
        method="Wilson's of both" if both else "Student's t, two runs",
        sides=(first, second) if both else None,
    )


def planned_trials(spread: float, half_width: float, level: float) -> int:
    """Return the trials whose mean has an interval of a half width at a level, in whole files.

    Whole files of one run are those of a longer one, so that items share what they compute.

    Parameters
    ----------
    spread : standard deviation of a trial, known before the run.
    half_width : of the interval, in the same unit.
    level : of the interval; that of the first test of its family by Holm, the smallest.

    >>> planned_trials(12.87, 2.985, 0.05 / 14)  # 158 are enough
    200
    """
    enough = (-float(ndtri(level / 2)) * spread / half_width) ** 2
    return math.ceil(enough / UNIT) * UNIT


def _alone(run: TrialOutcomes) -> TrialOutcomes:
    """Make every trial a unit of its own."""
    return dataclasses.replace(run, object_name=run.key)


def _of_trials(effect: Estimate) -> Estimate:
    method = effect.method.replace("clusters", "trials")
    return dataclasses.replace(effect, cluster="trials", method=method)

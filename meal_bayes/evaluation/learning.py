"""Learning curves: how right, after how many hours of exploration (Sect. 7.3).

The hours that an agent needs are read off mean curves made monotone, as noisy curves cross a level
many times; their uncertainty is estimated by drawing whole repeats again.
"""

import dataclasses
import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import isotonic_regression

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.calibration import (
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)
from meal_bayes.evaluation.statistics import (
    Interval,
    Measures,
    bootstrap_interval,
    paired_difference,
)
from meal_bayes.evaluation.summary import mean
from meal_bayes.seeds import stream
from meal_bayes.trial_log import BatchOutcomes, TrialOutcomes

Array = NDArray[np.float64]

REFERENCE = "iterative_morc"
_LAST = 3  # batches whose mean accuracy is the level to reach, and whose beliefs are pooled
_MASS = 0.9  # of the interval of an hours ratio
_SOON = 1e-3  # h; a level that is there before any training counts as reached after this


@dataclasses.dataclass(frozen=True, slots=True)
class LearningRow(Measures):
    """Test trials of one agent after one batch of one repeat; nan where undefined."""

    agent: str
    batch: int
    repeat: int
    exploration_hours: float
    accuracy: float  # Eq. 5
    accuracy_se: float  # objects drawn as wholes
    test_cost_s: float
    reward: float  # unshaped
    nll: float  # of the final belief, nats
    ece: float  # biased up with few hundred cases, see `pooled_ece`
    claimed_accuracy: float  # mean of the agent's own Pr(its report is right)


@dataclasses.dataclass(frozen=True, slots=True)
class LearningSummary(Measures):
    """An agent beside the reference, over the repeats they share; nan where undefined."""

    agent: str
    repeats: int
    exploration_hours: float  # after the last batch
    accuracy: float  # mean of the last three batches
    reward: float  # after the last batch
    pooled_ece: float  # of the last three batches and all repeats
    ece_calibrated: float  # what calibrated beliefs of the same values would show
    hours_ratio: float  # the reference's hours to its own accuracy over the agent's; 0: never
    hours_ratio_low: float
    hours_ratio_high: float
    accuracy_difference: float  # agent - reference
    accuracy_difference_se: float
    reward_difference: float
    reward_difference_se: float


class Curves(NamedTuple):
    """Curves of one agent, (S,B) of S repeats and B batches each."""

    repeats: tuple[int, ...]
    hours: Array
    accuracy: Array
    reward: Array


def learning_rows(results: Iterable[BatchOutcomes]) -> list[LearningRow]:
    """Measure every batch of test trials."""
    return list(map(_row, results))


def curves_of(results: Iterable[BatchOutcomes], agent: str) -> Curves:
    """Collect the curves of an agent.

    Raises
    ------
    SettingsError : no results of this agent, or repeats of different length.
    """
    mine = sorted((r for r in results if r.agent == agent), key=lambda r: (r.repeat, r.batch))
    repeats = tuple(dict.fromkeys(result.repeat for result in mine))
    if not mine or len(mine) % len(repeats):
        raise SettingsError(f"No whole learning curve of {agent!r}; run it, or wait for its end.")
    shape = (len(repeats), -1)
    hours = np.array([result.hours for result in mine]).reshape(shape)
    accuracy = np.array([_accuracy(result.outcomes) for result in mine]).reshape(shape)
    reward = np.array([result.outcomes.reward.mean() for result in mine]).reshape(shape)
    return Curves(repeats, hours, accuracy, reward)


def summarize_learning(
    results: Sequence[BatchOutcomes], *, reference: str = REFERENCE
) -> list[LearningSummary]:
    """Compare every agent with the reference; without it, differences and ratios are nan."""
    agents = dict.fromkeys(result.agent for result in results)
    base = curves_of(results, reference) if reference in agents else None
    return [_summary(results, agent, base) for agent in agents]


def hours_to(hours: Array, accuracy: Array, level: float) -> float:
    """Compute the hours at which a mean curve, made monotone, reaches a level; inf if never.

    >>> hours_to(np.array([0.0, 1.0, 2.0]), np.array([0.5, 0.9, 0.7]), 0.65)
    0.5
    """
    rising = isotonic_regression(accuracy).x
    reached = np.flatnonzero(rising >= level - 1e-12)
    if not len(reached):
        return math.inf
    i = int(reached[0])
    if i == 0:
        return float(hours[0])
    return float(np.interp(level, rising[i - 1 : i + 1], hours[i - 1 : i + 1]))


def pooled_ece(results: Iterable[BatchOutcomes], *, last: int = _LAST) -> tuple[float, float]:
    """Compute the ECE of an agent's last batches in all repeats, and of calibrated beliefs."""
    every = list(results)
    end = max(result.batch for result in every)
    chosen = [result.outcomes.beliefs() for result in every if result.batch > end - last]
    positive, truth = (np.concatenate(parts) for parts in zip(*chosen, strict=True))
    rng = stream(0, "calibrated belief")
    return calibration_error(positive, truth), expected_calibration_error(positive, rng, draws=20)


def _row(result: BatchOutcomes) -> LearningRow:
    outcomes = result.outcomes
    positive, truth = outcomes.beliefs()
    accuracy = mean(outcomes, "success")
    return LearningRow(
        agent=result.agent,
        batch=result.batch,
        repeat=result.repeat,
        exploration_hours=result.hours,
        accuracy=accuracy.estimate,
        accuracy_se=accuracy.se,
        test_cost_s=float(outcomes.cost.mean()),
        reward=float(outcomes.reward.mean()),
        nll=float(negative_log_likelihood(positive, truth).mean()),
        ece=calibration_error(positive, truth),
        claimed_accuracy=float(outcomes.certainty.mean()),
    )


def _accuracy(outcomes: TrialOutcomes) -> float:
    return float(outcomes.success[outcomes.judged].mean())


def _summary(results: Sequence[BatchOutcomes], agent: str, base: Curves | None) -> LearningSummary:
    own = curves_of(results, agent)
    ece, calibrated = pooled_ece(result for result in results if result.agent == agent)
    ratio = low = high = math.nan
    accuracy = reward = Interval(math.nan, math.nan, math.nan, math.nan)
    if base is not None:
        shared = sorted(set(own.repeats) & set(base.repeats))
        first = _of(own, shared)
        second = _of(base, shared)
        both = np.stack([first.hours, first.accuracy, second.hours, second.accuracy], axis=1)
        rng = stream(0, "hours ratio", agent)
        found = bootstrap_interval(both, shared, rng, statistic=_ratio, draws=1000, mass=_MASS)
        ratio, low, high = found.estimate, found.low, found.high
        last = slice(-_LAST, None)
        accuracy = paired_difference(
            first.accuracy[:, last].mean(axis=1), second.accuracy[:, last].mean(axis=1), shared
        )
        reward = paired_difference(first.reward[:, -1], second.reward[:, -1], shared)
    return LearningSummary(
        agent=agent,
        repeats=len(own.repeats),
        exploration_hours=float(own.hours[:, -1].mean()),
        accuracy=float(own.accuracy[:, -_LAST:].mean()),
        reward=float(own.reward[:, -1].mean()),
        pooled_ece=ece,
        ece_calibrated=calibrated,
        hours_ratio=ratio,
        hours_ratio_low=low,
        hours_ratio_high=high,
        accuracy_difference=accuracy.estimate,
        accuracy_difference_se=accuracy.se,
        reward_difference=reward.estimate,
        reward_difference_se=reward.se,
    )


def _of(curves: Curves, repeats: Sequence[int]) -> Curves:
    rows = [curves.repeats.index(repeat) for repeat in repeats]
    return Curves(tuple(repeats), *(part[rows] for part in curves[1:]))


def _ratio(both: Array) -> float:
    """Compute the ratio of hours from (S,4,B): the agent's hours and accuracy, the reference's."""
    hours, accuracy, base_hours, base_accuracy = both.mean(axis=0)
    level = float(base_accuracy[-_LAST:].mean())
    needed = max(hours_to(hours, accuracy, level), _SOON)
    base_needed = max(hours_to(base_hours, base_accuracy, level), _SOON)
    return 0.0 if math.isinf(needed) else base_needed / needed

"""Learning curves: what test trials earn, after how many hours of exploration (Sect. 7.3).

Agents are compared with the first one named, its curve and theirs paired repeat by repeat: by the
area between the curves of mean test reward over the hours that the reference explores, at fixed
budgets of hours, after the last batch, and by the successes within a budget (Eq. 7).
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import trapezoid

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.calibration import (
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)
from meal_bayes.evaluation.statistics import MASS, Interval, Measures, resampled, spent
from meal_bayes.evaluation.summary import mean
from meal_bayes.seeds import stream
from meal_bayes.trials import BatchOutcomes, TrialOutcomes

Array = NDArray[np.float64]

BUDGETS = (0.5, 1.0, 2.0, 4.0)  # h of exploration
RATIO = 0.5  # test objects over training objects: the paper's thirds
_FIRST = 10  # repeats after which a run that goes on looks for the first time
_LAST = 3  # batches whose beliefs are pooled


@dataclasses.dataclass(frozen=True, slots=True)
class LearningRow(Measures):
    """Test trials of one agent after one batch of one repeat; nan where undefined.

    Attributes
    ----------
    hours : of exploration so far.
    accuracy, accuracy_se : Eq. 5; objects as clusters.
    reward : mean, unshaped.
    ece : of the final beliefs; of a few hundred cases it is biased up, see `pooled_ece`.
    test_cost_s : mean, s.
    nll : of the final beliefs, nats.
    claimed_accuracy : mean of the agent's own Pr(its report is right).
    """

    agent: str
    repeat: int
    batch: int
    hours: float
    accuracy: float
    reward: float
    ece: float
    accuracy_se: float
    test_cost_s: float
    nll: float
    claimed_accuracy: float


@dataclasses.dataclass(frozen=True, slots=True)
class LearningSummary(Measures):
    """An agent beside the reference, over the repeats that they share; nan where undefined.

    Attributes
    ----------
    area_hours : hours H that the reference explores, mean over repeats.
    area_reward_difference : of the mean test reward over the first H hours, agent - reference.
    area_low, area_high : its 95 % interval, corrected as repeats split the same objects.
    reward_after : after the last batch.
    reward_after_difference : agent - reference.
    accuracy_after : after the last batch.
    ece_after : of the last three batches, all repeats pooled.
    """

    agent: str
    area_hours: float
    area_reward_difference: float
    area_low: float
    area_high: float
    reward_after: float
    reward_after_difference: float
    accuracy_after: float
    ece_after: float

    @property
    def decided(self) -> bool:
        """Whether the interval of the area excludes 0."""
        return self.area_low > 0 or self.area_high < 0


class Curves(NamedTuple):
    """Curves of one agent, S repeats and B batches.

    Attributes
    ----------
    repeats : (S,) their numbers.
    hours, accuracy, reward : (S,B).
    """

    repeats: tuple[int, ...]
    hours: Array
    accuracy: Array
    reward: Array


def learning_rows(results: Iterable[BatchOutcomes]) -> list[LearningRow]:
    """Measure every batch of test trials."""
    return [_row(result) for result in results]


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
    results: Sequence[BatchOutcomes],
    *,
    reference: str | None = None,
    ratio: float = RATIO,
    mass: float = MASS,
) -> list[LearningSummary]:
    """Compare every agent with the reference.

    Parameters
    ----------
    results : of all agents.
    reference : the agent compared with; by default the first one.
    ratio : test objects over training objects, of `resampled`.
    mass : of the intervals.
    """
    agents = tuple(dict.fromkeys(result.agent for result in results))
    curves = {agent: curves_of(results, agent) for agent in agents}
    base = curves[agents[0] if reference is None else reference]
    return [_summary(results, agent, curves[agent], base, ratio, mass) for agent in agents]


def decided(results: Sequence[BatchOutcomes]) -> bool:
    """Return whether the interval of every agent's area excludes 0, but the first one's.

    Looks after 10, 20, 40, ... repeats pay for each other (see `spent`).
    """
    repeats = len({result.repeat for result in results})
    look = 1 + max(0, math.floor(math.log2(max(repeats, 1) / _FIRST)))
    return all(row.decided for row in summarize_learning(results, mass=1 - spent(look))[1:])


def area_difference(
    own: Curves, base: Curves, *, ratio: float = RATIO, mass: float = MASS
) -> tuple[float, Interval]:
    """Compare mean rewards over the hours that the reference explores.

    A curve is linear between batches, and stays at its end where an agent has explored less.

    Returns
    -------
    The hours, mean over repeats, and the paired difference.
    """
    own, base = _shared(own, base)
    hours = float(base.hours[:, -1].mean())
    return hours, _difference(own, base, lambda x, y: mean_until(x, y, hours), ratio, mass)


def difference_at(own: Curves, base: Curves, budget: float, *, ratio: float = RATIO) -> Interval:
    """Compare rewards after some hours of exploration, linear between batches."""
    own, base = _shared(own, base)
    return _difference(own, base, lambda x, y: float(np.interp(budget, x, y)), ratio)


def mean_until(hours: Array, values: Array, end: float) -> float:
    """Average a curve, linear between its points, over the first hours; its start where end is 0.

    >>> mean_until(np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0]), 4.0)
    0.875
    """
    if end <= 0:
        return float(values[0])
    points = np.append(hours[hours < end], end)
    return float(trapezoid(np.interp(points, hours, values), points) / end)


def successes_within(outcomes: TrialOutcomes, budget: float) -> int:
    """Count the successes of an agent's trials, in order, until a budget is spent (Eq. 7).

    Parameters
    ----------
    outcomes : of one agent.
    budget : s; the trial that passes it does not count.
    """
    paid = np.cumsum(outcomes.cost) <= budget
    return int((outcomes.success[paid] == 1).sum())


def success_difference(
    own: Sequence[TrialOutcomes],
    base: Sequence[TrialOutcomes],
    budget: float,
    *,
    ratio: float = RATIO,
) -> Interval:
    """Compare the successes of training trials within a budget (Eq. 7), paired by repeat.

    Parameters
    ----------
    own, base : training trials of two agents, one entry a repeat (see `OnlineRun.training`).
    budget : s of each repeat.
    """
    first, second = ([successes_within(one, budget) for one in trials] for trials in (own, base))
    return resampled(np.subtract(first, second), ratio).interval()


def pooled_ece(results: Iterable[BatchOutcomes], *, last: int = _LAST) -> tuple[float, float]:
    """Compute the expected calibration error over all repeats of one agent's last batches.

    Returns
    -------
    The error, and what calibrated beliefs of the same values would show.
    """
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
        repeat=result.repeat,
        batch=result.batch,
        hours=result.hours,
        accuracy=accuracy.estimate,
        reward=float(outcomes.reward.mean()),
        ece=calibration_error(positive, truth),
        accuracy_se=accuracy.se,
        test_cost_s=float(outcomes.cost.mean()),
        nll=float(negative_log_likelihood(positive, truth).mean()),
        claimed_accuracy=float(outcomes.certainty.mean()),
    )


def _accuracy(outcomes: TrialOutcomes) -> float:
    return float(outcomes.success[outcomes.judged].mean())


def _summary(
    results: Sequence[BatchOutcomes], agent: str, own: Curves, base: Curves, ratio: float,
    mass: float,
) -> LearningSummary:  # fmt: skip
    hours, area = area_difference(own, base, ratio=ratio, mass=mass)
    paired, against = _shared(own, base)
    after = paired.reward[:, -1] - against.reward[:, -1]
    return LearningSummary(
        agent=agent,
        area_hours=hours,
        area_reward_difference=area.estimate,
        area_low=area.low,
        area_high=area.high,
        reward_after=float(own.reward[:, -1].mean()),
        reward_after_difference=float(after.mean()),
        accuracy_after=float(own.accuracy[:, -1].mean()),
        ece_after=pooled_ece(result for result in results if result.agent == agent)[0],
    )


def _difference(
    own: Curves, base: Curves, of: Callable[[Array, Array], float], ratio: float,
    mass: float = MASS,
) -> Interval:  # fmt: skip
    """Compare a number of hours (B,) and rewards (B,), paired by repeat."""
    found, against = (
        [of(hours, reward) for hours, reward in zip(one.hours, one.reward, strict=True)]
        for one in (own, base)
    )
    return resampled(np.subtract(found, against), ratio).interval(mass)


def _shared(own: Curves, base: Curves) -> tuple[Curves, Curves]:
    """Return the repeats that two agents share.

    Raises
    ------
    SettingsError : there are none.
    """
    repeats = tuple(sorted({*own.repeats} & {*base.repeats}))
    if not repeats:
        raise SettingsError("No repeat is of both agents; run the same repeats of each.")

    def of(curves: Curves) -> Curves:
        rows = [curves.repeats.index(repeat) for repeat in repeats]
        return Curves(repeats, *(part[rows] for part in curves[1:]))

    return of(own), of(base)

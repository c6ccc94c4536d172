"""Learning curves: what test trials earn, after how many hours of exploration (Sect. 7.3).

Agents are compared with the first one named, its curve and theirs paired repeat by repeat: by the
area between the curves of mean test reward over the hours that the reference explores, at fixed
budgets of hours, and after the last batch.
"""

import dataclasses
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial

import numpy as np
from scipy.integrate import trapezoid

from meal_bayes.arrays import Floats
from meal_bayes.evaluation.calibration import calibration_error, negative_log_likelihood
from meal_bayes.evaluation.statistics import MASS, Interval, Measures, resampled, spent
from meal_bayes.evaluation.summary import estimate_mean
from meal_bayes.trials import BatchOutcomes

Curves = Mapping[int, Floats]  # hours and mean test rewards (2,B) by repeat

BUDGETS = (0.5, 1.0, 2.0, 4.0)  # h of exploration
RATIO = 0.5  # test objects over training objects: the paper's thirds
POOLED = 3  # last batches, whose tests' beliefs give one ECE


@dataclasses.dataclass(frozen=True, slots=True)
class LearningRow(Measures):
    """Test trials of one agent after one batch of one repeat; nan where undefined."""

    agent: str
    repeat: int
    batch: int
    hours: float  # of exploration so far
    accuracy: float
    reward: float  # mean, unshaped
    ece: float  # of the final beliefs; of a few hundred cases it is biased up, see `ece_after`
    accuracy_se: float  # with objects as clusters
    test_cost_s: float  # mean
    nll: float  # of the final beliefs
    certainty: float  # mean of the agent's own Pr(its report is right)


@dataclasses.dataclass(frozen=True, slots=True)
class LearningSummary(Measures):
    """An agent beside the reference, over the repeats that they share; nan where undefined.

    `after` is after the last batch; differences are agent - reference.
    """

    agent: str
    area_hours: float  # H that the reference explores, mean over repeats
    area_reward_difference: float  # of the mean test reward over the first H hours
    area_low: float  # of its 95 % interval, corrected as repeats split the same objects
    area_high: float
    reward_difference_at: dict[str, float]  # at some hours; NaN where a curve ends earlier
    reward_after: float
    reward_after_difference: float
    accuracy_after: float
    ece_after: float  # of the last batches (`POOLED`), all repeats together


def learning_rows(results: Iterable[BatchOutcomes]) -> list[LearningRow]:
    """Measure every batch of test trials."""
    rows = []
    for agent, repeat, batch, hours, outcomes in results:
        positive, truth = outcomes.beliefs()
        accuracy = estimate_mean(outcomes, "success")
        rows.append(
            LearningRow(
                agent,
                repeat,
                batch,
                hours,
                accuracy=accuracy.estimate,
                accuracy_se=accuracy.se,
                reward=float(outcomes.reward.mean()),
                test_cost_s=float(outcomes.cost.mean()),
                ece=calibration_error(positive, truth),
                nll=float(negative_log_likelihood(positive, truth).mean()),
                certainty=float(outcomes.certainty.mean()),
            )
        )
    return rows


def curves_of(results: Iterable[BatchOutcomes], agent: str) -> Curves:
    """Collect the curves of an agent."""
    points: dict[int, list[tuple[int, float, float]]] = {}
    for result in results:
        if result.agent == agent:
            point = (result.batch, result.hours, float(result.outcomes.reward.mean()))
            points.setdefault(result.repeat, []).append(point)
    return {repeat: np.array(sorted(points[repeat])).T[1:] for repeat in sorted(points)}


def summarize_learning(
    results: Sequence[BatchOutcomes], *, mass: float = MASS
) -> list[LearningSummary]:
    """Compare every agent with the first one, by intervals of a mass.

    The area is that between curves which are linear between batches. An agent that stopped earlier
    than the reference learns no more: it counts with the reward of its last tests.
    """
    agents = tuple(dict.fromkeys(result.agent for result in results))
    curves = {agent: curves_of(results, agent) for agent in agents}
    reference = curves[agents[0]]
    rows = list[LearningSummary]()
    for agent, curve in curves.items():
        shared = sorted(curve.keys() & reference.keys())
        end = float(np.mean([reference[repeat][0, -1] for repeat in shared]))
        area = _difference(curve, reference, partial(mean_until, end=end), mass)
        after = _difference(curve, reference, lambda hours, reward: reward[-1])
        batches = [result for result in results if result.agent == agent]
        last = max(result.batch for result in batches)
        final = [result.outcomes for result in batches if result.batch == last]
        beliefs = [result.outcomes.beliefs() for result in batches if result.batch > last - POOLED]
        gains_at = {
            f"{hours:g}": difference_at(curve, reference, hours).estimate for hours in BUDGETS
        }
        rows.append(
            LearningSummary(
                agent=agent,
                area_hours=end,
                area_reward_difference=area.estimate,
                area_low=area.low,
                area_high=area.high,
                reward_difference_at=gains_at,
                reward_after=float(np.mean([reward[-1] for _, reward in curve.values()])),
                reward_after_difference=after.estimate,
                accuracy_after=float(np.mean([test.success[test.judged].mean() for test in final])),
                ece_after=calibration_error(*map(np.concatenate, zip(*beliefs, strict=True))),
            )
        )
    return rows


def decided(results: Sequence[BatchOutcomes], first_look: int) -> bool:
    """Return whether the interval of every agent's area excludes 0, but the first one's.

    Looks after that many repeats, and after each doubling, pay for each other (see `spent`).
    """
    repeats = len({result.repeat for result in results})
    look = 1 + max(0, math.floor(math.log2(max(repeats, 1) / first_look)))
    rows = summarize_learning(results, mass=1 - spent(look))[1:]
    return all(row.area_low > 0 or row.area_high < 0 for row in rows)


def difference_at(curves: Curves, reference: Curves, budget: float) -> Interval:
    """Compare rewards after some hours of exploration, linear between batches.

    It is NaN where a curve of a repeat that both have ends earlier: nothing is extrapolated.
    """
    shared = curves.keys() & reference.keys()
    # One curve that ends earlier would be compared by a value that it never had.
    ends = [some[repeat][0, -1] for some in (curves, reference) for repeat in shared]
    if not ends or budget > min(ends):
        return Interval(math.nan, math.nan, math.nan, math.nan)
    return _difference(curves, reference, lambda x, y: float(np.interp(budget, x, y)))


def mean_until(hours: Floats, values: Floats, end: float) -> float:
    """Average a curve, linear between its points, over the first hours; at 0 it is its start."""
    if end <= 0:
        return float(values[0])
    points = np.append(hours[hours < end], end)
    return float(trapezoid(np.interp(points, hours, values), points) / end)


def _difference(
    curves: Curves, reference: Curves, of: Callable[[Floats, Floats], float], mass: float = MASS
) -> Interval:
    """Compare a number of hours (B,) and rewards (B,), paired by repeat."""
    shared = sorted(curves.keys() & reference.keys())
    gains = [of(*curves[repeat]) - of(*reference[repeat]) for repeat in shared]
    return resampled(gains, RATIO).interval(mass)

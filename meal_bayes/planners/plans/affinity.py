"""A cheap measure of how informative percepts are: the Bhattacharyya coefficient.

The coefficient of k percepts is the sum of sqrt(Pr(j | true) Pr(j | false)) over all outcomes j,
the numbers of percepts of each level. It is 1 if the percepts are uninformative and 0 if they
determine the truth. The Bayes error is at most sqrt(b (1 - b)) times the coefficient [Kailath1967],
where b is the belief. If percepts are independent given the truth, the coefficients of behaviors
multiply. With shared latent classes, their product gives an estimate of the error, but no bound.
"""

from typing import Any

import numpy as np

from meal_bayes.arrays import Floats
from meal_bayes.momdp.observation import predictive
from meal_bayes.momdp.reports import Conjunction, mean_reward
from meal_bayes.planners.momdp_arrays import MOMDPArrays, paid_share
from meal_bayes.planners.plans.candidates import Candidates

# Coefficients are computed for 0 to 7 percepts of a behavior. For more percepts, the growth of
# plans extrapolates, and `estimate_values` uses 7.
COUNTED = 8


def log_affinities(model: MOMDPArrays) -> Floats:
    """Compute the log of the coefficient of k percepts of a behavior, (N,E,U) for k < U."""
    percepts = model.percepts
    rows = _merged_levels(percepts.rows)
    s = percepts.precision
    # Pr(numbers of percepts of each level | class), (N,E,C,U,...), with an axis for each level
    # except the lowest.
    above = rows.shape[3] - 1
    axes = (None,) * above
    counts = np.zeros((*rows.shape[:3], *(COUNTED,) * above))
    counts[(..., *(0,) * above)] = 1.0
    log_affinity = np.zeros((*rows.shape[:2], COUNTED))
    shared = np.indices((COUNTED,) * above)
    for k in range(COUNTED - 1):
        # Polya's urn: P(j + 1 of k + 1) = P(j of k) Pr(level | j of k), class by class.
        moves = []
        for z in range(above):
            rate = predictive(rows[(..., z + 1, *axes)], s[(..., *axes)], shared[z], k)
            lower = _cut(z, above, slice(None, -1))
            moves.append((lower, _cut(z, above, slice(1, None)), (counts * rate)[lower]))
        for lower, _, more in moves:
            counts[lower] -= more
        for _, upper, more in moves:
            counts[upper] += more
        counts.clip(0.0, out=counts)  # against rounding errors
        flat = counts.reshape(*counts.shape[:3], -1)
        by_truth = percepts.class_of_truth[:, None] @ flat  # (N,E,2,J)
        affinity = np.sqrt(by_truth[:, :, 0] * by_truth[:, :, 1])
        if above == 1:
            affinity = affinity[..., : k + 2]
        log_affinity[..., k + 1] = np.log(affinity.sum(axis=-1) + 1e-300)
    return np.where(percepts.informative[..., None], log_affinity, 0.0)


def _cut(axis: int, axes: int, part: slice) -> tuple[Any, ...]:
    """Return an index that takes a part of one of the last axes."""
    return (..., *(part if other == axis else slice(None) for other in range(axes)))


def _merged_levels(rows: Floats) -> Floats:
    """Merge levels (...,K) to at most four, two for no and two for yes."""
    half = rows.shape[-1] // 2
    if half <= 2:
        return rows
    inner = half // 2
    starts = [0, half - inner, half, half + inner]
    return np.asarray(np.add.reduceat(rows, starts, axis=-1))


def estimate_values(
    model: MOMDPArrays, candidates: Candidates, probabilities: Floats, log_affinity: Floats
) -> Floats:
    """Estimate the values (B,J) of candidates at beliefs (B,N), from coefficients (N,E,U)."""
    within = np.minimum(model.percepts.limit, COUNTED - 1).astype(np.int64)
    counts = np.minimum(candidates.observation_counts, within)
    affinity = np.exp(log_affinity[:, np.arange(counts.shape[1]), counts].sum(axis=2))  # (N,J)
    lost = candidates.plan["lost"]
    value = candidates.plan["discount"] * _estimate_answers(model, probabilities, affinity)
    value -= candidates.plan["cost"]
    if lost.any():  # the robot then answers at once
        value += lost * _estimate_answers(model, probabilities, np.ones((len(affinity), 1)))
    if model.shaped:
        planned = candidates.observation_counts
        fraction = paid_share(model.bonus_limit, 0.0, planned) * (planned > 0)
        pay = model.bonus.mean(axis=2).sum(axis=0)
        value += (fraction * candidates.expected_percepts) @ pay
    return np.asarray(value)


def _estimate_answers(model: MOMDPArrays, probabilities: Floats, affinity: Floats) -> Floats:
    """Estimate rewards (B,J) of the best answer after percepts with coefficients (N,J)."""
    if model.conjunction is None:
        return _estimate_reports(model, probabilities, affinity)
    return _estimate_yes_or_no(model.conjunction, probabilities, affinity)


def _estimate_reports(model: MOMDPArrays, probabilities: Floats, affinity: Floats) -> Floats:
    """Estimate rewards (B,J) of reporting values, with the largest possible errors."""
    right = np.ones((len(probabilities), affinity.shape[1]))
    unsure = np.sqrt(probabilities * (1.0 - probabilities))
    for of_attribute, of_plans in zip(unsure.T, affinity, strict=True):
        right *= 1.0 - of_attribute[:, None] * of_plans
    return np.asarray(mean_reward(model.incorrect, model.reward_range, right))


def _estimate_yes_or_no(
    conjunction: Conjunction, probabilities: Floats, affinity: Floats
) -> Floats:
    """Estimate rewards (B,J) of yes or no; half of each error counts as misses."""
    q = np.where(conjunction.literal, probabilities, 1.0 - probabilities)  # (B,N)
    unsure = np.sqrt(probabilities * (1.0 - probabilities))
    error = 0.5 * unsure[:, :, None] * affinity  # (B,N,J)
    # Pr(accepted, true) and Pr(accepted, false) of each literal, then of all.
    hit = q[:, :, None] - np.minimum(q[:, :, None], error)
    alarm = np.minimum(1.0 - q[:, :, None], error)
    right = hit.prod(axis=1)
    wrong = (hit + alarm).prod(axis=1) - right
    holds = q.prod(axis=1)[:, None]
    deny = mean_reward(conjunction.wrong_denial, conjunction.denial_gain, 1.0 - holds)
    assertion = conjunction.gain * right - conjunction.loss * wrong
    return np.asarray(deny + np.maximum(assertion, 0.0))

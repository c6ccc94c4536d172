"""Kernels of yes or no after an open-loop plan: the value of asserting that all literals hold.

Each attribute's percepts are taken for its literal or against it: with probability h_i if it holds,
f_i if not (a point of the plan's ROC). The conjunction is asserted where all are taken to hold, and
denied elsewhere. With q_i = Pr(literal i), Pr(assert) = prod_i (q_i h_i + (1 - q_i) f_i) and
Pr(assert, right) = prod_i q_i h_i, in which the value is linear. So the best threshold of one
attribute is in closed form where those of the others are held, and thresholds are improved one at a
time.
"""

import numpy as np

from meal_bayes.planners.jit import called_kernel, kernel
from meal_bayes.planners.open_loop.bayes_error import (
    SPAN,
    log_odds,
    mean_reward,
    plan_rates,
    threshold_below,
)

_ROUNDS = 3  # in which the thresholds are improved


@kernel
def yes_or_no_value(conjunction, holds):
    """Compute the value of the best of assertion and denial at Pr(all literals hold)."""
    affirm = mean_reward(conjunction.wrong_assertion, conjunction.assertion_gain, holds)
    deny = mean_reward(conjunction.wrong_denial, conjunction.denial_gain, 1.0 - holds)
    return max(affirm, deny)


@kernel
def _as_literal(conjunction, i, scratch):
    """Turn Pr(says yes, truth) of attribute i into Pr(taken to hold, literal's truth)."""
    if not conjunction.literal[i]:
        b = scratch.chance[i]
        false = scratch.accepted[0, i]
        true = scratch.accepted[1, i]
        scratch.accepted[0, i] = b - true
        scratch.accepted[1, i] = 1.0 - b - false


@kernel
def _score(evaluator, t, g, prob, i, weights):
    """Value threshold g for attribute i: hits at weights[1], less alarms at weights[0].

    Pr(taken to hold, literal's truth) is put into column i of `accepted`.
    """
    table = evaluator.plans.table
    truth = evaluator.model.percepts.truth_of_class
    accepted = evaluator.scratch.accepted
    accepted[0, i] = 0.0
    accepted[1, i] = 0.0
    for c in range(table.shape[2]):
        p = prob[i, c] * table[t, g, c]
        accepted[0, i] += p * truth[i, 0, c]
        accepted[1, i] += p * truth[i, 1, c]
    _as_literal(evaluator.model.conjunction, i, evaluator.scratch)
    return weights[1] * accepted[1, i] - weights[0] * accepted[0, i]


@called_kernel
def _decide_literal(evaluator, t, prob, i, weights):
    """Choose the threshold of the best `_score`, or to take the literal always, or never."""
    literal = evaluator.model.conjunction.literal[i]
    exact_rule = evaluator.model.percepts.class_is_truth
    accepted = evaluator.scratch.accepted
    thresholds = evaluator.plans.table.shape[1]
    b = evaluator.scratch.chance[i]
    q = b if literal else 1.0 - b
    # To take the literal always: every hit (q), and every alarm (1 - q).
    always = weights[1] * q - weights[0] * (1.0 - q)
    best = 0.0
    if weights[1] > 0.0:
        # Yes where Pr(z | true) / Pr(z | false) times these odds exceeds 1.
        ratio = np.log((weights[1] + 1e-300) / (weights[0] + 1e-300))
        odds = log_odds(b) + (ratio if literal else -ratio)
        g = threshold_below(min(max(odds, -SPAN), SPAN), thresholds)
        best = _score(evaluator, t, g, prob, i, weights)
        beside = _score(evaluator, t, g + 1, prob, i, weights)
        step = 1 if beside > best else -1
        if beside > best:
            best = beside
            g += 1
        # Where classes are shared the best threshold may lie further off.
        while not exact_rule and 0 <= g + step < thresholds:
            beside = _score(evaluator, t, g + step, prob, i, weights)
            if beside <= best:
                break
            best = beside
            g += step
        _score(evaluator, t, g, prob, i, weights)
    if always >= max(best, 0.0):
        accepted[0, i] = 1.0 - q
        accepted[1, i] = q
    elif best <= 0.0:
        accepted[0, i] = 0.0
        accepted[1, i] = 0.0


@called_kernel
def _compute_literal(evaluator, j, prob, i, weights, first):
    """Compute what `_decide_literal` reads from tables; of the first round once a row."""
    scratch = evaluator.scratch
    conjunction = evaluator.model.conjunction
    t = evaluator.plans.row[j, i]
    z = scratch.column[i]
    if first and scratch.error[t, z] >= 0.0:
        scratch.accepted[0, i] = scratch.alarm[t, z]
        scratch.accepted[1, i] = scratch.error[t, z]
        return
    against = max(weights[0], 0.0) + 1e-300
    pro = max(weights[1], 0.0) + 1e-300
    weight = pro / against if conjunction.literal[i] else against / pro
    counts = evaluator.plans.observation_counts[j]
    plan_rates(evaluator.model.percepts, counts, i, prob, weight, scratch)
    _as_literal(conjunction, i, scratch)
    if first:
        scratch.alarm[t, z] = scratch.accepted[0, i]
        scratch.error[t, z] = scratch.accepted[1, i]


@called_kernel
def planned_yes_or_no(evaluator, j, prob, floor, enumerated):
    """Compute the reward expected at the end of a plan; at most `floor` if it cannot beat that.

    By tables, or `enumerated`; see `values`.
    """
    conjunction = evaluator.model.conjunction
    accepted = evaluator.scratch.accepted
    n = prob.shape[0]
    holds = 1.0
    for i in range(n):
        b = evaluator.scratch.chance[i]
        holds *= b if conjunction.literal[i] else 1.0 - b
    # What an assertion adds to a denial where it is right, and takes from it where it is wrong.
    gain = conjunction.gain
    loss = conjunction.loss
    deny = mean_reward(conjunction.wrong_denial, conjunction.denial_gain, 1.0 - holds)
    if deny + gain * holds <= floor:  # with percepts that tell all
        return deny + gain * holds
    for turn in range(_ROUNDS):
        for i in range(n):
            # What the others do: at first as if they were known.
            hits = 1.0
            asserts = 1.0
            for k in range(n if turn > 0 else 0):
                if k != i:
                    hits *= accepted[1, k]
                    asserts *= accepted[0, k] + accepted[1, k]
            # gain hits h - loss (asserts (h + f) - hits h): gained with h, and lost with f.
            weights = (loss * asserts, (gain + loss) * hits - loss * asserts)
            if enumerated:
                _compute_literal(evaluator, j, prob, i, weights, turn == 0)
            else:
                _decide_literal(evaluator, evaluator.plans.row[j, i], prob, i, weights)
    # E[reward] = deny + gain Pr(assert, right) - loss Pr(assert, wrong); or assert in any case.
    right = 1.0
    asserted = 1.0
    for i in range(n):
        right *= accepted[1, i]
        asserted *= accepted[0, i] + accepted[1, i]
    best = max(gain * right - loss * (asserted - right), gain * holds - loss * (1.0 - holds))
    return deny + max(best, 0.0)

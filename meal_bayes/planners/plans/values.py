"""Kernels of the value of open-loop plans: a lower bound on the optimum from any belief.

The value of a plan is -sum_k (prod_{j<k} g_j) c_k + (prod_k g_k) [r- + (r+ - r-) prod_i (1 -
err_i)], plus the exploration bonus on the way, and the value of an answer if the plan cannot
continue. Costs c_k and discount factors g_k are those of steps that are repeated until their most
probable outcome occurs (see `paths`). Errors are read from tables if the plan's behaviors have had
no percept yet (or their confusion matrices are known), and are computed otherwise.

For a yes-or-no question, the factor on prod_k g_k is the value of answering yes (all literals hold)
or no. The percepts of each attribute accept or reject its literal: they accept it with probability
h_i if it holds and f_i if not (a point of the plan's ROC curve). The answer is yes if all literals
are accepted, and otherwise no. With q_i = Pr(literal i), Pr(assert) = prod_i (q_i h_i + (1 - q_i)
f_i) and Pr(assert, right) = prod_i q_i h_i, in which the value is linear. So the best threshold of
one attribute has a closed form if the thresholds of the others are fixed, and thresholds are
improved one at a time. In the first round, the values of the other attributes are treated as known,
so results are the same for all plans that share a row of the table. In later rounds, the best
threshold of an attribute depends on the thresholds of earlier attributes from this round and of
later attributes from the last round, so the order of the attributes matters.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import Belief
from meal_bayes.planners.jit import by_reference, called_kernel, entry_kernel, kernel
from meal_bayes.planners.momdp_arrays import MOMDPArrays, paid_share
from meal_bayes.planners.plans.bayes_error import (
    SPAN,
    Scratch,
    log_odds,
    make_scratch,
    mean_reward,
    plan_error,
    plan_rates,
    threshold_below,
)

_paid_share = kernel(paid_share)

COMPUTED = 6  # largest number of computed plans for each first behavior at one belief
_ROUNDS = 3  # rounds in which the thresholds of a yes-or-no question are improved

PLAN = np.dtype([
    ("action", np.int64),  # first behavior
    ("cost", np.float64),  # s, discounted
    ("discount", np.float64),  # factor on the value of the report
    ("lost", np.float64),  # discounted Pr(the plan cannot continue); the robot then answers at once
    ("end", np.int64),  # x at the end, along the most probable outcomes
], align=True)  # fmt: skip


@by_reference
class Plans(NamedTuple):
    """Open-loop plans, grouped by the x in which they begin."""

    first: Ints  # (X+1,) plans of x are first[x] : first[x+1]
    plan: NDArray[np.void]  # (J,) records of `PLAN`
    observation_counts: Ints  # (J,E) numbers of percepts
    expected_percepts: Floats  # (J,E) discounted expected numbers of percepts, for bonuses
    row: Ints  # (J,N) rows of the table
    table: Floats  # (T,G,C) Pr(error | latent class) at thresholds, see `tabulate_errors`;
    # for yes-or-no questions, Pr(says yes | latent class)


@by_reference
class Evaluator(NamedTuple):
    """The inputs and buffers of the kernels that compute values of plans."""

    model: MOMDPArrays
    plans: Plans
    scratch: Scratch


class BestPlans(NamedTuple):
    """The best plan of each first behavior at some beliefs; the value is -inf if there is none."""

    value: Floats  # (B,E)
    plan: Ints  # (B,E)


def make_evaluator(model: MOMDPArrays, plans: Plans) -> Evaluator:
    """Create an evaluator without percepts so far."""
    most = int(np.diff(plans.first).max())
    return Evaluator(model, plans, make_scratch(model.percepts, most, len(plans.table)))


@kernel
def true_chance(percepts, prob, i):
    """Compute Pr(attribute i is true) from Pr(latent class) (N,C)."""
    total = 0.0
    for c in range(prob.shape[1]):
        total += prob[i, c] * percepts.truth_of_class[i, 1, c]
    return total


@kernel
def _yes_or_no_value(conjunction, holds):
    """Compute the value of the best of assertion and denial at Pr(all literals hold)."""
    affirm = mean_reward(conjunction.wrong_assertion, conjunction.assertion_gain, holds)
    deny = mean_reward(conjunction.wrong_denial, conjunction.denial_gain, 1.0 - holds)
    return max(affirm, deny)


@called_kernel
def stop_value(model, conjunction, prob):
    """Compute the value of answering now: that of the best report, or of abstaining."""
    if conjunction is not None:
        holds = 1.0
        for i in range(prob.shape[0]):
            b = true_chance(model.percepts, prob, i)
            holds *= b if conjunction.literal[i] else 1.0 - b
        return max(_yes_or_no_value(conjunction, holds), model.dynamics.exit_value)
    right = 1.0
    for i in range(prob.shape[0]):
        b = true_chance(model.percepts, prob, i)
        # A report is right if all attributes are (Eq. 5), so Pr(right) is a product.
        right *= max(b, 1.0 - b)
    report = mean_reward(model.incorrect, model.reward_range, right)
    return max(report, model.dynamics.exit_value)


@kernel
def _lost_value(evaluator, conjunction, prob):
    """Return the value of answering at the current belief, for plans that cannot continue."""
    lost = evaluator.scratch.lost
    if lost[0] == np.inf:  # computed once for all plans at a belief
        lost[0] = stop_value(evaluator.model, conjunction, prob)
    return lost[0]


@kernel
def _bonus(evaluator, j):
    """Compute the discounted exploration bonus of a plan."""
    model = evaluator.model
    plans = evaluator.plans
    scratch = evaluator.scratch
    total = 0.0
    for e in range(plans.observation_counts.shape[1]):
        counts = plans.observation_counts[j, e]
        if counts > 0:
            fraction = _paid_share(model.bonus_limit[e], scratch.evidence.total[e], counts)
            for i in range(scratch.chance.shape[0]):
                b = scratch.chance[i]
                mean = b * model.bonus[i, e, 1] + (1.0 - b) * model.bonus[i, e, 0]
                total += fraction * plans.expected_percepts[j, e] * mean
    return total


@kernel
def _threshold_error(table, t, g, prob, i):
    """Compute the error of deciding by threshold g: sum_c Pr(c) Pr(error | c)."""
    error = 0.0
    for c in range(table.shape[2]):
        error += prob[i, c] * table[t, g, c]
    return error


@kernel
def _table_error(evaluator, t, prob, i):
    """Return the error at the best threshold; with several classes, at a local minimum."""
    table = evaluator.plans.table
    scratch = evaluator.scratch
    thresholds = table.shape[1]
    # If the class is the truth, the Bayes rule is between the two thresholds next to the log-odds.
    # The better of the two is used, because interpolation would not give a bound.
    g = scratch.threshold[i]
    risk = _threshold_error(table, t, g, prob, i)
    beside = _threshold_error(table, t, g + 1, prob, i)
    # Otherwise the best threshold is probably close to that of the last plan: descend from there.
    if not evaluator.model.percepts.class_is_truth:
        step = 1 if beside < risk else -1
        if beside < risk:
            risk = beside
            g += 1
        while 0 <= g + step < thresholds:
            beside = _threshold_error(table, t, g + step, prob, i)
            if beside >= risk:
                break
            risk = beside
            g += step
        scratch.threshold[i] = min(g, thresholds - 2)
        beside = risk
    return min(risk, beside, scratch.chance[i], 1.0 - scratch.chance[i])


# --- The end of a plan for a yes-or-no question


@kernel
def _as_literal(conjunction, i, scratch):
    """Convert Pr(says yes, truth) of attribute i to Pr(literal accepted, truth of the literal)."""
    if not conjunction.literal[i]:
        b = scratch.chance[i]
        false = scratch.accepted[0, i]
        true = scratch.accepted[1, i]
        scratch.accepted[0, i] = b - true
        scratch.accepted[1, i] = 1.0 - b - false


@kernel
def _score(evaluator, t, g, prob, i, weights):
    """Return the score of threshold g for attribute i: weights[1] hits - weights[0] false alarms.

    Pr(literal accepted, truth of the literal) is written to column i of `accepted`.
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
    """Choose the threshold with the best `_score`, or accept the literal always or never."""
    literal = evaluator.model.conjunction.literal[i]
    exact_rule = evaluator.model.percepts.class_is_truth
    accepted = evaluator.scratch.accepted
    thresholds = evaluator.plans.table.shape[1]
    b = evaluator.scratch.chance[i]
    q = b if literal else 1.0 - b
    # The score of accepting the literal always: hits q and false alarms 1 - q.
    always = weights[1] * q - weights[0] * (1.0 - q)
    best = 0.0
    if weights[1] > 0.0:
        # Yes if Pr(z | true) / Pr(z | false) times these odds exceeds 1.
        ratio = np.log((weights[1] + 1e-300) / (weights[0] + 1e-300))
        odds = log_odds(b) + (ratio if literal else -ratio)
        g = threshold_below(min(max(odds, -SPAN), SPAN), thresholds)
        best = _score(evaluator, t, g, prob, i, weights)
        beside = _score(evaluator, t, g + 1, prob, i, weights)
        step = 1 if beside > best else -1
        if beside > best:
            best = beside
            g += 1
        # If both truths share classes, the best threshold may be further away.
        while not exact_rule and 0 <= g + step < thresholds:
            beside = _score(evaluator, t, g + step, prob, i, weights)
            if beside <= best:
                break
            best = beside
            g += step
        _score(evaluator, t, g, prob, i, weights)  # writes the best rates to `accepted`
    if always >= max(best, 0.0):
        accepted[0, i] = 1.0 - q
        accepted[1, i] = q
    elif best <= 0.0:
        accepted[0, i] = 0.0
        accepted[1, i] = 0.0


@called_kernel
def _compute_literal(evaluator, j, prob, i, weights, first):
    """Like `_decide_literal`, but by enumeration; in the first round, once for each table row."""
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
def _planned_yes_or_no(evaluator, j, prob, floor, enumerated):
    """Compute the expected reward of the answer at the end of a plan, by tables or enumeration.

    If it cannot exceed `floor`, any value of at most `floor` is returned; see `_plan_value`.
    """
    conjunction = evaluator.model.conjunction
    accepted = evaluator.scratch.accepted
    n = prob.shape[0]
    holds = 1.0
    for i in range(n):
        b = evaluator.scratch.chance[i]
        holds *= b if conjunction.literal[i] else 1.0 - b
    # The gain of an assertion over a denial if it is right, and the loss if it is wrong.
    gain = conjunction.gain
    loss = conjunction.loss
    deny = mean_reward(conjunction.wrong_denial, conjunction.denial_gain, 1.0 - holds)
    if deny + gain * holds <= floor:  # the value with perfect percepts
        return deny + gain * holds
    for turn in range(_ROUNDS):
        for i in range(n):
            # The rates of the other literals; in the first round, they are treated as known.
            hits = 1.0
            asserts = 1.0
            for k in range(n if turn > 0 else 0):
                if k != i:
                    hits *= accepted[1, k]
                    asserts *= accepted[0, k] + accepted[1, k]
            # gain hits h - loss (asserts (h + f) - hits h): the weights of h and f.
            weights = (loss * asserts, (gain + loss) * hits - loss * asserts)
            if enumerated:
                _compute_literal(evaluator, j, prob, i, weights, turn == 0)
            else:
                _decide_literal(evaluator, evaluator.plans.row[j, i], prob, i, weights)
    # E[reward] = deny + gain Pr(assert, right) - loss Pr(assert, wrong); or always assert.
    right = 1.0
    asserted = 1.0
    for i in range(n):
        right *= accepted[1, i]
        asserted *= accepted[0, i] + accepted[1, i]
    best = max(gain * right - loss * (asserted - right), gain * holds - loss * (1.0 - holds))
    return deny + max(best, 0.0)


# --- Plans


@kernel
def _plan_value(evaluator, conjunction, j, prob, floor, enumerated, shared):
    """Compute the value of a plan, by tables or by enumerating the outcomes of its percepts.

    If the value cannot exceed `floor`, any value of at most `floor` is returned. `conjunction` is
    that of the model; if it is None, the kernels of yes-or-no questions are not compiled.
    """
    model = evaluator.model
    plans = evaluator.plans
    scratch = evaluator.scratch
    # V = bonus - c + lost S + g `mean_reward` = base + reward, which decreases with each attribute:
    # base = bonus - c + lost S + g r-, and reward = g (r+ - r-) prod_i (1 - err_i) so far.
    plan = plans.plan[j]
    if conjunction is not None:
        pay = -plan.cost
        if plan.lost > 0.0:
            pay += plan.lost * _lost_value(evaluator, conjunction, prob)
        if model.shaped:
            pay += _bonus(evaluator, j)
        # V = pay + g V_end <= floor, solved for V_end.
        least = (floor - pay) / plan.discount if floor > -np.inf else -np.inf
        return pay + plan.discount * _planned_yes_or_no(evaluator, j, prob, least, enumerated)
    base = plan.discount * model.incorrect - plan.cost
    reward = plan.discount * model.reward_range
    if plan.lost > 0.0:
        base += plan.lost * _lost_value(evaluator, conjunction, prob)
    if model.shaped:
        base += _bonus(evaluator, j)
    for i in range(prob.shape[0]):
        if base + reward <= floor:
            break
        t = plans.row[j, i]
        z = scratch.column[i]
        if not enumerated:
            # Read once for all siblings with the same belief, if it does not depend on the plan.
            if not (shared and model.percepts.class_is_truth):
                error = _table_error(evaluator, t, prob, i)
            else:
                if scratch.tabled[t, z] < 0.0:
                    scratch.tabled[t, z] = _table_error(evaluator, t, prob, i)
                error = scratch.tabled[t, z]
        else:  # computed once for all plans and beliefs that share the row
            if scratch.error[t, z] < 0.0:
                counts = plans.observation_counts[j]
                scratch.error[t, z] = plan_error(model.percepts, counts, i, prob, scratch)
            error = scratch.error[t, z]
        reward *= 1.0 - error
    return base + reward


@kernel
def _is_tabled(evaluator, j):
    """Return whether the tables are valid for a plan: its percepts are new or have known rows."""
    percepts = evaluator.model.percepts
    total = evaluator.scratch.evidence.total
    for e in range(total.shape[0]):
        counts = evaluator.plans.observation_counts[j, e]
        # Percepts of an unknown row are exchangeable and not independent, so earlier ones matter.
        if counts > 0 and not percepts.rows_known[e] and total[e] > 0.0:
            return False
        if counts > percepts.limit[e] - total[e]:
            return False
    return True


@kernel
def _locate(evaluator, prob):
    """Compute the probability of each attribute, and the threshold next to its log-odds."""
    scratch = evaluator.scratch
    thresholds = evaluator.plans.table.shape[1]
    for i in range(prob.shape[0]):
        b = true_chance(evaluator.model.percepts, prob, i)
        scratch.chance[i] = b
        scratch.threshold[i] = threshold_below(log_odds(b), thresholds)


@kernel
def is_useless(model, x, a, total):
    """Return whether a behavior is useless: no other x, no informative percept, no bonus."""
    if model.dynamics.step[x, a].moves or (model.shaped and total[a] < model.bonus_limit[a]):
        return False
    if total[a] >= model.percepts.limit[a]:
        return True
    for i in range(model.percepts.informative.shape[0]):
        if model.percepts.informative[i, a]:
            return False
    return True


@kernel
def _most_promising(guess, count):
    """Return the plan with the highest tabulated value among those that must be computed."""
    top = 0
    for j in range(1, count):
        if guess[j] > guess[top]:
            top = j
    return top


@called_kernel
def evaluate_plans(evaluator, x, prob, floor, drop_useless):
    """Compute the values of the best plans from x by first behavior; return the best value.

    Values are written to `scratch.value`, the plans to `scratch.best`, and the exploration bonuses
    in the values to `scratch.bonus`; `scratch.evidence` contains the percepts so far. Plans for
    which the tables are not valid are computed in the order of their tabulated values, which are
    nearly always too high. At most COMPUTED plans of each behavior are computed; leaving out others
    keeps a lower bound.

    A finite `floor`, as in a leaf of a tree, means that only the best of all plans is needed; the
    floor is returned if no plan is better. Then a plan is abandoned if it cannot exceed the best
    value so far, and errors that were computed before are used again: the belief about an attribute
    is the same for equal `scratch.column`.

    With `drop_useless`, for decisions of a robot, useless behaviors have the value -inf. Because of
    numerical differences between a plan and its rest, a useless behavior might seem better, and the
    robot would repeat it forever. Then the best plans with more than two levels of percepts are
    computed too, because many of their outcomes are between the thresholds of the tables.
    """
    plans = evaluator.plans
    scratch = evaluator.scratch
    out = scratch.value
    _locate(evaluator, prob)
    scratch.lost[0] = np.inf  # not computed yet
    best_only = floor > -np.inf
    graded = drop_useless and evaluator.model.percepts.rows.shape[3] > 2
    best = floor
    if not best_only:
        scratch.error[:] = -1.0
    out[:] = -np.inf
    scratch.computed[:] = 0
    scratch.best[:] = -1
    # The first half of the turns reads the tables. The second half computes other plans, in order
    # of their tabulated values. There is one loop, so that `_plan_value` is compiled once.
    start = plans.first[x]
    count = plans.first[x + 1] - start
    for turn in range(2 * count):
        j = start + turn
        enumerated = turn >= count
        if enumerated:
            top = _most_promising(scratch.guess, count)
            guess = scratch.guess[top]
            j = start + top
            if guess == -np.inf or (best_only and guess <= best):
                break
            scratch.guess[top] = -np.inf
        # Skip a plan whose tabulated value is not above the best value of its first behavior.
        a = plans.plan[j].action
        if enumerated:
            if guess <= out[a] or scratch.computed[a] >= COMPUTED:
                continue
            scratch.computed[a] += 1
        # A plan that cannot exceed this value is abandoned.
        lowest = best if best_only else out[a]
        value = _plan_value(
            evaluator, evaluator.model.conjunction, j, prob, lowest, enumerated, best_only
        )
        if enumerated and graded and _is_tabled(evaluator, j):  # both are lower bounds
            value = max(value, guess)
        promising = value > lowest
        waits = promising and not enumerated and (graded or not _is_tabled(evaluator, j))
        if not enumerated:
            scratch.guess[turn] = value if waits else -np.inf
        if promising and not waits:
            out[a] = value
            scratch.best[a] = j
            best = max(best, value)
    # The exploration bonus in the value; the rest is the reward of this trial.
    scratch.bonus[:] = 0.0
    if evaluator.model.shaped:
        for a in range(out.shape[0]):
            if scratch.best[a] >= 0:
                scratch.bonus[a] = _bonus(evaluator, scratch.best[a])
    if drop_useless:
        for a in range(out.shape[0]):
            if is_useless(evaluator.model, x, a, scratch.evidence.total):
                out[a] = -np.inf
    return best


@entry_kernel
def _value_at_beliefs(evaluator, x, beliefs, drop_useless, value, plan):
    """Compute the best plan of each first behavior at beliefs (B,N,C) -> value, plan (B,E)."""
    for b in range(beliefs.shape[0]):
        evaluate_plans(evaluator, x, beliefs[b], -np.inf, drop_useless)
        for a in range(value.shape[1]):
            value[b, a] = evaluator.scratch.value[a]
            plan[b, a] = evaluator.scratch.best[a]


def best_plans(
    evaluator: Evaluator, x: int, beliefs: Floats, *, drop_useless: bool = False
) -> BestPlans:
    """Compute the best plan of each first behavior from x at beliefs (B,N,C).

    See `evaluate_plans`; the evaluator then contains the values at the last belief.
    """
    shape = len(beliefs), len(evaluator.scratch.value)
    best = BestPlans(value=np.empty(shape), plan=np.empty(shape, np.int64))
    _value_at_beliefs(evaluator, x, beliefs, drop_useless, *best)
    return best


def plan_values(model: MOMDPArrays, plans: Plans, belief: Belief) -> Evaluator:
    """Return an evaluator whose `scratch.value` (E,) has the best plan of each first behavior."""
    evaluator = make_evaluator(model, plans)
    evidence = evaluator.scratch.evidence
    evidence.counts[:] = belief.percept_counts
    evidence.total[:] = belief.shown
    best_plans(evaluator, belief.x, np.exp(belief.log_prob)[None], drop_useless=True)
    return evaluator

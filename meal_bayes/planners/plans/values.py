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

COMPUTED = 6  # plans of a first behavior that are computed at one belief, at most
_ROUNDS = 3  # in which the thresholds of a question of yes or no are improved

PLAN = np.dtype([
    ("action", np.int64),  # first behavior
    ("cost", np.float64),  # s, discounted
    ("discount", np.float64),  # factor on the report's value
    ("lost", np.float64),  # discounted Pr(it ends off its path, with an answer at once)
    ("end", np.int64),  # x in which it ends, along the likeliest outcomes
], align=True)  # fmt: skip


@by_reference
class Plans(NamedTuple):
    """Open-loop plans, grouped by the x they start from."""

    first: Ints  # (X+1,) plans of x are first[x] : first[x+1]
    plan: NDArray[np.void]  # (J,) records of `PLAN`
    observation_counts: Ints  # (J,E) percepts gathered
    expected_percepts: Floats  # (J,E) discounted: what a bonus pays for
    row: Ints  # (J,N) of the table
    table: Floats  # (T,G,C) Pr(error | latent class) at thresholds, see `tabulate_errors`;
    # of yes or no, Pr(says yes | latent class)


@by_reference
class Evaluator(NamedTuple):
    """All that valuing plans reads and writes."""

    model: MOMDPArrays
    plans: Plans
    scratch: Scratch


class BestPlans(NamedTuple):
    """The best plan of each first behavior at some beliefs; value -inf where there is none."""

    value: Floats  # (B,E)
    plan: Ints  # (B,E)


def make_evaluator(model: MOMDPArrays, plans: Plans) -> Evaluator:
    """Create the buffers for valuing plans; no percepts so far."""
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
    """Compute the value of ending now: of the best report or of the exit."""
    if conjunction is not None:
        holds = 1.0
        for i in range(prob.shape[0]):
            b = true_chance(model.percepts, prob, i)
            holds *= b if conjunction.literal[i] else 1.0 - b
        return max(_yes_or_no_value(conjunction, holds), model.dynamics.exit_value)
    right = 1.0
    for i in range(prob.shape[0]):
        b = true_chance(model.percepts, prob, i)
        # Eq. 5 asks for all attributes: Pr(right) is the product of the likelier values'.
        right *= max(b, 1.0 - b)
    report = mean_reward(model.incorrect, model.reward_range, right)
    return max(report, model.dynamics.exit_value)


@kernel
def _lost_value(evaluator, conjunction, prob):
    """Compute what an answer at once is worth, by the belief of now, where a plan gets lost."""
    lost = evaluator.scratch.lost
    if lost[0] == np.inf:  # once for all plans at a belief
        lost[0] = stop_value(evaluator.model, conjunction, prob)
    return lost[0]


@kernel
def _bonus(evaluator, j):
    """Sum what shaping pays along a plan, discounted."""
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
    """Return the error at the best threshold; if class is not truth, near the last best one."""
    table = evaluator.plans.table
    scratch = evaluator.scratch
    thresholds = table.shape[1]
    # Where the class is the truth, the Bayes rule is a threshold next to the log-odds: the better
    # of both stands, as what lies between them is no bound.
    g = scratch.threshold[i]
    risk = _threshold_error(table, t, g, prob, i)
    beside = _threshold_error(table, t, g + 1, prob, i)
    # Elsewhere it lies anywhere, but near to that of the last plan: go down the slope from there.
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


# --- The end of a plan of yes or no


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
        _score(evaluator, t, g, prob, i, weights)  # leaves the best one's rates in `accepted`
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
def _planned_yes_or_no(evaluator, j, prob, floor, enumerated):
    """Compute the reward expected at the end of a plan; at most `floor` if it cannot beat that.

    By tables, or `enumerated`; see `_plan_value`.
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


# --- Plans


@kernel
def _plan_value(evaluator, conjunction, j, prob, floor, enumerated, shared):
    """Compute a plan's value by tables, or by its percepts; at most `floor` if it cannot beat that.

    Where `enumerated`, the outcomes of its percepts are, after those of the trial so far.
    `conjunction` is the model's; where it is None, kernels of yes or no are not compiled.
    """
    model = evaluator.model
    plans = evaluator.plans
    scratch = evaluator.scratch
    # V = bonus - c + lost S + g `mean_reward` = base + reward, which falls with every attribute:
    # base = bonus - c + lost S + g r-, and reward = g (r+ - r-) prod_i (1 - err_i) so far.
    plan = plans.plan[j]
    if conjunction is not None:
        pay = -plan.cost
        if plan.lost > 0.0:
            pay += plan.lost * _lost_value(evaluator, conjunction, prob)
        if model.shaped:
            pay += _bonus(evaluator, j)
        # V = pay + g V_end <= floor, solved for V_end: below it thresholds need not be improved.
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
            # Read once for all siblings that share a belief; elsewhere it hangs on the last plan.
            if not (shared and model.percepts.class_is_truth):
                error = _table_error(evaluator, t, prob, i)
            else:
                if scratch.tabled[t, z] < 0.0:
                    scratch.tabled[t, z] = _table_error(evaluator, t, prob, i)
                error = scratch.tabled[t, z]
        else:  # once for all plans and beliefs that share the row
            if scratch.error[t, z] < 0.0:
                counts = plans.observation_counts[j]
                scratch.error[t, z] = plan_error(model.percepts, counts, i, prob, scratch)
            error = scratch.error[t, z]
        reward *= 1.0 - error
    return base + reward


@kernel
def _is_tabled(evaluator, j):
    """Test whether the tables hold a plan: its percepts are new, or of known rows."""
    percepts = evaluator.model.percepts
    total = evaluator.scratch.evidence.total
    for e in range(total.shape[0]):
        counts = evaluator.plans.observation_counts[j, e]
        # Percepts of a row that is not known are exchangeable, not independent: earlier ones count.
        if counts > 0 and not percepts.rows_known[e] and total[e] > 0.0:
            return False
        if counts > percepts.limit[e] - total[e]:
            return False
    return True


@kernel
def _locate(evaluator, prob):
    """Find each attribute's chance, and the threshold next to its log-odds."""
    scratch = evaluator.scratch
    thresholds = evaluator.plans.table.shape[1]
    for i in range(prob.shape[0]):
        b = true_chance(evaluator.model.percepts, prob, i)
        scratch.chance[i] = b
        scratch.threshold[i] = threshold_below(log_odds(b), thresholds)


@kernel
def is_useless(model, x, a, total):
    """Test whether a behavior cannot help: no other x, no informative percept, no bonus."""
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
    """Return the plan whose tabulated value is highest among those that must be computed."""
    top = 0
    for j in range(1, count):
        if guess[j] > guess[top]:
            top = j
    return top


@called_kernel
def evaluate_plans(evaluator, x, prob, floor, drop_useless):
    """Value the best plan from x by first behavior -> `scratch.value`; return the best value.

    `scratch.best` holds the plans, `scratch.bonus` what of their values shaping pays;
    `scratch.evidence` are the percepts so far. Plans that the tables do not hold are computed in
    the order of their tabulated values, which are nearly always too high, COMPUTED a behavior: to
    leave some out keeps a lower bound.

    A finite `floor`, as a leaf of a tree has it, asks for the best of all plans alone, where it is
    worth more; the floor is returned where none is. Then plans are cut short at the best so far in
    place of the best of their first behavior, and errors computed before are used: an attribute's
    belief is the same after equal `scratch.column`.

    With `drop_useless`, as where a robot decides, behaviors that cannot help have the value -inf.
    Their plans, computed in other ways than what remains of them, may seem worth more; a robot
    would follow them for ever. Then the best plans of graded percepts are computed, too: their many
    outcomes fall between the thresholds of the tables.
    """
    plans = evaluator.plans
    scratch = evaluator.scratch
    out = scratch.value
    _locate(evaluator, prob)
    scratch.lost[0] = np.inf  # not computed
    best_only = floor > -np.inf
    graded = drop_useless and evaluator.model.percepts.rows.shape[3] > 2
    best = floor
    if not best_only:
        scratch.error[:] = -1.0
    out[:] = -np.inf
    scratch.computed[:] = 0
    scratch.best[:] = -1
    # The first round reads the tables, the second computes what they do not hold, best guess first;
    # in one loop, so that the code of a plan's value is compiled once.
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
        # A plan whose guess is no better than what its first behavior has got is not computed.
        a = plans.plan[j].action
        if enumerated:
            if guess <= out[a] or scratch.computed[a] >= COMPUTED:
                continue
            scratch.computed[a] += 1
        # A plan that cannot beat this is cut short.
        lowest = best if best_only else out[a]
        value = _plan_value(
            evaluator, evaluator.model.conjunction, j, prob, lowest, enumerated, best_only
        )
        if enumerated and graded and _is_tabled(evaluator, j):  # both are bounds from below
            value = max(value, guess)
        promising = value > lowest
        waits = promising and not enumerated and (graded or not _is_tabled(evaluator, j))
        if not enumerated:
            scratch.guess[turn] = value if waits else -np.inf
        if promising and not waits:
            out[a] = value
            scratch.best[a] = j
            best = max(best, value)
    # Of the sum, what is paid for exploring on the way; the rest is what the answer brings.
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
    """Value the best plan of each first behavior at beliefs (B,N,C) -> value, plan (B,E)."""
    for b in range(beliefs.shape[0]):
        evaluate_plans(evaluator, x, beliefs[b], -np.inf, drop_useless)
        for a in range(value.shape[1]):
            value[b, a] = evaluator.scratch.value[a]
            plan[b, a] = evaluator.scratch.best[a]


def best_plans(
    evaluator: Evaluator, x: int, beliefs: Floats, *, drop_useless: bool = False
) -> BestPlans:
    """Value the best plan of each first behavior from x at beliefs (B,N,C).

    See `evaluate_plans`; the evaluator holds the values at the last belief.
    """
    shape = len(beliefs), len(evaluator.scratch.value)
    best = BestPlans(value=np.empty(shape), plan=np.empty(shape, np.int64))
    _value_at_beliefs(evaluator, x, beliefs, drop_useless, *best)
    return best


def plan_values(model: MOMDPArrays, plans: Plans, belief: Belief) -> Evaluator:
    """Value the best plan of each first behavior -> `scratch.value` (E,) of the evaluator."""
    evaluator = make_evaluator(model, plans)
    evidence = evaluator.scratch.evidence
    evidence.counts[:] = belief.percept_counts
    evidence.total[:] = belief.shown
    best_plans(evaluator, belief.x, np.exp(belief.log_prob)[None], drop_useless=True)
    return evaluator

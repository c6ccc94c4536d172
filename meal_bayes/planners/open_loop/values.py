"""Kernels of the value of open-loop plans: a lower bound on the optimum from any belief.

A plan is worth -sum_k (prod_{j<k} g_j) c_k + (prod_k g_k) [r- + (r+ - r-) prod_i (1 - err_i)], and
what shaping pays on the way. Errors come from tables where the plan's behaviors have shown nothing
yet (or their rows are known), and are computed otherwise.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import Belief
from meal_bayes.planners.compiled import Compiled, Percepts
from meal_bayes.planners.kernels import called_kernel, entry_kernel, kernel
from meal_bayes.planners.open_loop.errors import SPAN, Scratch, make_scratch, plan_error

COMPUTED = 6  # plans of a first behavior that are computed at one belief, at most

PLAN = np.dtype([
    ("action", np.int64),  # first behavior
    ("cost", np.float64),  # s, discounted
    ("discount", np.float64),  # factor on the report's value
], align=True)  # fmt: skip


class Plans(NamedTuple):
    """Open-loop plans, grouped by the x they start from."""

    first: Ints  # (X+1,) plans of x are first[x] : first[x+1]
    plan: NDArray[np.void]  # (J,) records of `PLAN`
    observation_counts: Ints  # (J,E) percepts gathered
    executions: Floats  # (J,E) discounted expected executions, for shaping
    row: Ints  # (J,N) of the table
    table: Floats  # (T,G,C) Pr(error | latent class) at thresholds, see `tabulate_errors`


def plan_scratch(percepts: Percepts, plans: Plans) -> Scratch:
    """Create the buffers for evaluating plans; no percepts so far."""
    return make_scratch(percepts, int(np.diff(plans.first).max()), len(plans.table))


def plan_values(problem: Compiled, plans: Plans, belief: Belief) -> Scratch:
    """Evaluate the best plan of each first behavior -> `value` (E,) of the returned buffers."""
    scratch = plan_scratch(problem.percepts, plans)
    scratch.counts[:] = belief.percept_counts
    scratch.total[:] = belief.percept_counts[0].sum(axis=1)
    best_plans(problem, plans, belief.x, np.exp(belief.log_prob)[None], scratch, True)
    return scratch


def best_plans(
    problem: Compiled, plans: Plans, x: int, beliefs: Floats, scratch: Scratch, useful: bool = False
) -> tuple[Floats, Ints]:
    """Evaluate the best plan of each first behavior at beliefs (B,N,C) -> values and plans (B,E).

    See `evaluate_plans`; `scratch` holds what was found at the last belief.
    """
    shape = len(beliefs), len(scratch.value)
    value, best = np.empty(shape), np.empty(shape, np.int64)
    _best_plans(problem, plans, x, beliefs, scratch, useful, value, best)
    return value, best


@kernel
def true_chance(percepts, prob, i):
    """Compute Pr(attribute i is true) from Pr(latent class) (N,C)."""
    total = 0.0
    for c in range(prob.shape[1]):
        total += prob[i, c] * percepts.truth[i, 1, c]
    return total


@kernel
def stop_value(model, prob):
    """Compute the value of ending now: of the most probable report or of the exit."""
    right = 1.0
    for i in range(prob.shape[0]):
        b = true_chance(model.percepts, prob, i)
        right *= max(b, 1.0 - b)
    return max(model.incorrect + model.gap * right, model.dynamics.exit_value)


@kernel
def _bonus(model, plans, j, scratch):
    """Sum what shaping pays along a plan, discounted."""
    total = 0.0
    for e in range(plans.observation_counts.shape[1]):
        counts = plans.observation_counts[j, e]
        if counts > 0:
            paid = min(1.0, max(0.0, model.paid[e] - scratch.total[e]) / counts)
            for i in range(scratch.chance.shape[0]):
                b = scratch.chance[i]
                mean = b * model.bonus[i, e, 1] + (1.0 - b) * model.bonus[i, e, 0]
                total += paid * plans.executions[j, e] * mean
    return total


@kernel
def _threshold_error(table, t, g, prob, i):
    error = 0.0
    for c in range(table.shape[2]):
        error += prob[i, c] * table[t, g, c]
    return error


@kernel
def _table_error(model, table, t, prob, i, scratch):
    """Return the error at the best threshold; if class is not truth, near the last one found."""
    g, thresholds = scratch.threshold[i], table.shape[1]
    risk, above = _threshold_error(table, t, g, prob, i), _threshold_error(table, t, g + 1, prob, i)
    if not model.percepts.class_is_truth:  # else the best rule is next to the log-odds
        step = 1 if above < risk else -1
        if above < risk:
            risk, g = above, g + 1
        while 0 <= g + step < thresholds:
            above = _threshold_error(table, t, g + step, prob, i)
            if above >= risk:
                break
            risk, g = above, g + step
        scratch.threshold[i] = min(g, thresholds - 2)
        above = risk
    return min(risk, above, scratch.chance[i], 1.0 - scratch.chance[i])


@kernel
def _plan_value(model, plans, j, prob, scratch, floor, exact):
    """Compute a plan's value by the tables, or exactly; at most `floor` if it cannot beat that."""
    plan, percepts = plans.plan[j], model.percepts
    base, reward = plan.discount * model.incorrect - plan.cost, plan.discount * model.gap
    if model.shaped:
        base += _bonus(model, plans, j, scratch)
    for i in range(prob.shape[0]):  # base + reward prod_i (1 - err_i) falls with every attribute
        if base + reward <= floor:
            break
        t, z = plans.row[j, i], scratch.shown[i]
        if not exact:
            error = _table_error(model, plans.table, t, prob, i, scratch)
        else:  # once for all plans and beliefs that share the row
            if scratch.error[t, z] < 0.0:
                counts = plans.observation_counts
                scratch.error[t, z] = plan_error(percepts, counts, j, i, prob, scratch)
            error = scratch.error[t, z]
        reward *= 1.0 - error
    return base + reward


@kernel
def _is_tabled(percepts, plans, j, scratch):
    """Test whether the tables hold a plan: its percepts are new, or of known rows."""
    for e in range(plans.observation_counts.shape[1]):
        counts = plans.observation_counts[j, e]
        if counts > 0 and not percepts.known[e] and scratch.total[e] > 0.0:
            return False
        if counts > percepts.limit[e] - scratch.total[e]:
            return False
    return True


@kernel
def _locate(model, plans, prob, scratch):
    """Find each attribute's chance, and the threshold next to its log-odds."""
    thresholds = plans.table.shape[1]
    for i in range(prob.shape[0]):
        b = true_chance(model.percepts, prob, i)
        odds = np.log((b + 1e-300) / (1.0 - b + 1e-300))
        g = int((odds + SPAN) * ((thresholds - 1) / (2.0 * SPAN)))
        scratch.chance[i], scratch.threshold[i] = b, min(max(g, 0), thresholds - 2)


@kernel
def is_idle(model, x, a, total):
    """Test whether a behavior cannot help: no other x, no informative percept, no bonus."""
    if model.dynamics.step[x, a].moves or (model.shaped and total[a] < model.paid[a]):
        return False
    return total[a] >= model.percepts.limit[a] or not model.percepts.informative[:, a].any()


@called_kernel
def evaluate_plans(model, plans, x, prob, scratch, floor, useful):
    """Evaluate the best plan from x by first behavior -> `scratch.value`; return the best.

    `scratch.best` holds the plans; `scratch.counts` and `total` are the percepts so far. Above a
    `floor` of -inf only the best of all is sought, and `floor` returned where none exceeds it; then
    errors computed before are used: an attribute's belief is the same after equal `scratch.shown`.
    Plans that the tables do not hold are computed in the order of their tabulated values,
    which are nearly always too high, COMPUTED a behavior: to leave some out keeps a lower bound.

    With `useful`, behaviors that cannot help have the value -inf. Their plans, computed in other
    ways than what is left of them, may seem worth more; who followed them would go round for ever.
    """
    _locate(model, plans, prob, scratch)
    shared, best, out = floor > -np.inf, floor, scratch.value
    if not shared:
        scratch.error[:] = -1.0
    out[:], scratch.tried[:], scratch.best[:] = -np.inf, 0, -1
    start, count = plans.first[x], plans.first[x + 1] - plans.first[x]
    for turn in range(2 * count):
        j, exact = start + turn, turn >= count
        if exact:
            top = 0
            for other in range(1, count):
                if scratch.guess[other] > scratch.guess[top]:
                    top = other
            j, guess = start + top, scratch.guess[top]
            if guess == -np.inf or (shared and guess <= best):
                break
            scratch.guess[top] = -np.inf
        a = plans.plan[j].action
        if exact:
            if guess <= out[a] or scratch.tried[a] >= COMPUTED:
                continue
            scratch.tried[a] += 1
        lowest = best if shared else out[a]
        value = _plan_value(model, plans, j, prob, scratch, lowest, exact)
        waits = not exact and not _is_tabled(model.percepts, plans, j, scratch)
        if not exact:
            scratch.guess[turn] = value if waits else -np.inf
        if not waits and value > out[a]:
            out[a], scratch.best[a], best = value, j, max(best, value)
    for a in range(out.shape[0]):
        if useful and is_idle(model, x, a, scratch.total):
            out[a] = -np.inf
    return best


@entry_kernel
def _best_plans(model, plans, x, beliefs, scratch, useful, value, best):
    for b in range(beliefs.shape[0]):
        evaluate_plans(model, plans, x, beliefs[b], scratch, -np.inf, useful)
        for a in range(value.shape[1]):
            value[b, a], best[b, a] = scratch.value[a], scratch.best[a]

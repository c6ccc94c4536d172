"""Kernels of open-loop plans: their values, and how they are grown; the leaf of the tree search."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.kernels import entry_kernel, kernel
from meal_bayes.planners.open_loop.errors import (
    OUTCOMES,
    SPAN,
    Work,
    clear,
    plan_error,
    truth,
)

COMPUTED = 6  # plans of a first behavior that are computed exactly at one belief
DEPTH = 60  # steps of one descent


class Plans(NamedTuple):
    """Open-loop plans, grouped by the x they start from."""

    first: NDArray[np.int64]  # (X+1,) plans of x are first[x] : first[x+1]
    action: NDArray[np.int64]  # (J,) first behavior
    cost: NDArray[np.float64]  # (J,) discounted folded cost, s
    discount: NDArray[np.float64]  # (J,) factor on the report's value
    uses: NDArray[np.int64]  # (J,E) percepts gathered
    weight: NDArray[np.float64]  # (J,E) discounted expected executions, for shaping
    rule: NDArray[np.int64]  # (J,N) row of the table below
    errs: NDArray[np.float64]  # (G,T,C) Pr(error | kind) of decision rules


class Macros(NamedTuple):
    """Cheapest way from each x to a percept of each behavior, executed."""

    first: NDArray[np.int64]  # (X,E) first behavior, -1 where there is no way
    end: NDArray[np.int64]  # (X,E) x afterwards
    cost: NDArray[np.float64]  # (X,E) discounted folded cost, s
    uses: NDArray[np.int64]  # (X,E,E) percepts gathered on the way, the last included


@kernel
def _locate(problem, plans, weight, row, work):
    """Find each attribute's chance, and the rules next to its log-odds."""
    size = plans.errs.shape[0]
    for i in range(weight.shape[1]):
        b = truth(problem, weight, row, i)
        work.chance[i] = b
        odds = np.log((b + 1e-300) / (1.0 - b + 1e-300))
        work.cell[i] = int((odds + SPAN) * ((size - 1) / (2.0 * SPAN)))
        work.cell[i] = min(max(work.cell[i], 0), size - 2)


@kernel
def stop_value(problem, x, weight, row):
    """Value of ending now: the most probable report, or the exit where that is better."""
    n = weight.shape[1]
    product, mean = 1.0, 0.0
    for i in range(n):
        b = truth(problem, weight, row, i)
        product *= max(b, 1.0 - b)
        mean += max(b, 1.0 - b) / n
    share = mean if problem.additive else product
    value = problem.incorrect + (problem.correct - problem.incorrect) * share
    return max(value, problem.exit_value[x])


@kernel
def _rate(errs, t, g, weight, row, i):
    error = 0.0
    for c in range(errs.shape[2]):
        error += weight[row, i, c] * errs[g, t, c]
    return error


@kernel
def _rule_error(problem, errs, t, weight, row, i, work):
    """Error of the best rule near the last one found; where the kind is the truth, of the best."""
    g, size = work.cell[i], errs.shape[0]
    here, above = _rate(errs, t, g, weight, row, i), _rate(errs, t, g + 1, weight, row, i)
    if not problem.kind_is_truth:  # else the best rule is next to the log-odds
        step = 1 if above < here else -1
        if above < here:
            here, g = above, g + 1
        while 0 <= g + step < size:
            above = _rate(errs, t, g + step, weight, row, i)
            if above >= here:
                break
            here, g = above, g + step
        work.cell[i] = min(g, size - 2)
        above = here
    return min(here, above, work.chance[i], 1.0 - work.chance[i])


@kernel
def _tells(problem, plans, plan, work):
    """Tell if the tables hold this plan: what it perceives is new, or known to come as it does."""
    if problem.plain:
        return True
    for e in range(plans.uses.shape[1]):
        uses = plans.uses[plan, e]
        if uses > 0:
            seen = work.total[e]
            if uses > problem.limit[e] - seen or not (problem.exact[e] or seen == 0.0):
                return False
    return True


@kernel
def _plan_value(problem, plans, plan, tabled, weight, row, work, floor):
    """-sum_k (prod_{j<k} g_j) c_k + (prod_k g_k) [r- + (r+ - r-) share right].

    The share is prod_i (1 - err_i), or the mean where reports are paid by the attribute. Gives
    up, with a value of at most `floor`, as soon as `floor` cannot be beaten.
    """
    gap, g = problem.correct - problem.incorrect, plans.discount[plan]
    base, n = -plans.cost[plan] + g * problem.incorrect, weight.shape[1]
    if problem.shaped:
        base += _bonus(problem, plans, plan, work)
    right = 1.0
    for i in range(n):
        if base + g * gap * right <= floor:
            break
        if tabled:
            error = _rule_error(problem, plans.errs, plans.rule[plan, i], weight, row, i, work)
        else:
            error = plan_error(problem, plans.uses, plan, i, weight, row, work)
        right = right - error / n if problem.additive else right * (1.0 - error)
    return base + g * gap * right


@kernel
def _bonus(problem, plans, plan, work):
    total = 0.0
    for e in range(plans.uses.shape[1]):
        uses = plans.uses[plan, e]
        if uses > 0:
            share = min(1.0, max(0.0, problem.paid[e] - work.total[e]) / uses)
            for i in range(work.chance.shape[0]):
                b = work.chance[i]
                mean = b * problem.bonus[i, e, 1] + (1.0 - b) * problem.bonus[i, e, 0]
                total += share * plans.weight[plan, e] * mean
    return total


@kernel
def open_loop_value(problem, plans, x, weight, row, work, floor):
    """Value of the best plan from x, or `floor` if none is better; otherwise as below."""
    _locate(problem, plans, weight, row, work)
    start, end, best = plans.first[x], plans.first[x + 1], floor
    if start == end:
        return best
    for plan in range(start, end):
        known = _tells(problem, plans, plan, work)
        value = _plan_value(problem, plans, plan, True, weight, row, work, best)
        work.guess[plan - start] = -np.inf if known else value
        if known:
            best = max(best, value)
    for _ in range(2 * COMPUTED):
        top = _top_guess(work.guess, end - start)
        if work.guess[top] <= best:
            break
        work.guess[top] = -np.inf
        value = _plan_value(problem, plans, start + top, False, weight, row, work, best)
        best = max(best, value)
    return best


@kernel
def _top_guess(guess, size):
    top = 0
    for j in range(1, size):
        if guess[j] > guess[top]:
            top = j
    return top


@entry_kernel
def open_loop_values(problem, plans, x, weight, row, work, out):
    """Best value of the plans from x by first behavior -> out[row] (E,), -inf where none.

    Percepts seen are read from `work.yes` and `work.total`. Plans that the tables do not hold are
    computed in the order of what the tables say of them, which is nearly always too much, COMPUTED
    a behavior and while any seems better: to leave plans out keeps the value a lower bound.
    """
    _locate(problem, plans, weight, row, work)
    for a in range(out.shape[1]):
        out[row, a] = -np.inf
        work.computed[a] = 0
    start, end = plans.first[x], plans.first[x + 1]
    if start == end:
        return
    for plan in range(start, end):
        a = plans.action[plan]
        known = _tells(problem, plans, plan, work)
        value = _plan_value(problem, plans, plan, True, weight, row, work, out[row, a])
        work.guess[plan - start] = -np.inf if known else value
        if known:
            out[row, a] = max(out[row, a], value)
    while True:
        top = _top_guess(work.guess, end - start)
        if work.guess[top] == -np.inf:
            return
        a, guess = plans.action[start + top], work.guess[top]
        work.guess[top] = -np.inf
        if guess > out[row, a] and work.computed[a] < COMPUTED:
            work.computed[a] += 1
            value = _plan_value(problem, plans, start + top, False, weight, row, work, out[row, a])
            out[row, a] = max(out[row, a], value)


@entry_kernel
def plan_values(problem, plans, x, weight, work, out):
    """Value of each plan from x at beliefs (B,N,C) before any percept -> out (B,J)."""
    clear(work)
    for row in range(weight.shape[0]):
        _locate(problem, plans, weight, row, work)
        best = stop_value(problem, x, weight, row)
        for plan in range(plans.first[x], plans.first[x + 1]):
            value = _plan_value(problem, plans, plan, True, weight, row, work, best)
            out[row, plan] = value
            best = max(best, value)


@kernel
def _judge(problem, uses, which, weight, row):
    """Estimate the share right after percepts `uses[which]`: from the affinity of their counts.

    Percepts of affinity r = sum_z sqrt(p1 p0) leave an error of about
    (1 - sqrt(1 - 4 b (1 - b) r^2)) / 2, its lower bound; affinities multiply.
    """
    product, mean, n = 1.0, 0.0, weight.shape[1]
    last = problem.affinity.shape[2] - 1
    for i in range(n):
        log_r = 0.0
        for e in range(uses.shape[1]):
            k = uses[which, e]
            if k > 0 and problem.informative[i, e]:
                log_r += problem.affinity[i, e, min(k, last)] * max(1.0, k / last)
        b = truth(problem, weight, row, i)
        error = 0.5 - 0.5 * np.sqrt(max(0.0, 1.0 - 4.0 * b * (1.0 - b) * np.exp(2.0 * log_r)))
        product *= 1.0 - error
        mean += (1.0 - error) / n
    return mean if problem.additive else product


@entry_kernel
def grow_plans(problem, macros, x, weight, length, work, out):
    """Grow plans from x greedily, one for each belief (B,N,C) and first percept -> out (B*E,L).

    Rows hold the percepts gone for in order, padded by -1. Each step after the first goes to the
    percept (or two or three of it, where it repeats) that adds most log probability of a right
    report per second; to fix the first in turn keeps expensive beginnings in play. A plan is
    grown until it is more right than not and a step costs twice what it gains.
    """
    n, n_behaviors = problem.confusion.shape[0], problem.confusion.shape[1]
    uses, useful, gap = work.uses, work.useful, problem.correct - problem.incorrect
    clear(work)
    for e in range(n_behaviors):
        useful[e] = False
        for i in range(n):
            useful[e] = useful[e] or problem.informative[i, e]
    for plan in range(out.shape[0]):
        row, forced = plan // n_behaviors, plan % n_behaviors
        if macros.first[x, forced] < 0 or not useful[forced]:
            continue
        for e in range(n_behaviors):
            uses[0, e] = 0
        here, filled, right = x, 0, _judge(problem, uses, 0, weight, row)
        for step in range(length):
            best, best_e, best_k = 1e-12, forced if step == 0 else -1, 1
            for e in range(n_behaviors):
                if step == 0 or macros.first[here, e] < 0 or not useful[e]:
                    continue
                end = macros.end[here, e]
                repeats = 3 if macros.end[end, e] == end and macros.first[end, e] == e else 1
                for k in range(1, repeats + 1):
                    for other in range(n_behaviors):
                        uses[1, other] = uses[0, other] + macros.uses[here, e, other]
                    uses[1, e] += k - 1
                    if uses[1, e] > problem.limit[e]:
                        break
                    price = macros.cost[here, e] + (k - 1) * problem.cost[end, e]
                    gained = _judge(problem, uses, 1, weight, row)
                    rate = np.log(gained / right) / (price + 1e-6)
                    if rate > best:
                        best, best_e, best_k = rate, e, k
            if best_e < 0 or (right > 0.6 and best * gap * right < 0.5):  # noqa: PLR2004
                break
            for _ in range(best_k):
                if filled == out.shape[1]:
                    break
                out[plan, filled] = best_e
                filled += 1
                for other in range(n_behaviors):
                    uses[0, other] += macros.uses[here, best_e, other]
                here = macros.end[here, best_e]
            right = _judge(problem, uses, 0, weight, row)


def remember(work: Work, seen: NDArray[np.float64]) -> None:
    """Note the percepts seen, (N,E,K)."""
    work.seen[:] = seen
    work.yes[:] = seen[:, :, seen.shape[2] // 2 :].sum(axis=2)
    work.total[:] = seen[0].sum(axis=1)


def room_for(problem: Compiled, plans: Plans | None = None) -> Work:
    """Make the room that the kernels need for a MOMDP and its plans."""
    n, e, c, k = problem.confusion.shape
    held = OUTCOMES if plans is None else OUTCOMES // 4  # a library is made once, leaves often
    return Work(
        outcomes=np.empty((c, held)),
        counts=np.empty((c, held)),
        truths=np.empty((2, held)),
        yes=np.zeros((n, e)),
        total=np.zeros(e),
        seen=np.zeros((n, e, k)),
        weight=np.zeros((n, c)),
        chance=np.zeros(n),
        cell=np.zeros(n, np.int64),
        levels=np.zeros(n, np.int64),
        uses=np.zeros((2, e), np.int64),
        useful=np.zeros(e, np.bool_),
        guess=np.zeros(0 if plans is None else int(np.diff(plans.first).max())),
        computed=np.zeros(e, np.int64),
        path=np.zeros((DEPTH, 2), np.int64),
    )

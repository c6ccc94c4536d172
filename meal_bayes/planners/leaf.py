"""Kernels of open-loop plans: exact Bayes errors, plan values, growing plans.

The leaf of the tree search (`search.py`) and the plan library (`open_loop.py`) are made of these.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from numba import config, njit
from numpy.typing import NDArray

from meal_bayes.planners.compiled import Compiled

OUTCOMES = 512  # joint outcomes that the exact error of a plan may enumerate for one attribute
DEPTH = 60  # steps of one descent
SPAN = 16.0  # log-odds covered by the error tables


@contextmanager
def lightly_optimized() -> Iterator[None]:
    """Compile with less of LLVM's effort: half the time, and nothing here runs slower for it."""
    before = config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE
    config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE = 1, 0, 0
    try:
        yield
    finally:
        config.OPT, config.LOOP_VECTORIZE, config.SLP_VECTORIZE = before


# Nothing here allocates, so there are no references to count, half of what there would be to
# compile: callers bring the room (`Work`).
kernel = njit(cache=True, nogil=True, error_model="numpy", _nrt=False)


class Plans(NamedTuple):
    """Open-loop plans, grouped by the x they start from."""

    first: NDArray[np.int64]  # (X+1,) plans of x are first[x] : first[x+1]
    action: NDArray[np.int64]  # (J,) first behavior
    cost: NDArray[np.float64]  # (J,) discounted folded cost, s
    discount: NDArray[np.float64]  # (J,) factor on the report's value
    uses: NDArray[np.int64]  # (J,E) percepts gathered
    weight: NDArray[np.float64]  # (J,E) discounted expected executions, for shaping
    errors: NDArray[np.float64]  # (J,N,G) Bayes error by log-odds if rows are exact, else (0,0,0)


class Macros(NamedTuple):
    """Cheapest way from each x to a percept of each behavior, executed."""

    first: NDArray[np.int64]  # (X,E) first behavior, -1 where there is no way
    end: NDArray[np.int64]  # (X,E) x afterwards
    cost: NDArray[np.float64]  # (X,E) discounted folded cost, s
    uses: NDArray[np.int64]  # (X,E,E) percepts gathered on the way, the last included


class Beliefs(NamedTuple):
    """Factored beliefs, a row each."""

    told: NDArray[np.float64]  # (B,N) log-odds of the truth: prior, answers, independent percepts
    felt: NDArray[np.float64]  # (B,N) log-odds of what the object seems to be


class Work(NamedTuple):
    """Room for one caller's intermediate results."""

    weights: NDArray[np.float64]  # (4,OUTCOMES) joint outcomes and counts
    yes: NDArray[np.float64]  # (N,E) yes-percepts seen
    total: NDArray[np.float64]  # (E,) percepts seen
    seen: NDArray[np.float64]  # (N,E,K)
    told: NDArray[np.float64]  # (N,)
    felt: NDArray[np.float64]  # (N,)
    levels: NDArray[np.int64]  # (N,)
    uses: NDArray[np.int64]  # (2,E) percepts of a plan, and of the plan with one step more
    useful: NDArray[np.bool_]  # (E,)
    path: NDArray[np.int64]  # (DEPTH,2) nodes and behaviors of a descent


@kernel
def sigmoid(log_odds):
    """Turn log-odds into a probability."""
    if log_odds >= 0:
        return 1.0 / (1.0 + np.exp(-log_odds))
    e = np.exp(log_odds)
    return e / (1.0 + e)


@kernel
def _soften(log_odds, error):
    """Pass log-odds through a symmetric channel to its other end."""
    if error == 0.0:
        return log_odds
    sign = 1.0 if log_odds >= 0.0 else -1.0
    small = np.exp(-abs(log_odds))
    return sign * np.log((1.0 - error + error * small) / (error + (1.0 - error) * small))


@kernel
def truth(problem, beliefs, row, i):
    """Pr(attribute i is true)."""
    return sigmoid(beliefs.told[row, i] + _soften(beliefs.felt[row, i], problem.flip[i]))


@kernel
def seeming(problem, beliefs, row, i):
    """Pr(attribute i seems true), which percepts but a person's answers depend on."""
    return sigmoid(beliefs.felt[row, i] + _soften(beliefs.told[row, i], problem.flip[i]))


@kernel
def stop_value(problem, x, beliefs, row):
    """Value of ending now: the most probable report, or the exit where that is better."""
    certainty = 1.0
    for i in range(beliefs.told.shape[1]):
        b = truth(problem, beliefs, row, i)
        certainty *= max(b, 1.0 - b)
    value = problem.incorrect + (problem.correct - problem.incorrect) * certainty
    return max(value, problem.exit_value[x])


@kernel
def _yes_counts(problem, i, v, e, k, yes, total, out):
    """Pr(j of the next k percepts say yes | v, percepts seen), j = 0..k: a Polya urn."""
    levels = problem.confusion.shape[3]
    p = 0.0
    for z in range(levels // 2, levels):
        p += problem.confusion[i, e, v, z]
    s = problem.precision[i, e, v]
    out[0] = 1.0
    for t in range(k):
        out[t + 1] = 0.0
        for j in range(t, -1, -1):
            q = p if np.isinf(s) else (s * p + yes + j) / (s + total + t)
            w = out[j]
            out[j + 1] += w * q
            out[j] = w * (1.0 - q)


@kernel
def _plan_error(problem, uses, plan, i, beliefs, row, yes, total, scratch):
    """Exact Bayes error E min(b, 1-b) of attribute i after a plan (percepts cut to yes/no).

    Cutting levels, and dropping behaviors once OUTCOMES is full, can only raise the error: the
    plan's value stays a lower bound. Weights run over what the attribute seems to be, then, for
    a person's answers and the report, over what it is.
    """
    w1, w0, c1, c0 = scratch[0], scratch[1], scratch[2], scratch[3]
    b = seeming(problem, beliefs, row, i)
    w1[0], w0[0], m = b, 1.0 - b, 1
    for answers in range(2):
        if answers == 1 and problem.flip[i] > 0.0:
            gap = np.log((1.0 - problem.flip[i]) / problem.flip[i])
            r1, r0 = sigmoid(beliefs.told[row, i] + gap), sigmoid(beliefs.told[row, i] - gap)
            for a in range(m):
                u1, u0 = w1[a], w0[a]
                w1[a] = r1 * u1 + r0 * u0
                w0[a] = (1.0 - r1) * u1 + (1.0 - r0) * u0
        for e in range(uses.shape[1]):
            if uses[plan, e] == 0 or not problem.informative[i, e]:
                continue
            k = int(min(float(uses[plan, e]), problem.limit[e] - total[e]))
            if k <= 0 or m * (k + 1) > OUTCOMES or problem.direct[e] != (answers == 1):
                continue
            if total[e] == 0.0 and k < problem.fresh.shape[3]:
                for j in range(k + 1):
                    c1[j], c0[j] = problem.fresh[i, e, 1, k, j], problem.fresh[i, e, 0, k, j]
            else:
                _yes_counts(problem, i, 1, e, k, yes[i, e], total[e], c1)
                _yes_counts(problem, i, 0, e, k, yes[i, e], total[e], c0)
            for a in range(m - 1, -1, -1):
                u1, u0 = w1[a], w0[a]
                for j in range(k, -1, -1):
                    w1[a * (k + 1) + j] = u1 * c1[j]
                    w0[a * (k + 1) + j] = u0 * c0[j]
            m *= k + 1
    error = 0.0
    for a in range(m):
        error += min(w1[a], w0[a])
    return error


@kernel
def tabulate_errors(problem, plans, grid, work, out):
    """Error of every plan and attribute over a grid of beliefs -> out (J,N,G); if tabled."""
    _clear(work)
    for plan in range(out.shape[0]):
        for i in range(out.shape[1]):
            for g in range(out.shape[2]):
                out[plan, i, g] = _plan_error(
                    problem, plans.uses, plan, i, grid, g, work.yes, work.total, work.weights
                )


@kernel
def _clear(work):
    for e in range(work.total.shape[0]):
        work.total[e] = 0.0
        for i in range(work.yes.shape[0]):
            work.yes[i, e] = 0.0


@kernel
def _table_error(errors, plan, i, log_odds):
    size = errors.shape[2]
    if abs(log_odds) >= SPAN:
        return min(sigmoid(log_odds), sigmoid(-log_odds))
    position = (log_odds + SPAN) * (size - 1) / (2 * SPAN)
    g = int(position)
    f = position - g
    return (1.0 - f) * errors[plan, i, g] + f * errors[plan, i, g + 1]


@kernel
def _plan_value(problem, plans, plan, beliefs, row, yes, total, scratch, floor):
    """-sum_k (prod_{j<k} g_j) c_k + (prod_k g_k) [r- + (r+ - r-) prod_i (1 - err_i)].

    Gives up, with a value of at most `floor`, as soon as `floor` cannot be beaten.
    """
    gap, g = problem.correct - problem.incorrect, plans.discount[plan]
    base = -plans.cost[plan] + g * problem.incorrect
    tabled = plans.errors.shape[0] > 0
    for e in range(plans.uses.shape[1]):
        uses, left = plans.uses[plan, e], problem.limit[e] - total[e]
        tabled = tabled and uses <= left
        if problem.shaped and uses > 0:
            share = min(1.0, max(0.0, left) / uses)
            for i in range(beliefs.told.shape[1]):
                b = truth(problem, beliefs, row, i)
                mean = b * problem.bonus[i, e, 1] + (1.0 - b) * problem.bonus[i, e, 0]
                base += share * plans.weight[plan, e] * mean
    right = 1.0
    for i in range(beliefs.told.shape[1]):
        if base + g * gap * right <= floor:
            break
        if tabled:
            right *= 1.0 - _table_error(plans.errors, plan, i, beliefs.told[row, i])
        else:
            right *= 1.0 - _plan_error(
                problem, plans.uses, plan, i, beliefs, row, yes, total, scratch
            )
    return base + g * gap * right


@kernel
def open_loop_values(problem, plans, x, beliefs, row, yes, total, scratch, out):
    """Best value of the plans from x by first behavior -> out[row] (E,), -inf where none."""
    for a in range(out.shape[1]):
        out[row, a] = -np.inf
    for plan in range(plans.first[x], plans.first[x + 1]):
        a = plans.action[plan]
        floor = out[row, a]
        value = _plan_value(problem, plans, plan, beliefs, row, yes, total, scratch, floor)
        out[row, a] = max(floor, value)


@kernel
def plan_values(problem, plans, x, beliefs, work, out):
    """Value of each plan from x at beliefs (B,N) before any percept -> out (B,J)."""
    _clear(work)
    for row in range(beliefs.told.shape[0]):
        best = stop_value(problem, x, beliefs, row)
        for plan in range(plans.first[x], plans.first[x + 1]):
            value = _plan_value(
                problem, plans, plan, beliefs, row, work.yes, work.total, work.weights, best
            )
            out[row, plan] = value
            best = max(best, value)


@kernel
def _all_right(problem, work, which, beliefs, row):
    right = 1.0
    for i in range(beliefs.told.shape[1]):
        right *= 1.0 - _plan_error(
            problem, work.uses, which, i, beliefs, row, work.yes, work.total, work.weights
        )
    return right


@kernel
def grow_plans(problem, macros, x, beliefs, length, work, out):
    """Grow plans from x greedily, one for each belief (B,N) and first percept -> out (B*E,L).

    Rows hold the percepts gone for in order, padded by -1. Each step after the first goes to the
    percept (or two or three of it, where it repeats) that adds most log probability of an
    all-right report per second; to fix the first in turn keeps expensive beginnings in play.
    """
    n, n_behaviors = problem.confusion.shape[0], problem.confusion.shape[1]
    uses, useful = work.uses, work.useful
    _clear(work)
    for e in range(n_behaviors):
        useful[e] = False
        for i in range(n):
            useful[e] = useful[e] or problem.informative[i, e]
    for plan in range(out.shape[0]):
        row, forced = plan // n_behaviors, plan % n_behaviors
        if macros.first[x, forced] < 0 or not useful[forced]:
            continue
        here, filled, right = x, 0, 1.0
        for e in range(n_behaviors):
            uses[0, e] = 0
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
                    gained = _all_right(problem, work, 1, beliefs, row)
                    rate = np.log(gained / right) / (price + 1e-6)
                    if rate > best:
                        best, best_e, best_k = rate, e, k
            if best_e < 0:
                break
            for _ in range(best_k):
                out[plan, filled] = best_e
                filled += 1
                for other in range(n_behaviors):
                    uses[0, other] += macros.uses[here, best_e, other]
                here = macros.end[here, best_e]
            right = _all_right(problem, work, 0, beliefs, row)


def room_for(problem: Compiled) -> Work:
    """Make the room that the kernels need for a MOMDP."""
    n, e, _, k = problem.confusion.shape
    return Work(
        weights=np.empty((4, OUTCOMES)),
        yes=np.zeros((n, e)),
        total=np.zeros(e),
        seen=np.zeros((n, e, k)),
        told=np.zeros(n),
        felt=np.zeros(n),
        levels=np.zeros(n, np.int64),
        uses=np.zeros((2, e), np.int64),
        useful=np.zeros(e, np.bool_),
        path=np.zeros((DEPTH, 2), np.int64),
    )

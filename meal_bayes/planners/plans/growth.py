"""Greedy growth of open-loop plans on a transition diagram, from percept to percept."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.planners.jit import (
    NO_BEHAVIOR,
    Index,
    by_reference,
    called_kernel,
    entry_kernel,
    kernel,
)
from meal_bayes.planners.plans.bayes_error import mean_reward

CELLS = 8  # of the seconds that may follow, when a bound looks ahead


@by_reference
class Paths(NamedTuple):
    """Grown plans from every state, for B beliefs and every first percept."""

    behavior: Ints  # (X,B,E,L) executed, padded by -1
    ends: NDArray[np.bool_]  # (X,B,E,L) does a prefix end here, with the percept gone for?


class Origin(NamedTuple):
    """Where a plan begins."""

    x: Index
    goal: Index  # behavior of its first percept


class PathEnd(NamedTuple):
    """Where a plan has come to."""

    x: Index
    length: Index  # behaviors so far


@by_reference
class Growth(NamedTuple):
    """What percepts tell, and what a plan has gathered so far."""

    log_affinity: Floats  # (N,E,U) log coefficient of u percepts, 0 where they do not inform
    rate: Floats  # (N,) its greatest fall a second
    limit: Floats  # (E,) percepts that a trial can have
    incorrect: float  # r-
    reward_range: float  # r+ - r-
    counts: Ints  # (E,) percepts of the plan
    log_r: Floats  # (2,N) sum of the log coefficients, of the plan and of what may follow


@kernel
def _log_affinity(log_affinity, i, e, k):
    """Return the log Bhattacharyya coefficient of k percepts; beyond the table in proportion."""
    last = log_affinity.shape[2] - 1
    # Independent percepts multiply coefficients, so that logarithms add up: k of them k times.
    return log_affinity[i, e, min(k, last)] * max(1.0, k / last)


@kernel
def _right(log_r, rate, seconds, chance):
    """Estimate Pr(right report) after percepts of log coefficient log_r, and rate a second more.

    Percepts of coefficient r = sum_z sqrt(p1 p0) leave an error of at least
    (1 - sqrt(1 - 4 b (1 - b) r^2)) / 2; coefficients multiply.
    """
    right = 1.0
    for i in range(log_r.shape[0]):
        b = chance[i]
        r = log_r[i] - seconds * rate[i]
        right *= 0.5 + 0.5 * np.sqrt(max(0.0, 1.0 - 4.0 * b * (1.0 - b) * np.exp(2.0 * r)))
    return right


@called_kernel
def _next_percept(shortest, growth, x, chance):
    """Choose the percepts that add most log Pr(right) a second -> behavior, number."""
    log_affinity = growth.log_affinity
    counts = growth.counts
    log_r = growth.log_r
    gathered = shortest.gathered
    n = counts.shape[0]
    right = _right(log_r[0], growth.rate, 0.0, chance)
    best = 1e-12
    best_e = NO_BEHAVIOR
    best_k = 1
    for e in range(n):
        if shortest.first_action[x, e] < 0:
            continue
        end = shortest.end[x, e]
        # One percept more of the same behavior, as long as that raises the gain a second: where
        # rows are known or percepts weak, the second is worth what the first is.
        k = 1
        last = 0.0
        while counts[e] + k <= growth.limit[e]:
            for i in range(log_r.shape[1]):
                log_r[1, i] = log_r[0, i]
                for g in range(gathered.shape[2]):
                    o = gathered[x, e, g]
                    if o < 0:
                        break
                    more = shortest.observation_counts[x, e, o]
                    more += k - 1 if o == e else 0
                    log_r[1, i] += _log_affinity(log_affinity, i, o, counts[o] + more)
                    log_r[1, i] -= _log_affinity(log_affinity, i, o, counts[o])
            # (ln Pr(right | k more) - ln Pr(right)) / (cost of the path and of k - 1 repeats)
            price = shortest.cost[x, e] + (k - 1) * shortest.cost[end, e] + 1e-6
            gain = np.log(_right(log_r[1], growth.rate, 0.0, chance) / right) / price
            if gain > best:
                best = gain
                best_e = e
                best_k = k
            # Only what keeps its x can be repeated at once, for its own cost.
            repeats = shortest.end[end, e] == end and shortest.first_action[end, e] == e
            if gain <= last or not repeats:
                break
            last = gain
            k += 1
    return best_e, best_k


@called_kernel
def _best_ahead(growth, chance, base, reward, spare):
    """Bound what a plan can still come to, if every second were the best for each attribute.

    `base` is its value with a wrong report, `reward` what a right one adds; more than `spare`
    seconds cannot pay. Within a cell of seconds, the first are paid and the last have been of use.
    """
    # max over cells of base + reward Pr(right | end of the cell) - seconds at its start
    best = -np.inf
    for cell in range(CELLS):
        seconds = spare * (cell + 1) / CELLS
        right = _right(growth.log_r[0], growth.rate, seconds, chance)
        best = max(best, mean_reward(base, reward, right) - spare * cell / CELLS)
    return best


@kernel
def _informs(growth, e):
    """Test whether a first percept of a behavior tells anything of any attribute, and may come."""
    informs = False
    for i in range(growth.log_r.shape[1]):
        informs = informs or growth.log_affinity[i, e, 1] < 0.0
    return informs and growth.limit[e] >= 1.0


@called_kernel
def _follow_path(shortest, growth, path, end_so_far, goal):
    """Append the shortest path to a percept of a behavior, while there is room; return the end."""
    counts = growth.counts
    log_r = growth.log_r[0]
    state, filled = end_so_far
    arrived = False
    while not arrived and filled < path.behavior.shape[0]:
        a = shortest.first_action[state, goal]
        arrived = a == goal and shortest.senses[state, a]
        if shortest.senses[state, a]:
            for i in range(log_r.shape[0]):
                log_r[i] += _log_affinity(growth.log_affinity, i, a, counts[a] + 1)
                log_r[i] -= _log_affinity(growth.log_affinity, i, a, counts[a])
            counts[a] += 1
        path.behavior[filled] = a
        path.ends[filled] = arrived
        filled += 1
        state = shortest.target[state, a]
    return PathEnd(state, filled)


@called_kernel
def _grow_plan(shortest, growth, chance, path, origin):
    """Grow a plan from x, to the percept of a first behavior and on -> path; return its length."""
    x, goal = origin
    log_r = growth.log_r[0]
    growth.counts[:] = 0
    log_r[:] = 0.0
    end_so_far = PathEnd(x, np.int64(0))
    repeats = 1
    cost = 0.0
    scale = 1.0
    # What to report at once is worth, before anything is perceived. Of a question of yes or no its
    # values are taken to be reported, too: it is sifting that goes by what yes and no earn.
    right = _right(log_r, growth.rate, 0.0, chance)
    best = mean_reward(growth.incorrect, growth.reward_range, right)
    while goal >= 0 and end_so_far.length < path.behavior.shape[0]:
        # Go for the percepts chosen last: cost += scale c, scale *= g.
        for _ in range(repeats):
            cost += scale * shortest.cost[end_so_far.x, goal]
            scale *= shortest.discount[end_so_far.x, goal]
            end_so_far = _follow_path(shortest, growth, path, end_so_far, goal)
        # V = g `mean_reward` - c, and stop where nothing that follows can pay.
        base = scale * growth.incorrect - cost
        reward = scale * growth.reward_range
        right = _right(log_r, growth.rate, 0.0, chance)
        best = max(best, mean_reward(base, reward, right))
        spare = base + reward - best
        if spare <= 0.0 or _best_ahead(growth, chance, base, reward, spare) <= best:
            break
        goal, repeats = _next_percept(shortest, growth, end_so_far.x, chance)
    return end_so_far.length


@entry_kernel
def grow_plans(shortest, growth, chance, begins, paths):
    """Grow a plan for each x, belief (B,N) and first percept -> paths; return the longest's length.

    `begins` (X,E) says to which first percepts.

    Every first percept is tried, so that expensive first steps are not lost. A plan grows until no
    continuation is worth its cost, or until it has its maximum length.
    """
    longest = 1
    for x in range(paths.behavior.shape[0]):
        for b in range(paths.behavior.shape[1]):
            for e in range(paths.behavior.shape[2]):
                if begins[x, e] and _informs(growth, e) and shortest.first_action[x, e] >= 0:
                    path = Paths(paths.behavior[x, b, e], paths.ends[x, b, e])
                    length = _grow_plan(shortest, growth, chance[b], path, Origin(x, e))
                    longest = max(longest, length)
    return longest

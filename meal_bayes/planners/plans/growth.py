"""Greedy growth of open-loop plans on a transition diagram, by one percept after another."""

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

CELLS = 8  # intervals of the remaining seconds in a bound


@by_reference
class Paths(NamedTuple):
    """Grown plans from every state, for B beliefs and every first percept."""

    behavior: Ints  # (X,B,E,L) behaviors of the plans, padded by -1
    ends: NDArray[np.bool_]  # (X,B,E,L) is there a chosen percept, so that a prefix ends here?


class Origin(NamedTuple):
    """Beginning of a plan."""

    x: Index
    goal: Index  # behavior of its first percept


class PathEnd(NamedTuple):
    """Current end of a plan."""

    x: Index
    length: Index  # number of behaviors so far


@by_reference
class Growth(NamedTuple):
    """Information of percepts, and the state of a growing plan."""

    log_affinity: Floats  # (N,E,U) log coefficient of u percepts; 0 if they are uninformative
    rate: Floats  # (N,) largest decrease of the log coefficient per second
    limit: Floats  # (E,) largest number of percepts in a trial
    incorrect: float  # r-
    reward_range: float  # r+ - r-
    counts: Ints  # (E,) percepts of the plan
    log_r: Floats  # (2,N) sum of the log coefficients, of the plan and with further percepts


@kernel
def _log_affinity(log_affinity, i, e, k):
    """Return the log Bhattacharyya coefficient of k percepts, extrapolated beyond the table."""
    last = log_affinity.shape[2] - 1
    # Coefficients of independent percepts multiply, so their logarithms are proportional to k.
    return log_affinity[i, e, min(k, last)] * max(1.0, k / last)


@kernel
def _right(log_r, rate, seconds, chance):
    """Estimate Pr(right report) after percepts with log coefficient log_r, and `seconds` more.

    In each further second, the log coefficient decreases by `rate`. After percepts with the
    coefficient r = sum_z sqrt(p1 p0), the error is at least (1 - sqrt(1 - 4 b (1 - b) r^2)) / 2.
    """
    right = 1.0
    for i in range(log_r.shape[0]):
        b = chance[i]
        r = log_r[i] - seconds * rate[i]
        right *= 0.5 + 0.5 * np.sqrt(max(0.0, 1.0 - 4.0 * b * (1.0 - b) * np.exp(2.0 * r)))
    return right


@called_kernel
def _next_percept(shortest, growth, x, chance):
    """Return behavior and number of percepts with the largest gain of log Pr(right) per second."""
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
        # Add percepts of the same behavior as long as this increases the gain per second. With
        # known rows or weak percepts, several percepts have a larger gain than one.
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
            # Only a behavior that keeps x can be repeated at its own cost.
            repeats = shortest.end[end, e] == end and shortest.first_action[end, e] == e
            if gain <= last or not repeats:
                break
            last = gain
            k += 1
    return best_e, best_k


@called_kernel
def _best_ahead(growth, chance, base, reward, spare):
    """Return an upper bound on the value of all continuations of a plan.

    The bound assumes that every second gives the most information about each attribute. `base` is
    the value of the plan with a wrong report, and `reward` is added for a right one. More than
    `spare` seconds are never worth their cost. In each interval, the bound uses the cost at the
    beginning and the information at the end.
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
    """Return whether a first percept of a behavior is possible and informative."""
    informs = False
    for i in range(growth.log_r.shape[1]):
        informs = informs or growth.log_affinity[i, e, 1] < 0.0
    return informs and growth.limit[e] >= 1.0


@called_kernel
def _follow_path(shortest, growth, path, end_so_far, goal):
    """Append the shortest path to a percept, up to the length limit; return the end."""
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
    """Grow a plan from x that begins with a given percept -> path; return its length."""
    x, goal = origin
    log_r = growth.log_r[0]
    growth.counts[:] = 0
    log_r[:] = 0.0
    end_so_far = PathEnd(x, np.int64(0))
    repeats = 1
    cost = 0.0
    scale = 1.0
    # The value of reporting at once. For a yes-or-no question, plans are grown as if values were
    # reported; the later selection uses the payoffs of yes and no.
    right = _right(log_r, growth.rate, 0.0, chance)
    best = mean_reward(growth.incorrect, growth.reward_range, right)
    while goal >= 0 and end_so_far.length < path.behavior.shape[0]:
        # Append the paths to the chosen percepts: cost += scale c, scale *= g.
        for _ in range(repeats):
            cost += scale * shortest.cost[end_so_far.x, goal]
            scale *= shortest.discount[end_so_far.x, goal]
            end_so_far = _follow_path(shortest, growth, path, end_so_far, goal)
        # V = g `mean_reward` - c; stop if no continuation can be worth its cost.
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

    `begins` (X,E) marks the first percepts. Several first percepts are tried, so that plans with
    expensive first steps are found, too. A plan grows until no continuation is worth its cost, or
    until it has its maximum length.
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

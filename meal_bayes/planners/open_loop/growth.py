"""How open-loop plans are grown on a transition diagram: from percept to percept, greedily."""

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.planners.compiled import Dynamics
from meal_bayes.planners.kernels import entry_kernel, kernel

CELLS = 8  # of the seconds that may follow, when a bound looks ahead


class Ways(NamedTuple):
    """Cheapest way from each x to a percept of each behavior, along the likeliest outcomes."""

    target: Ints  # (X,E) where a behavior leads
    senses: NDArray[np.bool_]  # (X,E) does it perceive?
    hop: Ints  # (X,E) first behavior of the way, -1 where there is none
    end: Ints  # (X,E) x afterwards
    cost: Floats  # (X,E) s, discounted
    discount: Floats  # (X,E) factor on what comes afterwards
    observation_counts: Ints  # (X,E,E) percepts gathered on the way, the last included

    def path(self, x: int, behavior: int) -> tuple[int, ...]:
        """Return the behaviors from x to a percept of one of them; empty where there is no way."""
        a = int(self.hop[x, behavior])
        if a < 0:
            return ()
        arrived = a == behavior and self.senses[x, a]
        return (a,) if arrived else (a, *self.path(int(self.target[x, a]), behavior))


class Growth(NamedTuple):
    """What percepts say, and how many a plan has so far."""

    bhattacharyya: Floats  # (N,E,U) log coefficient of u percepts, 0 where they do not inform
    rate: Floats  # (N,) its greatest fall a second
    limit: Floats  # (E,) percepts that a trial can have
    incorrect: float  # r-
    gap: float  # r+ - r-
    counts: Ints  # (E,) percepts of the plan
    log_r: Floats  # (2,N) sum of the log coefficients, of the plan and of what may follow


def find_ways(dynamics: Dynamics) -> Ways:
    """Find the cheapest ways by Dijkstra's algorithm from every x."""
    step, likely = dynamics.step, dynamics.branch["p"].argmax(axis=2)[:, :, None]
    target = np.take_along_axis(dynamics.branch["x"], likely, axis=2)[:, :, 0]
    senses = np.take_along_axis(dynamics.branch["senses"], likely, axis=2)[:, :, 0]
    shape = step.shape
    ways = Ways(
        target, senses, np.full(shape, -1), np.zeros(shape, np.int64), np.zeros(shape),
        np.ones(shape), np.zeros((*shape, shape[1]), np.int64),
    )  # fmt: skip
    for start in range(shape[0]):
        queue: list[tuple[float, int, tuple[int, ...]]] = [(0.0, start, ())]
        reached: set[int] = set()
        while queue:
            cost, x, path = heapq.heappop(queue)
            if x in reached:
                continue
            reached.add(x)
            for a in np.flatnonzero(step["legal"][x]).tolist():
                if senses[x, a] and ways.hop[start, a] < 0:
                    _note(ways, step, start, (*path, a))
                spent = cost + float(step["cost"][x, a])
                heapq.heappush(queue, (spent, int(target[x, a]), (*path, a)))
    return ways


def _note(ways: Ways, step: NDArray[np.void], start: int, path: tuple[int, ...]) -> None:
    """Record the way along a path, which ends with a percept."""
    x, scale, goal = start, 1.0, path[-1]
    for a in path:
        ways.observation_counts[start, goal, a] += ways.senses[x, a]
        ways.cost[start, goal] += scale * step["cost"][x, a]
        scale *= step["discount"][x, a]
        x = int(ways.target[x, a])
    ways.hop[start, goal], ways.end[start, goal], ways.discount[start, goal] = path[0], x, scale


@kernel
def _log_affinity(bhattacharyya, i, e, k):
    """Return the log Bhattacharyya coefficient of k percepts; beyond the table in proportion."""
    last = bhattacharyya.shape[2] - 1
    return bhattacharyya[i, e, min(k, last)] * max(1.0, k / last)


@kernel
def _right(log_r, rate, seconds, chance, b):
    """Estimate Pr(right report) after percepts of log coefficient log_r, and rate a second more.

    Percepts of coefficient r = sum_z sqrt(p1 p0) leave an error of at least
    (1 - sqrt(1 - 4 b (1 - b) r^2)) / 2; coefficients multiply.
    """
    right = 1.0
    for i in range(log_r.shape[0]):
        p, r = chance[b, i], log_r[i] - seconds * rate[i]
        right *= 0.5 + 0.5 * np.sqrt(max(0.0, 1.0 - 4.0 * p * (1.0 - p) * np.exp(2.0 * r)))
    return right


@kernel
def _next_percept(ways, x, growth, chance, b):
    """Choose the percepts that add most log Pr(right) a second -> behavior (-1 = none), number."""
    bhattacharyya, counts = growth.bhattacharyya, growth.counts
    log_r, rate = growth.log_r, growth.rate
    best, best_e, best_k, n = 1e-12, -1, 1, counts.shape[0]
    right = _right(log_r[0], rate, 0.0, chance, b)
    for e in range(n):
        if ways.hop[x, e] < 0:
            continue
        end, k, last = ways.end[x, e], 1, 0.0
        while counts[e] + k <= growth.limit[e]:
            for i in range(log_r.shape[1]):
                log_r[1, i] = log_r[0, i]
                for o in range(n):
                    more = ways.observation_counts[x, e, o]
                    if more > 0 or o == e:
                        more += k - 1 if o == e else 0
                        log_r[1, i] += _log_affinity(bhattacharyya, i, o, counts[o] + more)
                        log_r[1, i] -= _log_affinity(bhattacharyya, i, o, counts[o])
            # ln Pr(right | k more) - ln Pr(right), a second
            price = ways.cost[x, e] + (k - 1) * ways.cost[end, e] + 1e-6
            gain = np.log(_right(log_r[1], rate, 0.0, chance, b) / right) / price
            if gain > best:
                best, best_e, best_k = gain, e, k
            if gain <= last or ways.end[end, e] != end or ways.hop[end, e] != e:
                break
            last, k = gain, k + 1
    return best_e, best_k


@kernel
def _best_ahead(growth, chance, b, base, reward, spare):
    """Bound what a plan can still come to, if every second were the best for each attribute.

    `base` is its value with a wrong report, `reward` what a right one adds; more than `spare`
    seconds cannot pay. Within a cell of seconds, the first are paid and the last have been of use.
    """
    best = -np.inf
    for cell in range(CELLS):
        seconds = spare * (cell + 1) / CELLS
        right = _right(growth.log_r[0], growth.rate, seconds, chance, b)
        best = max(best, base + reward * right - spare * cell / CELLS)
    return best


@entry_kernel
def grow_plans(ways, growth, chance, out, ends):
    """Grow a plan for each x, belief (B,N) and first percept -> out (X,B,E,L), padded by -1.

    Rows hold the behaviors executed; `ends` marks beginnings that end with the percept gone for. To
    fix the first percept in turn keeps expensive beginnings in play. A plan is grown until nothing
    that could follow would pay, or it is full. Returns the length of the longest.
    """
    size, n_beliefs, n, length = out.shape
    bhattacharyya, counts, log_r, longest = growth.bhattacharyya, growth.counts, growth.log_r[0], 1
    rate, gap = growth.rate, growth.gap
    for row in range(size * n_beliefs * n):
        x, b, e = row // (n_beliefs * n), row // n % n_beliefs, row % n
        informs, counts[:], log_r[:] = False, 0, 0.0
        for i in range(log_r.shape[0]):
            informs = informs or bhattacharyya[i, e, 1] < 0.0
        if not informs or growth.limit[e] < 1.0 or ways.hop[x, e] < 0:
            continue
        state, filled, k, goal, cost, scale = x, 0, 1, e, 0.0, 1.0
        best = growth.incorrect + gap * _right(log_r, rate, 0.0, chance, b)
        while goal >= 0 and filled < length:
            for _ in range(k):
                cost += scale * ways.cost[state, goal]
                scale *= ways.discount[state, goal]
                arrived = False
                while not arrived and filled < length:
                    a = ways.hop[state, goal]
                    arrived = a == goal and ways.senses[state, a]
                    if ways.senses[state, a]:
                        for i in range(log_r.shape[0]):
                            log_r[i] += _log_affinity(bhattacharyya, i, a, counts[a] + 1)
                            log_r[i] -= _log_affinity(bhattacharyya, i, a, counts[a])
                        counts[a] += 1
                    out[x, b, e, filled] = a
                    ends[x, b, e, filled] = arrived
                    filled += 1
                    state = ways.target[state, a]
            base, reward = scale * growth.incorrect - cost, scale * gap
            best = max(best, base + reward * _right(log_r, rate, 0.0, chance, b))
            spare = base + reward - best
            if spare <= 0.0 or _best_ahead(growth, chance, b, base, reward, spare) <= best:
                break
            goal, k = _next_percept(ways, state, growth, chance, b)
        longest = max(longest, filled)
    return longest

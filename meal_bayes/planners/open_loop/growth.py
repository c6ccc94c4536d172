"""How open-loop plans are grown on a transition diagram: from percept to percept, greedily."""

import heapq
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.compiled import Dynamics
from meal_bayes.planners.kernels import entry_kernel, kernel

_SURE = 0.6  # Pr(right) from which a plan must repay its cost
_RETURN = 0.5  # and gain at least this fraction of the cost of its next step


class Ways(NamedTuple):
    """Cheapest way from each x to a percept of each behavior, executed.

    Of several outcomes a plan follows the likeliest.

    Attributes
    ----------
    target, senses : (X,E) where a behavior leads, and whether it perceives.
    hop : (X,E) first behavior of the way, -1 where there is none.
    end : (X,E) x afterwards.
    cost : (X,E) s, discounted.
    discount : (X,E) factor on what comes afterwards.
    observation_counts : (X,E,E) percepts gathered on the way, the last included.
    """

    target: NDArray[np.int64]
    senses: NDArray[np.bool_]
    hop: NDArray[np.int64]
    end: NDArray[np.int64]
    cost: NDArray[np.float64]
    discount: NDArray[np.float64]
    observation_counts: NDArray[np.int64]

    def path(self, x: int, behavior: int) -> tuple[int, ...]:
        """Return the behaviors from x to a percept of one of them; empty where there is no way."""
        path: tuple[int, ...] = ()
        while self.hop[x, behavior] >= 0:
            a = int(self.hop[x, behavior])
            path = (*path, a)
            if a == behavior and self.senses[x, a]:
                return path
            x = int(self.target[x, a])
        return path


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
def _probable(bhattacharyya, counts, chance, b):
    """Estimate Pr(right report) after a plan's percepts (E,) by their Bhattacharyya coefficient.

    Percepts of coefficient r = sum_z sqrt(p1 p0) leave an error of about
    (1 - sqrt(1 - 4 b (1 - b) r^2)) / 2, its lower bound; coefficients multiply.
    """
    right, last = 1.0, bhattacharyya.shape[2] - 1
    for i in range(bhattacharyya.shape[0]):
        log_r = 0.0
        for e in range(counts.shape[0]):
            k = counts[e]
            if k > 0:
                log_r += bhattacharyya[i, e, min(k, last)] * max(1.0, k / last)
        p = chance[b, i]
        error = 0.5 - 0.5 * np.sqrt(max(0.0, 1.0 - 4.0 * p * (1.0 - p) * np.exp(2.0 * log_r)))
        right *= 1.0 - error
    return right


@kernel
def _next_percept(ways, here, bhattacharyya, chance, b, counts, right):
    """Choose the percept (or two or three of it) that adds most log Pr(right) per second.

    Returns behavior (-1 for none), how many of it, and the rate.
    """
    n, best, best_e, best_k = counts.shape[1], 1e-12, -1, 1
    for e in range(n):
        if ways.hop[here, e] < 0:
            continue
        end = ways.end[here, e]
        repeats = 3 if ways.end[end, e] == end and ways.hop[end, e] == e else 1
        for k in range(1, repeats + 1):
            for other in range(n):
                counts[1, other] = counts[0, other] + ways.observation_counts[here, e, other]
            counts[1, e] += k - 1
            gained = _probable(bhattacharyya, counts[1], chance, b)
            price = ways.cost[here, e] + (k - 1) * ways.cost[end, e] + 1e-6
            rate = np.log(gained / right) / price
            if rate > best:
                best, best_e, best_k = rate, e, k
    return best_e, best_k, best


@entry_kernel
def grow_plans(ways, bhattacharyya, limit, chance, gap, counts, out):
    """Grow a plan for each x, belief (B,N) and first percept -> out (X,B,E,L), padded by -1.

    Rows hold the behaviors executed. To fix the first percept in turn keeps expensive beginnings in
    play. A plan is grown until it is more right than not and a step costs twice what it gains.
    `bhattacharyya` (N,E,U) is the log coefficient, 0 where percepts carry no information;
    `counts` (2,E) is scratch.
    """
    size, n_beliefs, n, length = out.shape
    for row in range(size * n_beliefs * n):
        x, b, e = row // (n_beliefs * n), row // n % n_beliefs, row % n
        useful = 0.0
        for i in range(bhattacharyya.shape[0]):
            useful += bhattacharyya[i, e, 1]
        if ways.hop[x, e] < 0 or useful == 0.0:
            continue
        for other in range(n):
            counts[0, other] = 0
        here, filled, k, goal = x, 0, 1, e
        while goal >= 0:
            for _ in range(k):
                arrived = False
                while not arrived and filled < length:
                    a = ways.hop[here, goal]
                    arrived = a == goal and ways.senses[here, a]
                    counts[0, a] += ways.senses[here, a]
                    out[x, b, e, filled] = a
                    filled += 1
                    here = ways.target[here, a]
            right = _probable(bhattacharyya, counts[0], chance, b)
            goal, k, rate = _next_percept(ways, here, bhattacharyya, chance, b, counts, right)
            enough = right > _SURE and rate * gap * right < _RETURN
            if enough or filled == length or (goal >= 0 and counts[0, goal] + k > limit[goal]):
                break


@entry_kernel
def follow(step, ways, start, path, plan, counts, executions, reached):
    """Sum up what every beginning of a path comes to.

    From start (R,) along path (R,L), padded by -1 -> `plan` (R,L) records of `PLAN`, `counts` and
    `executions` (R,L,E), and the x `reached` (R,L).
    """
    for r in range(path.shape[0]):
        x, cost, discount = start[r], 0.0, 1.0
        for t in range(path.shape[1]):
            a = path[r, t]
            if a < 0:
                break
            for e in range(counts.shape[2]):
                counts[r, t, e] = counts[r, t - 1, e] if t > 0 else 0
                executions[r, t, e] = executions[r, t - 1, e] if t > 0 else 0.0
            counts[r, t, a] += ways.senses[x, a]
            executions[r, t, a] += discount * step[x, a].bonus_scale
            cost += discount * step[x, a].cost
            discount *= step[x, a].discount
            x = ways.target[x, a]
            plan[r, t].action, plan[r, t].cost, plan[r, t].discount = path[r, 0], cost, discount
            reached[r, t] = x

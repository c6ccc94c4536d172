"""Candidates for the library of plans: simple plans, tours, and grown plans, with their costs."""

import functools
import itertools
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.planners.momdp_arrays import DIAGRAMS, MOMDPArrays
from meal_bayes.planners.plans.paths import DiagramPaths, ShortestPaths
from meal_bayes.planners.plans.values import PLAN

LENGTH = 96  # largest number of behaviors of a plan
_SIMPLE_PLANS = 6_000  # largest number of simple plans from all x; the most promising are kept
_TOURS = 1_000  # the same for tours
_WALKS = 50_000  # size of the cache of simple plans

Walk = tuple[int, Sequence[int]]  # an x, and behaviors from there
_Number = TypeVar("_Number", np.int64, np.float64)


class Candidates(NamedTuple):
    """Plans with their paths."""

    x: Ints  # (J,) states in which they begin
    path: NDArray[np.int16]  # (J,L) behaviors, padded by -1
    plan: NDArray[np.void]  # this field and the following ones are as in `Plans`
    observation_counts: Ints
    expected_percepts: Floats

    def select(self, rows: NDArray[np.intp]) -> "Candidates":
        """Select some of them."""
        return Candidates._make(part[rows] for part in self)


def simple_plans(diagram: DiagramPaths, log_affinity: Floats) -> Candidates:
    """Return every legal behavior, and plans of a few percepts of one or two behaviors.

    These plans have one or two percepts of a behavior, then none, one or two of another behavior.
    If there are too many, the most promising plans of each state are kept: those with the most
    information per second, by the log coefficients (N,E,U) of the percepts.
    """
    legal = diagram.dynamics.step["legal"]
    n_states, n_behaviors = legal.shape
    if 6 * n_states * n_behaviors**2 <= _SIMPLE_PLANS:
        return _all_simple_plans(diagram)
    singles = [(x, (a,)) for x, a in np.argwhere(legal).tolist()]
    most = max(_SIMPLE_PLANS // n_states - n_behaviors, n_behaviors)
    tells = -log_affinity.sum(axis=0)  # (E,U)
    walks = (
        _simple_walk(diagram, x, goals)
        for x in range(n_states)
        for goals in _promising_goals(diagram.shortest, x, tells, most)
    )
    return cheapest(sum_up_walks(diagram, sorted({*singles, *walks})))


@functools.lru_cache(maxsize=DIAGRAMS)
def _all_simple_plans(diagram: DiagramPaths) -> Candidates:
    """Return all simple plans; they do not depend on the confusion matrices."""
    shortest = diagram.shortest
    legal = diagram.dynamics.step["legal"]
    walks = set[tuple[int, tuple[int, ...]]]((x, (a,)) for x, a in np.argwhere(legal).tolist())
    for x in range(len(legal)):
        goals = np.flatnonzero(shortest.first_action[x] >= 0).tolist()
        for e, k, f, more in itertools.product(goals, (1, 2), goals, (0, 1, 2)):
            walks.add(_simple_walk(diagram, x, (*(e,) * k, *(f,) * more)))
    return cheapest(sum_up_walks(diagram, sorted(walks)))


@functools.lru_cache(maxsize=_WALKS)  # all libraries of a run have the same simple plans
def _simple_walk(
    diagram: DiagramPaths, x: int, goals: tuple[int, ...]
) -> tuple[int, tuple[int, ...]]:
    """Return x and the behaviors that lead to the percepts `goals` in order, as far as possible."""
    shortest = diagram.shortest
    path: tuple[int, ...] = ()
    state = x
    for goal in goals:
        if shortest.first_action[state, goal] < 0:
            break  # there is no path to this percept
        path = (*path, *shortest.path(state, goal))
        state = int(shortest.end[state, goal])
    return x, path[:LENGTH]


def _promising_goals(
    shortest: ShortestPaths, x: int, tells: Floats, most: int
) -> Iterator[tuple[int, ...]]:
    """Yield the goals of at most `most` simple plans from x with most information per second."""
    reached = shortest.first_action >= 0
    unreached = np.where(reached, shortest.cost, np.inf)  # (X,E)
    for k in (1, 2):
        goals = np.flatnonzero(reached[x])
        end = shortest.end[x, goals]
        cost = unreached[x, goals]
        if k == 2:  # the same percept again, from the state after the first one
            cost = cost + unreached[end, goals]
            end = shortest.end[end, goals]
        first = tells[goals, k]
        second = unreached[end]  # (G,E)
        last = shortest.end[end]  # (G,E)
        third = unreached[last, np.arange(len(tells))]
        # Columns: the first behavior alone; then one, then two percepts of each other.
        gain = np.column_stack([first, first[:, None] + tells[:, 1], first[:, None] + tells[:, 2]])
        price = cost[:, None] + np.column_stack([np.zeros(len(goals)), second, second + third])
        with np.errstate(invalid="ignore"):
            promise = np.where(np.isfinite(price), gain / (price + 1e-6), -np.inf)
        promise[:, 0] = np.where(np.isfinite(cost), np.inf, -np.inf)  # each behavior alone
        best = np.argsort(-promise, axis=None, kind="stable")[: most // 2]
        for row, column in zip(*np.unravel_index(best, promise.shape), strict=True):
            if promise[row, column] == -np.inf:
                break
            more, other = divmod(int(column) - 1, len(tells))
            yield (int(goals[row]),) * k + (other,) * (more + 1 if column else 0)


def sum_up(diagram: DiagramPaths, start: Ints, path: Ints, ends: Bools) -> Candidates:
    """Compute the plans of the prefixes of paths (R,L) from start (R,) that end after `ends`.

    cost = sum_k (prod_{j<k} g_j) c_k, discount = prod_k g_k, lost = sum_k (prod_{j<k} g_j) l_k
    """
    length = path.shape[1]
    # The states along a path, with the most probable outcomes.
    x = np.empty_like(path)
    x[:, 0] = start
    for t in range(length - 1):
        x[:, t + 1] = diagram.shortest.target[x[:, t], path[:, t]]
    last = diagram.shortest.target[x, path]
    steps = diagram.steps
    discount = steps.discount[x, path].cumprod(axis=1)
    scale = np.hstack([np.ones((len(path), 1)), discount[:, :-1]])
    cost = (scale * steps.cost[x, path]).cumsum(axis=1)
    lost = (scale * steps.lost[x, path]).cumsum(axis=1)
    row, end = np.nonzero(ends)
    plan = np.zeros(len(row), PLAN)
    plan["action"] = path[row, 0]
    plan["cost"] = cost[row, end]
    plan["discount"] = discount[row, end]
    plan["lost"] = lost[row, end]
    plan["end"] = last[row, end]
    behavior = np.full((len(row), LENGTH), -1, np.int16)  # copying paths would take half the time
    inside = np.arange(length) <= end[:, None]
    behavior[:, :length] = np.where(inside, path.astype(np.int16)[row], -1)
    senses = diagram.shortest.senses[x, path].astype(np.int64)
    paid = scale * steps.percepts[x, path]
    n_behaviors = diagram.dynamics.step.shape[1]
    return Candidates(
        x=start[row],
        path=behavior,
        plan=plan,
        observation_counts=_by_behavior(senses, path, ends, n_behaviors),
        expected_percepts=_by_behavior(paid, path, ends, n_behaviors),
    )


def _by_behavior(
    amount: NDArray[_Number], path: Ints, ends: Bools, n_behaviors: int
) -> NDArray[_Number]:
    """Sum an amount of the steps of paths (R,L) by behavior, up to each of the J `ends`: (J,E)."""
    rows = np.arange(len(path))
    place = ends.ravel().cumsum().reshape(ends.shape) - 1  # of an end, row by row
    so_far = np.zeros((len(path), n_behaviors), amount.dtype)
    sums = np.empty((int(ends.sum()), n_behaviors), amount.dtype)
    for t in range(path.shape[1]):
        so_far[rows, path[:, t]] += amount[:, t]
        ended = np.flatnonzero(ends[:, t])
        sums[place[ended, t]] = so_far[ended]
    return sums


def sum_up_walks(
    diagram: DiagramPaths, walks: Iterable[Walk], *, prefixes: bool = False
) -> Candidates:
    """Compute the plans of walks of any length, or of all their prefixes."""
    start, paths = zip(*walks, strict=True)
    path = np.array([*itertools.zip_longest(*paths, fillvalue=-1)]).T
    if prefixes:
        return sum_up(diagram, np.array(start), path, path >= 0)
    last = np.arange(path.shape[1]) == (path >= 0).sum(axis=1)[:, None] - 1
    return sum_up(diagram, np.array(start), path, last)


def cheapest(candidates: Candidates) -> Candidates:
    """Return the cheapest of plans with equal x, first behavior and percepts, in order of x."""
    ascending = np.argsort(candidates.plan["cost"], kind="stable")
    action = candidates.plan["action"][ascending]
    counts = candidates.observation_counts[ascending]
    first, _ = distinct(np.column_stack([candidates.x[ascending], action, counts]))
    return candidates.select(ascending[first])


def distinct(rows: Ints) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first index of each distinct row of small integers >= 0, and the inverse."""
    # Rows are compared as strings of big-endian bytes, which have the same order.
    keys = rows.astype(">u2").view(f"S{2 * rows.shape[1]}").ravel()
    return np.unique(keys, return_index=True, return_inverse=True)[1:]


def paid_tours(model: MOMDPArrays, shortest: ShortestPaths) -> Iterator[Walk]:
    """Build tours, which collect percepts with a bonus as long as the bonus exceeds the cost.

    In a large diagram, tours begin only with the first behaviors that have the largest bonus per
    second.
    """
    pay = np.where(model.bonus_limit > 0, model.bonus.mean(axis=2).sum(axis=0), 0.0)
    begins = shortest.first_action >= 0
    most = max(_TOURS // len(begins), 1)
    promise = np.where(begins, pay / (shortest.cost + 1e-6), -np.inf)
    begins &= (-promise).argsort(axis=1, kind="stable").argsort(axis=1) < most
    for x, first in np.argwhere(begins).tolist():
        path: tuple[int, ...] = ()
        state = x
        goal = first
        unpaid = np.ones(len(pay), np.bool_)
        while goal >= 0 and len(path) < LENGTH:
            path = (*path, *shortest.path(state, goal))
            state = int(shortest.end[state, goal])
            unpaid[list(path)] = False
            # The bonus of first percepts on a path, minus the cost of the path.
            gain = (shortest.observation_counts[state] > 0) @ (pay * unpaid) - shortest.cost[state]
            gain = np.where(unpaid & (shortest.first_action[state] >= 0), gain, -np.inf)
            goal = int(gain.argmax()) if gain.max() > 0 else -1
        yield x, path[:LENGTH]


def plan_suffixes(plans: Candidates, shortest: ShortestPaths) -> Iterator[Walk]:
    """Yield plans, and the rest of each plan after each of its steps."""
    for x, row in zip(plans.x.tolist(), plans.path, strict=True):
        state = x
        path = row[row >= 0].tolist()
        while path:
            yield state, path
            state = int(shortest.target[state, path[0]])
            path = path[1:]

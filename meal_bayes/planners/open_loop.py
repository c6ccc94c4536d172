"""Open-loop plans of any transition diagram: the library behind the leaf and the OLFC planner."""

import heapq
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.leaf import (
    SPAN,
    Beliefs,
    Macros,
    Plans,
    Work,
    grow_plans,
    plan_values,
    room_for,
    tabulate_errors,
)

_GROWN = 3  # beliefs for which plans are grown from every x, to every first percept
_JUDGED = 32  # beliefs at which plans compete to be kept
_LENGTH = 6  # greedy steps of a plan
_KEPT = 28  # plans an x, besides one for every first behavior
_GRID = 129  # points of an error table

_DIAGRAMS = 16  # whose moves are remembered

Path = tuple[int, ...]  # behaviors in order


class Moves(NamedTuple):
    """A diagram seen without chance: of several outcomes a plan follows the likeliest."""

    target: NDArray[np.int64]  # (X,E)
    senses: NDArray[np.bool_]  # (X,E)
    paths: dict[tuple[int, int], Path]  # (x, behavior) -> cheapest way to its percept, executed
    macros: Macros
    walked: "dict[tuple[int, Path], Walked]"  # walks already taken


class Walked(NamedTuple):
    """What a path from some x comes to."""

    x: int  # afterwards
    cost: float  # discounted folded cost, s
    discount: float
    uses: NDArray[np.int64]  # (E,) percepts gathered
    weight: NDArray[np.float64]  # (E,) discounted expected executions


_MADE: dict[bytes, Moves] = {}


def plans_for(problem: Compiled) -> Plans:
    """Make the plan library of a MOMDP.

    For a fixed spread of beliefs, a plan is grown from every x; its prefixes, and their suffixes
    from each x on their way, compete at further beliefs, and the winners are kept. Every legal
    behavior keeps its best plan, so that none is without a lower bound.
    """
    n = problem.confusion.shape[0]
    rng = np.random.Generator(np.random.PCG64(n))
    spread = np.concatenate([np.zeros((1, n)), rng.uniform(-4.0, 4.0, (_JUDGED, n))])
    beliefs = Beliefs(np.repeat(problem.prior[None], len(spread), axis=0), spread)
    first = Beliefs(beliefs.told[:_GROWN].copy(), beliefs.felt[:_GROWN].copy())
    moves, work = moves_of(problem), room_for(problem)
    found: list[set[Path]] = [{(int(a),) for a in np.flatnonzero(legal)} for legal in problem.legal]
    for x in range(len(found)):
        if found[x]:
            grown = np.full((_GROWN * problem.legal.shape[1], 3 * _LENGTH), -1)
            grow_plans(problem, moves.macros, x, first, _LENGTH, work, grown)
            prefixes = {path for row in grown for path in _prefixes(moves, x, row)}
            best = _winners(problem, moves, work, x, sorted(prefixes | found[x]), beliefs)
            for path in best:
                _spread_suffixes(moves, x, path, found)
    groups = [
        _winners(problem, moves, work, x, sorted(paths), beliefs) for x, paths in enumerate(found)
    ]
    plans = _arrays(problem, moves, groups)
    if problem.tabled:
        points = np.repeat(np.linspace(-SPAN, SPAN, _GRID)[:, None], n, axis=1)
        grid = Beliefs(points, np.zeros_like(points))
        errors = np.empty((len(plans.action), n, _GRID))
        tabulate_errors(problem, plans, grid, work, errors)
        plans = plans._replace(errors=errors)
    return plans


def moves_of(problem: Compiled) -> Moves:
    """Find the cheapest way from every x to a percept of every behavior (Dijkstra).

    It depends on diagram, costs and discount alone, which a run's MOMDPs share: made once.
    """
    moving = (problem.legal, problem.cost, problem.discount, problem.branch_p, problem.branch_x)
    key = b"".join(array.tobytes() for array in (*moving, problem.branch_sense))
    if key not in _MADE:
        if len(_MADE) >= _DIAGRAMS:
            _MADE.clear()
        _MADE[key] = _find_moves(problem)
    return _MADE[key]


def _find_moves(problem: Compiled) -> Moves:
    size, n_behaviors = problem.legal.shape
    likely = problem.branch_p.argmax(axis=2)[:, :, None]
    target = np.take_along_axis(problem.branch_x, likely, axis=2)[:, :, 0]
    senses = np.take_along_axis(problem.branch_sense, likely, axis=2)[:, :, 0]
    paths: dict[tuple[int, int], Path] = {}
    for start in range(size):
        queue: list[tuple[float, int, Path]] = [(0.0, start, ())]
        reached: set[int] = set()
        while queue:
            cost, x, path = heapq.heappop(queue)
            if x in reached:
                continue
            reached.add(x)
            for a in map(int, np.flatnonzero(problem.legal[x])):
                if senses[x, a]:
                    paths.setdefault((start, a), (*path, a))
                step = cost + float(problem.cost[x, a])
                heapq.heappush(queue, (step, int(target[x, a]), (*path, a)))
    macros = Macros(
        first=np.full((size, n_behaviors), -1),
        end=np.zeros((size, n_behaviors), dtype=np.int64),
        cost=np.zeros((size, n_behaviors)),
        uses=np.zeros((size, n_behaviors, n_behaviors), dtype=np.int64),
    )
    nothing, unweighted = np.zeros(n_behaviors, dtype=np.int64), np.zeros(n_behaviors)
    walked: dict[tuple[int, Path], Walked] = {
        (x, ()): Walked(x, 0.0, 1.0, nothing, unweighted) for x in range(size)
    }
    moves = Moves(target, senses, paths, macros, walked)
    for row, path in paths.items():
        macros.first[row] = path[0]
        end = _walk(problem, moves, row[0], path)
        macros.end[row], macros.cost[row], macros.uses[row] = end.x, end.cost, end.uses
    return moves


def _walk(problem: Compiled, moves: Moves, x: int, path: Path) -> Walked:
    """Walk a path; its first part is looked up, as plans share beginnings."""
    known = moves.walked.get((x, path))
    if known is None:
        before = _walk(problem, moves, x, path[:-1])
        a, here = path[-1], before.x
        uses, weight = before.uses.copy(), before.weight.copy()
        uses[a] += moves.senses[here, a]
        weight[a] += before.discount * problem.bonus_scale[here, a]
        known = Walked(
            int(moves.target[here, a]),
            before.cost + before.discount * float(problem.cost[here, a]),
            before.discount * float(problem.discount[here, a]),
            uses,
            weight,
        )
        moves.walked[x, path] = known
    return known


def _prefixes(moves: Moves, x: int, row: NDArray[np.int64]) -> list[Path]:
    path: Path = ()
    prefixes = []
    for e in map(int, row[row >= 0]):
        step = moves.paths[x, e]
        for a in step:
            x = int(moves.target[x, a])
        path = (*path, *step)
        prefixes.append(path)
    return prefixes


def _spread_suffixes(moves: Moves, x: int, path: Path, found: list[set[Path]]) -> None:
    for k in range(len(path)):
        found[x].add(path[k:])
        x = int(moves.target[x, path[k]])


def _winners(
    problem: Compiled, moves: Moves, work: Work, x: int, paths: list[Path], beliefs: Beliefs
) -> list[Path]:
    """Keep the paths from x that are best at one of the beliefs, and the best of each start."""
    if not paths:
        return []
    groups = [paths if state == x else [] for state in range(len(moves.target))]
    plans = _arrays(problem, moves, groups)
    values = np.full((len(beliefs.told), len(paths)), -np.inf)
    plan_values(problem, plans, x, beliefs, work, values)
    wins = np.bincount(values.argmax(axis=1), minlength=len(paths))
    kept = {int(j) for j in np.argsort(-wins, kind="stable")[:_KEPT] if wins[j]}
    for a in np.unique(plans.action):
        mine = np.flatnonzero(plans.action == a)
        kept.add(int(mine[values[:, mine].max(axis=0).argmax()]))
    return [paths[j] for j in sorted(kept)]


def _arrays(problem: Compiled, moves: Moves, groups: Sequence[Sequence[Path]]) -> Plans:
    n_behaviors = problem.legal.shape[1]
    walked = [_walk(problem, moves, x, path) for x, paths in enumerate(groups) for path in paths]
    counts = [len(paths) for paths in groups]
    return Plans(
        first=np.concatenate([[0], np.cumsum(counts)]).astype(np.int64),
        action=np.array([path[0] for paths in groups for path in paths], dtype=np.int64),
        cost=np.array([walk.cost for walk in walked]),
        discount=np.array([walk.discount for walk in walked]),
        uses=np.array([walk.uses for walk in walked], dtype=np.int64).reshape(-1, n_behaviors),
        weight=np.array([walk.weight for walk in walked]).reshape(-1, n_behaviors),
        errors=np.zeros((0, 0, 0)),
    )

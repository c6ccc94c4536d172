"""Open-loop plans of any transition diagram: the library behind the leaf and the OLFC planner."""

import heapq
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.search import (
    SPAN,
    Macros,
    Plans,
    grow_plans,
    plan_values,
    tabulate_errors,
)

_GROWN = 16  # beliefs an x for which plans are grown
_JUDGED = 32  # beliefs at which plans compete to be kept
_LENGTH = 12  # greedy steps of a plan
_KEPT = 28  # plans an x, besides one for every first behavior
_GRID = 129  # points of an error table

Path = tuple[int, ...]  # behaviors in order


class Moves(NamedTuple):
    """A diagram seen without chance: of several outcomes a plan follows the likeliest."""

    target: NDArray[np.int64]  # (X,E)
    senses: NDArray[np.bool_]  # (X,E)
    paths: dict[tuple[int, int], Path]  # (x, behavior) -> cheapest way to its percept, executed
    macros: Macros


def plans_for(problem: Compiled) -> Plans:
    """Make the plan library of a MOMDP.

    For a fixed spread of beliefs, a plan is grown from every x; its prefixes, and their suffixes
    from each x on their way, compete at further beliefs, and the winners are kept. Every legal
    behavior keeps its best plan, so that none is without a lower bound.
    """
    n = problem.confusion.shape[0]
    rng = np.random.Generator(np.random.PCG64(n))
    beliefs = np.concatenate([np.zeros((1, n)), rng.uniform(-4.0, 4.0, (_JUDGED, n))])
    moves = moves_of(problem)
    found: list[set[Path]] = [
        {(int(a),) for a in np.flatnonzero(legal)} for legal in problem.legal
    ]
    for x in range(len(found)):
        if found[x]:
            grown = grow_plans(problem, moves.macros, x, beliefs[:_GROWN], _LENGTH)
            prefixes = {path for row in grown for path in _prefixes(moves, x, row)}
            best = _winners(problem, moves, x, sorted(prefixes | found[x]), beliefs)
            for path in best:
                _spread_suffixes(moves, x, path, found)
    groups = [
        _winners(problem, moves, x, sorted(paths), beliefs) for x, paths in enumerate(found)
    ]
    plans = _arrays(problem, moves, groups)
    if problem.exact_rows:
        grid = np.linspace(-SPAN, SPAN, _GRID)
        plans = plans._replace(errors=tabulate_errors(problem, plans, grid))
    return plans


def moves_of(problem: Compiled) -> Moves:
    """Find the cheapest way from every x to a percept of every behavior (Dijkstra)."""
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
    moves = Moves(target, senses, paths, macros)
    for row, path in paths.items():
        macros.first[row] = path[0]
        walked = _walk(problem, moves, row[0], path)
        macros.end[row], macros.cost[row], macros.uses[row] = walked.x, walked.cost, walked.uses
    return moves


class _Walked(NamedTuple):
    x: int
    cost: float
    discount: float
    uses: NDArray[np.int64]  # (E,)
    weight: NDArray[np.float64]  # (E,)


def _walk(problem: Compiled, moves: Moves, x: int, path: Path) -> _Walked:
    n_behaviors = problem.legal.shape[1]
    cost, discount = 0.0, 1.0
    uses, weight = np.zeros(n_behaviors, dtype=np.int64), np.zeros(n_behaviors)
    for a in path:
        cost += discount * float(problem.cost[x, a])
        weight[a] += discount * problem.bonus_scale[x, a]
        discount *= float(problem.discount[x, a])
        uses[a] += moves.senses[x, a]
        x = int(moves.target[x, a])
    return _Walked(x, cost, discount, uses, weight)


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
    problem: Compiled, moves: Moves, x: int, paths: list[Path], beliefs: NDArray[np.float64]
) -> list[Path]:
    """Keep the paths from x that are best at one of the beliefs, and the best of each start."""
    if not paths:
        return []
    plans = _arrays(problem, moves, [paths if state == x else [] for state in range(len(moves.target))])
    values = np.full((len(beliefs), len(paths)), -np.inf)
    plan_values(problem, plans, x, beliefs, values)
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

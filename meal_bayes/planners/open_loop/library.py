"""Open-loop plans of any transition diagram: the library behind `OpenLoop` and the search."""

import heapq
import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.open_loop.errors import Work, tabulate_rules
from meal_bayes.planners.open_loop.values import Macros, Plans, grow_plans, plan_values, room_for

_GROWN = 8  # beliefs for which plans are grown from every x, to every first percept
_JUDGED = 96  # beliefs at which plans compete to be kept
_ROUNDS = 8  # of moving them apart
_LENGTH = 16  # greedy steps of a plan, each one to three percepts
_KEPT = 28  # plans an x, besides one for every first behavior and what is left of them on the way
_GRID = 129  # log-odds of a table of decision rules

_DIAGRAMS = 16  # whose moves are remembered

Path = tuple[int, ...]  # behaviors in order


class Moves(NamedTuple):
    """A diagram seen without chance: of several outcomes a plan follows the likeliest."""

    target: NDArray[np.int64]  # (X,E)
    senses: NDArray[np.bool_]  # (X,E)
    paths: dict[tuple[int, int], Path]  # (x, behavior) -> cheapest way to its percept, executed
    macros: Macros
    walked: "dict[tuple[int, Path], Walked]"  # walks already taken
    mixtures: dict[int, frozenset[Path]]  # by x, made when first asked for


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

    For a fixed spread of beliefs, plans are grown from every x; they and their beginnings compete
    at further beliefs, and the winners are kept. Every legal behavior keeps its best plan, so
    that none is without a lower bound. What is left of a kept plan after each of its steps is kept
    as well: who follows a plan and looks again can only gain, and never puts off its end.
    """
    n = problem.confusion.shape[0]
    rng = np.random.Generator(np.random.PCG64(n))
    spread = np.concatenate([np.zeros((1, n)), rng.uniform(-4.0, 4.0, (_JUDGED, n))])
    beliefs = _tilted(problem, spread)
    first = beliefs[:_GROWN]
    moves, work = moves_of(problem), room_for(problem)
    kept: list[set[Path]] = [set() for _ in problem.legal]
    for x, legal in enumerate(problem.legal):
        if legal.any():
            grown = np.full((_GROWN * len(legal), 3 * _LENGTH), -1)
            grow_plans(problem, moves.macros, x, first, _LENGTH, work, grown)
            found = {path for row in grown for path in _prefixes(moves, x, row)}
            found |= {(int(a),) for a in np.flatnonzero(legal)} | _mixtures(moves, x)
            if problem.shaped:
                found |= _tours(problem, moves, x)
            for path in _winners(problem, moves, work, x, sorted(found), beliefs):
                _add_with_rests(moves, x, path, kept)
    plans = _arrays(problem, moves, [_cheapest(problem, moves, x, p) for x, p in enumerate(kept)])
    return _with_rules(problem, plans, work)


def _tilted(problem: Compiled, spread: NDArray[np.float64]) -> NDArray[np.float64]:
    """Move the prior's log-odds by a spread (B,N) -> Pr(kind) (B,N,C), as percepts would.

    Evidence weighs the kinds by exp(s Pr(true | kind)), which moves the log-odds by s at most, and
    by s where the kind is the truth. Elsewhere more is added, but not for ever: of kinds that both
    truths share none may be sure enough.
    """
    false, true = problem.share.transpose(1, 0, 2)  # (N,C)

    def log_odds(beliefs: NDArray[np.float64]) -> NDArray[np.float64]:
        yes, no = ((beliefs * share).sum(axis=-1).clip(1e-300) for share in (true, false))
        return np.asarray(np.log(yes / no))

    wanted, beliefs = log_odds(problem.prior) + spread, problem.prior[None]
    evidence = np.zeros_like(spread)
    for _ in range(_ROUNDS):
        evidence = evidence + wanted - log_odds(beliefs)
        beliefs = problem.prior * np.exp(evidence[:, :, None] * true)
    return np.asarray(beliefs / beliefs.sum(axis=2, keepdims=True))


def no_plans(problem: Compiled) -> Plans:
    """Make an empty library."""
    return _arrays(problem, moves_of(problem), [[] for _ in problem.legal])


def _with_rules(problem: Compiled, plans: Plans, work: Work) -> Plans:
    """Tabulate the decision rules; plans that tell the same of an attribute share a row."""
    n, tables, rule = problem.confusion.shape[0], 0, np.zeros((len(plans.action), 0), np.int64)
    uses, attribute = [], []
    for i in range(n):
        told, row = np.unique(plans.uses * problem.informative[i], axis=0, return_inverse=True)
        rule = np.concatenate([rule, row.reshape(-1, 1) + tables], axis=1)
        uses.append(told)
        attribute += [i] * len(told)
        tables += len(told)
    errs = np.empty((_GRID, tables, problem.prior.shape[1]))
    tabulate_rules(problem, np.concatenate(uses), np.array(attribute), work, errs)
    return plans._replace(rule=rule, errs=errs)


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
    moves = Moves(target, senses, paths, macros, walked, {})
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
        step = moves.paths.get((x, e))
        if step is None:  # no way back to it
            break
        for a in step:
            x = int(moves.target[x, a])
        path = (*path, *step)
        prefixes.append(path)
    return prefixes


def _mixtures(moves: Moves, x: int) -> frozenset[Path]:
    """One or two percepts of one behavior, then none, one or two of another, as far as one gets."""
    if x not in moves.mixtures:
        reached = [e for start, e in moves.paths if start == x]
        rows = itertools.product(reached, (1, 2), reached, (0, 1, 2))
        walks = (np.array([e] * k + [f] * more) for e, k, f, more in rows)
        moves.mixtures[x] = frozenset(_prefixes(moves, x, walk)[-1] for walk in walks)
    return moves.mixtures[x]


def _tours(problem: Compiled, moves: Moves, x: int) -> set[Path]:
    """From every first behavior on, go to what pays best for a first percept, while it pays."""
    pay = np.where(problem.paid > 0, problem.bonus.mean(axis=2).sum(axis=0), 0.0).tolist()
    tours: set[Path] = set()
    for start, first in moves.paths:
        if start != x:
            continue
        path: Path = ()
        left, e, here = set(range(len(pay))), first, x
        while e >= 0:
            path = (*path, *moves.paths[here, e])
            here = moves.macros.end[here, e]
            left -= set(path)
            tours.add(path)
            gain, e = max(
                (
                    (sum(pay[a] for a in left.intersection(moves.paths[here, other]))
                     - moves.macros.cost[here, other], other)
                    for other in left
                    if (here, other) in moves.paths
                ),
                default=(0.0, -1),
            )  # fmt: skip
            e = e if gain > 0 else -1
    return tours


def _add_with_rests(moves: Moves, x: int, path: Path, kept: list[set[Path]]) -> None:
    for k in range(len(path)):
        kept[x].add(path[k:])
        x = int(moves.target[x, path[k]])


def _cheapest(problem: Compiled, moves: Moves, x: int, paths: set[Path]) -> list[Path]:
    """Of plans with the same beginning and the same percepts keep the cheapest."""
    best: dict[tuple[int, bytes], tuple[float, Path]] = {}
    for path in sorted(paths):
        walk = _walk(problem, moves, x, path)
        key = path[0], walk.uses.tobytes()
        best[key] = min(best.get(key, (np.inf, path)), (walk.cost, path))
    return [path for _, path in best.values()]


def _winners(
    problem: Compiled,
    moves: Moves,
    work: Work,
    x: int,
    paths: list[Path],
    beliefs: NDArray[np.float64],
) -> list[Path]:
    """Keep the paths from x that are best at one of the beliefs, and the best of each start."""
    if not paths:
        return []
    groups = [paths if state == x else [] for state in range(len(moves.target))]
    plans = _with_rules(problem, _arrays(problem, moves, groups), work)
    values = np.full((len(beliefs), len(paths)), -np.inf)
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
        rule=np.zeros((0, 0), np.int64),
        errs=np.zeros((_GRID, 0, problem.prior.shape[1])),
    )

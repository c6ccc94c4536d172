"""The library of open-loop plans of a MOMDP: grown, selected, compared, and tabulated."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP
from meal_bayes.momdp.observation import predictive
from meal_bayes.planners.compiled import Compiled, Dynamics, remember
from meal_bayes.planners.open_loop import errors
from meal_bayes.planners.open_loop.growth import Growth, Ways, find_ways, grow_plans
from meal_bayes.planners.open_loop.values import PLAN, Plans, best_plans, plan_scratch

_GROWN = 4  # beliefs for which plans are grown from every x, to every first percept
_JUDGED, _MANY = 16, 5  # times N, up to N = 5: beliefs at which plans compete to be kept
_ROUNDS = 6  # of moving them apart
_LENGTH = 96  # behaviors of a plan
_KEPT = 14  # plans an x, besides one for every first behavior and what is left of them on the way
_CANDIDATES = 10  # times N: candidates an x and a belief that are looked at closely
_BEGUN = 2  # and of each first behavior
_COUNTED = 8  # percepts of one behavior that growing looks ahead to

_Walk = tuple[int, Sequence[int]]  # an x, and behaviors from there


class Candidates(NamedTuple):
    """Plans with the paths that they follow."""

    x: Ints  # (J,) where they start
    path: NDArray[np.int16]  # (J,L) behaviors, padded by -1
    plan: NDArray[np.void]  # as in `Plans`, like the following
    observation_counts: Ints
    executions: Floats

    def select(self, rows: NDArray[np.intp]) -> "Candidates":
        """Select some of them."""
        return Candidates._make(part[rows] for part in self)


@dataclass(frozen=True)
class Diagram:
    """What plans need of a diagram; made once for all MOMDPs that share it."""

    dynamics: Dynamics
    ways: Ways

    @cached_property
    def simple(self) -> Candidates:
        """Every legal behavior; one or two percepts of one, then none, one or two of another."""
        legal = self.dynamics.step["legal"]
        paths = set[tuple[int, tuple[int, ...]]]((x, (a,)) for x, a in np.argwhere(legal).tolist())
        for x in range(len(legal)):
            goals = np.flatnonzero(self.ways.hop[x] >= 0).tolist()
            for e, k, f, more in itertools.product(goals, (1, 2), goals, (0, 1, 2)):
                path: tuple[int, ...] = ()
                state = x
                for goal in [e] * k + [f] * more:
                    if self.ways.hop[state, goal] < 0:
                        break  # there is no way back
                    path = (*path, *self.ways.path(state, goal))
                    state = int(self.ways.end[state, goal])
                paths.add((x, path[:_LENGTH]))
        return _cheapest(_complete(self, sorted(paths)))


_known: dict[object, Diagram] = {}  # by the identity of dynamics that they hold


def diagram_of(dynamics: Dynamics) -> Diagram:
    """Find the ways of a diagram, once."""
    return remember(_known, id(dynamics.step), lambda: Diagram(dynamics, find_ways(dynamics)))


def plan_library(momdp: MOMDP, problem: Compiled) -> Plans:
    """Build the plan library of a MOMDP.

    For a spread of beliefs, plans are grown from every x; they and their beginnings compete at
    further beliefs, and the winners are kept. Every legal behavior keeps its best plan, so that
    none is without a lower bound. What is left of a kept plan after each of its steps is kept as
    well: who follows a plan and looks again can only gain, and never puts off its end.
    """
    diagram, n = diagram_of(problem.dynamics), len(momdp.query)
    if not problem.dynamics.step["legal"].any():  # nothing can be done, as where everything fails
        size, behaviors = problem.dynamics.step.shape
        first, none = np.zeros(size + 1, np.int64), np.zeros((0, behaviors), np.int64)
        table = np.ones((1, errors.THRESHOLDS, problem.percepts.rows.shape[2]))
        return Plans(first, np.zeros((0,), PLAN), none, none.astype(float), none[:, :n], table)
    rng = np.random.Generator(np.random.PCG64(n))
    spread = rng.uniform(-4.0, 4.0, (_JUDGED * min(n, _MANY), n))
    beliefs = _tilted(momdp, problem, np.concatenate([0 * spread[:1], spread]))
    bhattacharyya = _log_bhattacharyya(problem)
    chance = (beliefs * problem.percepts.truth[:, 1]).sum(axis=2)  # (B,N)
    parts = [_grow(problem, diagram, chance[:_GROWN], bhattacharyya), diagram.simple]
    if problem.shaped and (diagram.ways.hop >= 0).any():
        parts.append(_complete(diagram, _tours(problem, diagram.ways), whole=False))
    candidates = _cheapest(Candidates(*map(np.concatenate, zip(*parts, strict=True))))
    candidates = candidates.select(_promising(problem, candidates, chance, bhattacharyya))
    plans = _tabulated(problem, candidates, errors.FEW_OUTCOMES)
    wins = np.zeros(len(plans.plan), np.int64)  # beliefs at which a plan is the best of its x
    wins_most = np.zeros(len(plans.plan), np.bool_)
    scratch, every = plan_scratch(problem.percepts, plans), np.arange(momdp.n_behaviors)
    for x, (start, end) in enumerate(itertools.pairwise(plans.first.tolist())):
        value, best = best_plans(problem, plans, x, beliefs, scratch)  # (B,E)
        highest = (value == value.max(axis=1, keepdims=True)) & (best >= 0)
        np.add.at(wins, best[highest], 1)
        peak = best[value.argmax(axis=0), every]  # of each first behavior where it is worth most
        wins_most[peak[peak >= 0]] = True
        often = start + np.argsort(-wins[start:end], kind="stable")[:_KEPT]
        wins_most[often[wins[often] > 0]] = True
    winners = candidates.select(np.flatnonzero(wins_most))
    remainders = _complete(diagram, _remainders(winners, diagram.ways))
    return _tabulated(problem, _cheapest(remainders), errors.OUTCOMES)


def _tilted(momdp: MOMDP, problem: Compiled, spread: Floats) -> Floats:
    """Move the prior's log-odds by a spread (B,N) -> Pr(latent class) (B,N,C), as percepts would.

    Evidence weighs the classes by exp(s Pr(true | class)), which moves the log-odds by s where the
    class is the truth. Elsewhere by less, so more is added; of shared classes none may suffice.
    """
    false, true = problem.percepts.truth.transpose(1, 0, 2)  # (N,C)

    def log_odds(beliefs: Floats) -> Floats:
        yes, no = ((beliefs * likelihood).sum(axis=-1).clip(1e-300) for likelihood in (true, false))
        return np.asarray(np.log(yes / no))

    chance = np.clip(np.stack([1 - momdp.prior, momdp.prior], axis=1), 1e-9, 1.0)  # (N,2)
    prior = np.clip((chance[:, :, None] * momdp.latent_classes).sum(axis=1), 1e-21, 1.0)  # (N,C)
    prior /= prior.sum(axis=1, keepdims=True)
    wanted, beliefs = log_odds(prior) + spread, prior[None]
    evidence = np.zeros_like(spread)
    for _ in range(1 if problem.percepts.class_is_truth else _ROUNDS):
        evidence = evidence + wanted - log_odds(beliefs)
        beliefs = prior * np.exp(evidence[:, :, None] * true)
    return np.ascontiguousarray(beliefs / beliefs.sum(axis=2, keepdims=True))


def _log_bhattacharyya(problem: Compiled) -> Floats:
    """Compute log sum_j sqrt(Pr(j of k say yes | true) Pr(j | false)), (N,E,U) for k < U."""
    percepts = problem.percepts
    yes = percepts.rows[..., percepts.rows.shape[3] // 2 :].sum(axis=-1)[..., None]  # (N,E,C,1)
    s, j = percepts.precision[..., None], np.arange(_COUNTED)
    counts = np.zeros((*yes.shape[:3], _COUNTED))
    counts[..., 0] = 1.0
    out = np.zeros((*yes.shape[:2], _COUNTED))
    for k in range(_COUNTED - 1):
        more = counts[..., :-1] * predictive(yes, s, j, k)[..., :-1]
        counts[..., :-1] -= more
        counts[..., 1:] += more
        by_truth = percepts.classes[:, None] @ counts  # (N,E,2,U)
        both = np.sqrt(by_truth[:, :, 0] * by_truth[:, :, 1])[..., : k + 2].sum(axis=-1)
        out[..., k + 1] = np.log(both + 1e-300)
    return np.where(percepts.informative[..., None], out, 0.0)


def _grow(problem: Compiled, diagram: Diagram, chance: Floats, bhattacharyya: Floats) -> Candidates:
    """Grow plans at beliefs (B,N) from every x to every first percept; with their beginnings."""
    step, limit = problem.dynamics.step, problem.percepts.limit
    size, n = step.shape
    path = np.full((size, len(chance), n, _LENGTH), -1)
    ends = np.zeros(path.shape, np.bool_)
    cost = np.where(diagram.ways.senses & step["legal"], step["cost"], np.inf).min(axis=0)
    rate = (-bhattacharyya[..., 1] / cost).max(axis=1)  # (N,)
    growth = Growth(
        bhattacharyya, rate, limit, problem.incorrect, problem.gap,
        np.zeros(n, np.int64), np.zeros((2, len(rate))),
    )  # fmt: skip
    length = grow_plans(diagram.ways, growth, chance, path, ends)
    start, shape = np.repeat(np.arange(size), len(chance) * n), (-1, length)
    beginnings = ends[..., :length].reshape(shape)
    return _summed_up(diagram, start, path[..., :length].reshape(shape), beginnings)


def _promising(
    problem: Compiled, candidates: Candidates, chance: Floats, bhattacharyya: Floats
) -> NDArray[np.intp]:
    """Select candidates by an estimate of their values at beliefs (B,N).

    An error is at most sqrt(b (1 - b)) times the Bhattacharyya coefficient of the percepts
    [Kailath1967]. The best few from each x at each belief stay, and _BEGUN of each first behavior.
    """
    within = np.minimum(problem.percepts.limit, _COUNTED - 1).astype(np.int64)
    counts = np.minimum(candidates.observation_counts, within)
    affine = np.exp(bhattacharyya[:, np.arange(counts.shape[1]), counts].sum(axis=2))  # (N,J)
    right = np.ones((len(chance), len(counts)))
    for unsure, each in zip(np.sqrt(chance * (1.0 - chance)).T, affine, strict=True):
        right *= 1.0 - unsure[:, None] * each
    cost, discount = candidates.plan["cost"], candidates.plan["discount"]
    value = discount * (problem.incorrect + problem.gap * right) - cost  # (B,J)
    if problem.shaped:
        paid = np.minimum(1.0, problem.paid / np.maximum(candidates.observation_counts, 1))
        pay = problem.bonus.mean(axis=2).sum(axis=0)
        value += (paid * (candidates.observation_counts > 0) * candidates.executions) @ pay
    peak, action = value.max(axis=0), candidates.plan["action"]
    order = np.lexsort((-peak, action, candidates.x))
    group = candidates.x[order] * counts.shape[1] + action[order]
    chosen = np.zeros(len(peak), np.bool_)
    chosen[order[np.arange(len(group)) - np.searchsorted(group, group) < _BEGUN]] = True
    most = _CANDIDATES * min(len(bhattacharyya), _MANY)
    for same in np.split(np.arange(len(peak)), np.flatnonzero(np.diff(candidates.x)) + 1):
        best = np.argpartition(-value[:, same], min(most, len(same) - 1), axis=1)[:, :most]
        chosen[same[best]] = True
    return np.flatnonzero(chosen)


def _distinct(rows: Ints) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Find the first of each distinct row of small integers >= 0, and each row's place in these."""
    keys = rows.astype(">u2").view(f"S{2 * rows.shape[1]}").ravel()
    return np.unique(keys, return_index=True, return_inverse=True)[1:]


def _summed_up(diagram: Diagram, start: Ints, path: Ints, ends: NDArray[np.bool_]) -> Candidates:
    """Sum up the beginnings of paths (R,L) from start (R,) that stop behind the steps `ends`."""
    length, x = path.shape[1], np.empty_like(path)
    x[:, 0] = start
    for t in range(length - 1):
        x[:, t + 1] = diagram.ways.target[x[:, t], path[:, t]]
    step = diagram.dynamics.step[x, path]
    # cost = sum_k (prod_{j<k} g_j) c_k, discount = prod_k g_k
    discount = step["discount"].cumprod(axis=1)
    before = np.hstack([np.ones((len(path), 1)), discount[:, :-1]])
    cost, executed = (before * step["cost"]).cumsum(axis=1), before * step["bonus_scale"]
    r, end = np.nonzero(ends)
    cut = np.full((len(r), _LENGTH), -1, np.int16)  # copying paths would take half of the time
    cut[:, :length] = np.where(np.arange(length) <= end[:, None], path.astype(np.int16)[r], -1)
    plan = np.zeros(len(r), PLAN)
    plan["action"], plan["cost"], plan["discount"] = path[r, 0], cost[r, end], discount[r, end]
    sums = []
    for each in (diagram.ways.senses[x, path].astype(np.int64), executed):
        steps = np.zeros((*path.shape, diagram.dynamics.step.shape[1]), each.dtype)  # (R,L,E)
        np.put_along_axis(steps, path[..., None], each[..., None], axis=2)
        sums.append(steps.cumsum(axis=1, out=steps)[r, end])
    return Candidates(start[r], cut, plan, *sums)


def _complete(diagram: Diagram, walks: Iterable[_Walk], *, whole: bool = True) -> Candidates:
    """Sum up walks (R) of any length, whole or in all their beginnings."""
    start, paths = zip(*walks, strict=True)
    path = np.array([*itertools.zip_longest(*paths, fillvalue=-1)]).T
    last = np.arange(path.shape[1]) == (path >= 0).sum(axis=1)[:, None] - 1
    return _summed_up(diagram, np.array(start), path, last if whole else path >= 0)


def _tours(problem: Compiled, ways: Ways) -> Iterator[_Walk]:
    """Build tours: after every first behavior, to the best-paid first percept while it pays."""
    pay = np.where(problem.paid > 0, problem.bonus.mean(axis=2).sum(axis=0), 0.0)
    for x, first in np.argwhere(ways.hop >= 0).tolist():
        path: tuple[int, ...] = ()
        state, goal, left = x, first, np.ones(len(pay), np.bool_)
        while goal >= 0 and len(path) < _LENGTH:
            path = (*path, *ways.path(state, goal))
            state = int(ways.end[state, goal])
            left[list(path)] = False
            gain = (ways.observation_counts[state] > 0) @ (pay * left) - ways.cost[state]
            gain = np.where(left & (ways.hop[state] >= 0), gain, -np.inf)
            goal = int(gain.argmax()) if gain.max() > 0 else -1
        yield x, path[:_LENGTH]


def _cheapest(candidates: Candidates) -> Candidates:
    """Keep the cheapest plan of equal x, first behavior and percepts, in order of x."""
    cost = np.argsort(candidates.plan["cost"], kind="stable")
    x, action = candidates.x[cost], candidates.plan["action"][cost]
    first, _ = _distinct(np.column_stack([x, action, candidates.observation_counts[cost]]))
    return candidates.select(cost[first])


def _remainders(plans: Candidates, ways: Ways) -> Iterator[_Walk]:
    """List plans, and what is left of them after each of their steps."""
    for x, row in zip(plans.x.tolist(), plans.path, strict=True):
        state, path = x, row[row >= 0].tolist()
        while path:
            yield state, path
            state, path = int(ways.target[state, path[0]]), path[1:]


def _tabulated(problem: Compiled, candidates: Candidates, held: int) -> Plans:
    """Make plans of candidates, which are in order of x, with their errors."""
    first = np.searchsorted(candidates.x, np.arange(problem.dynamics.step.shape[0] + 1))
    empty = np.empty((0, 0), np.int64), np.empty((0, 0, 0))
    return retabulate(Plans(first, *candidates[2:], *empty), problem, held)


def retabulate(plans: Plans, problem: Compiled, held: int = errors.OUTCOMES) -> Plans:
    """Tabulate the errors of plans in a MOMDP; equal percepts of an attribute share a row."""
    percepts, tables = problem.percepts, 0
    rows, counts, attribute = [], [], []
    for i, informative in enumerate(percepts.informative):
        told = plans.observation_counts * informative
        distinct, row = _distinct(told)
        rows.append(row + tables)
        counts.append(told[distinct])
        attribute += [i] * len(distinct)
        tables += len(distinct)
    table = np.empty((tables, errors.THRESHOLDS, percepts.rows.shape[2]))
    scratch = errors.make_scratch(percepts, 0, 0, held)
    errors.tabulate_errors(percepts, np.concatenate(counts), np.array(attribute), scratch, table)
    return plans._replace(row=np.column_stack(rows), table=table)

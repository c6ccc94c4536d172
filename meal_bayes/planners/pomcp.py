"""POMCP: online tree search from the exact belief (after [Silver2010]; Bayes-adaptive [Katt2017]).

What departs from textbook POMCP, each because the textbook fails here:

- All 2^N reports are one action whose value is computed, never sampled.
- Nodes carry the exact factored belief (N log-odds; percept counts along the path), no particles.
- New nodes are valued by open-loop plans with exact error rates, not by random roll-outs: a lower
  bound on what can be had there. (Nearly: under Eq. 8 errors are read off a table, to its
  resolution, and on a diagram whose behaviors branch a plan follows the likeliest outcome.)
- Percepts are sampled to decide where the tree grows; values are backed up as exact expectations
  over an edge's outcomes (sampled ones beyond 64). Under finite precision the outcome
  probabilities are the Dirichlet-multinomial predictive: the average over object rows sampled from
  their Dirichlet, without its variance.
"""

import threading
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, best_report, build_momdp, initial_belief, report_value
from meal_bayes.planners.compiled import Compiled, compile_momdp
from meal_bayes.planners.leaf import Beliefs, Plans, lightly_optimized, room_for
from meal_bayes.planners.open_loop import plans_for
from meal_bayes.planners.search import ENUMERATE, SAMPLED, Tree, search
from meal_bayes.planners.solver import Decision, History, TreeEdge

_LOGGED = 40  # edges of the second level that a decision keeps


@dataclass(frozen=True, slots=True)
class POMCP:
    """Settings of the search.

    Raises
    ------
    SettingsError : a negative number of simulations, or an exploration constant below 0.
    """

    simulations: int = 300  # a decision, at most; 0 is open-loop feedback control
    exploration: float = 0.03  # UCB1's c, as a share of r+ - r-
    room: int = 4_000  # nodes; the search ends when they are used up

    def __post_init__(self) -> None:
        if self.simulations < 0 or self.exploration < 0 or self.room < 1:
            raise SettingsError(
                f"POMCP needs simulations >= 0, exploration >= 0, room >= 1; found {self}."
            )

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "POMCPPolicy":
        """Prepare the leaf: the plan library of this MOMDP."""
        compile_kernels()
        return self._prepare(momdp)

    def _prepare(self, momdp: MOMDP) -> "POMCPPolicy":
        problem = compile_momdp(momdp)
        return POMCPPolicy(momdp, self, problem, plans_for(problem))


@dataclass(frozen=True, slots=True)
class POMCPPolicy:
    """Policy of `POMCP`; every decision grows a fresh tree."""

    momdp: MOMDP
    settings: POMCP
    problem: Compiled
    plans: Plans

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Search from the present belief and take the best lower bound."""
        momdp, belief = self.momdp, history.belief
        outcomes = float(momdp.levels) ** len(momdp.query)
        width = 2 * int(outcomes if outcomes <= ENUMERATE else SAMPLED) + 2
        nodes = min(self.settings.room, (self.settings.simulations + 1) * width + 1)
        tree = _room(nodes + width, len(momdp.query), momdp.n_behaviors)
        work = room_for(self.problem)
        work.told[:], work.felt[:] = belief.told, belief.felt
        done = search(
            self.problem,
            self.plans,
            tree,
            work,
            belief.x,
            belief.seen.astype(np.float64),
            belief.seen[0].sum(axis=1).astype(np.float64),
            self.settings.simulations,
            self.settings.exploration * float(momdp.correct - momdp.incorrect),
            rng,
        )
        return _decision(self, history, tree, int(done))


def _decision(policy: POMCPPolicy, history: History, tree: Tree, done: int) -> Decision:
    momdp = policy.momdp
    values = np.append(tree.edge_value[0], tree.stop[0])
    values[np.isneginf(values)] = np.nan
    visits = np.append(tree.edge_visits[0], tree.visits[0] - tree.edge_visits[0].sum())
    action, best = momdp.n_behaviors, int(np.nanargmax(values))
    if best < momdp.n_behaviors and values[best] > values[-1]:
        action = best
    else:
        action = _ending(float(policy.problem.exit_value[history.belief.x]), momdp, history)
    exact = np.where(np.isnan(values), np.nan, 0.0)
    exact[:-1][tree.edge_visits[0] > 0] = _spread(tree)[tree.edge_visits[0] > 0]
    return Decision(action, values, exact, visits, _top(tree), done)


def _ending(exit_value: float, momdp: MOMDP, history: History) -> int:
    """Take the best report, or the cheapest illegal behavior if worth more (abstaining)."""
    if exit_value <= report_value(momdp, history.belief):
        return best_report(momdp, history.belief)
    costs = np.where(momdp.legal[history.belief.x], np.inf, momdp.cost)
    return int(costs.argmin())


def _spread(tree: Tree) -> np.ndarray:
    """Give the standard error that sampling an edge's children as often as visited would have."""
    errors = np.zeros(tree.edge_value.shape[1])
    for a in np.flatnonzero(tree.children[0] >= 0):
        first = tree.children[0, a]
        rows = slice(first, first + tree.child_count[0, a])
        p, value = tree.child_p[rows], tree.value[rows]
        variance = (p * (value - (p * value).sum()) ** 2).sum()
        errors[a] = np.sqrt(variance / tree.edge_visits[0, a])
    return errors


def _top(tree: Tree) -> tuple[TreeEdge, ...]:
    """Take the first two levels of the tree, of the second the most visited."""
    edges = [
        TreeEdge(1, -1, int(a), (), int(tree.edge_visits[0, a]), float(tree.edge_value[0, a]))
        for a in np.flatnonzero(tree.edge_visits[0])
    ]
    below = []
    for parent, edge in enumerate(edges):
        first = int(tree.children[0, edge.action])
        for child in range(first, first + int(tree.child_count[0, edge.action])):
            levels = tuple(int(z) for z in tree.levels[child] if z >= 0)
            for a in np.flatnonzero(tree.edge_visits[child]):
                visits, value = int(tree.edge_visits[child, a]), float(tree.edge_value[child, a])
                below.append(TreeEdge(2, parent, int(a), levels, visits, value))
    below.sort(key=lambda edge: -edge.visits)
    return (*edges, *below[:_LOGGED])


_rooms = threading.local()  # each thread searches in its own


def _room(nodes: int, n_attributes: int, n_behaviors: int) -> Tree:
    """Give room for one search; reused, as allocating it costs more than a short search."""
    size, tree = getattr(_rooms, "last", (None, None))
    if tree is None or size != (nodes, n_attributes, n_behaviors):
        tree = _new_room(nodes, n_attributes, n_behaviors)
        _rooms.last = (nodes, n_attributes, n_behaviors), tree
    return tree


def _new_room(nodes: int, n_attributes: int, n_behaviors: int) -> Tree:
    edges = (nodes, n_behaviors)
    return Tree(
        size=np.zeros(1, np.int64),
        x=np.empty(nodes, np.int64),
        beliefs=Beliefs(np.empty((nodes, n_attributes)), np.empty((nodes, n_attributes))),
        value=np.empty(nodes),
        stop=np.empty(nodes),
        visits=np.empty(nodes, np.int64),
        edge_value=np.empty(edges),
        edge_visits=np.empty(edges, np.int64),
        reward=np.empty(edges),
        children=np.empty(edges, np.int64),
        child_count=np.empty(edges, np.int64),
        child_p=np.empty(nodes),
        levels=np.empty((nodes, n_attributes), np.int64),
    )


@lru_cache(maxsize=1)
def compile_kernels() -> None:
    """Compile the kernels, or load what an earlier process compiled; the first `solve` does it.

    LLVM's full effort takes twice as long and makes nothing faster here, so less is asked for, and
    for these kernels only.
    """
    with lightly_optimized():
        domain, rng = load_domain("toy"), np.random.Generator(np.random.PCG64(0))
        rows = np.broadcast_to([[0.6, 0.4], [0.4, 0.6]], (1, len(domain.behaviors), 2, 2))
        momdp = build_momdp(domain, Query(domain.attributes[:1]), rows)
        POMCP(simulations=1)._prepare(momdp).decide(History(initial_belief(momdp)), rng)

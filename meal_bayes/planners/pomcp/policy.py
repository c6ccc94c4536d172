"""POMCP: online tree search from the exact belief (after [Silver2010]; Bayes-adaptive [Katt2017]).

What departs from textbook POMCP, each because the textbook fails here:

- All 2^N reports are one action whose value is computed, never sampled.
- Nodes carry the exact factored belief (N log-odds; percept counts along the path), no particles.
- New nodes are not valued by random roll-outs. Where the marginals are the state (Eq. 8) and few
  enough, the estimates of factored value iteration value them; everywhere else open-loop plans do,
  with exact error rates: a lower bound that the search raises.
  (Nearly, on a diagram whose behaviors branch: there a plan follows the likeliest outcome.)
- Percepts are sampled to decide where the tree grows; values are backed up as exact expectations
  over an edge's outcomes (sampled ones beyond 64). Under finite precision the outcome
  probabilities are the Dirichlet-multinomial predictive: the average over object rows sampled from
  their Dirichlet, without its variance.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, build_momdp, initial_belief
from meal_bayes.planners.compiled import Compiled, compile_momdp
from meal_bayes.planners.factored.grid import Table, make_scratch
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.open_loop.library import no_plans, plans_for
from meal_bayes.planners.open_loop.values import Plans, room_for
from meal_bayes.planners.pomcp.search import ENUMERATE, Leaf, Tree, search
from meal_bayes.planners.solver import Decision, History, TreeEdge, choose

_LOGGED = 40  # edges of the second level that a decision keeps
_CHUNK = 8  # simulations between two looks at the clock, at first


@dataclass(frozen=True, slots=True)
class POMCP:
    """Settings of the search.

    Raises
    ------
    SettingsError : a negative budget or exploration constant, or no room.
    """

    simulations: int = 300  # a decision, at most
    milliseconds: float | None = None  # of CPU a decision; then as many simulations as it takes
    exploration: float = 0.03  # UCB1's c, as a share of r+ - r-; with a table at the leaf 0
    room: int = 4_000  # nodes; the search ends when they are used up
    points: int = 50_000  # of a table at the leaf, at most; 0 = open-loop plans for every MOMDP

    def __post_init__(self) -> None:
        budget = self.simulations if self.milliseconds is None else self.milliseconds
        if budget < 0 or self.exploration < 0 or self.room < 1 or self.points < 0:
            raise SettingsError(
                f"POMCP needs a budget, exploration and points >= 0, and room >= 1; found {self}."
            )

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "POMCPPolicy":
        """Prepare the leaf: a table over beliefs where one is near exact, or the plan library."""
        compile_kernels()
        return self._prepare(momdp)

    def _prepare(self, momdp: MOMDP) -> "POMCPPolicy":
        problem = compile_momdp(momdp)
        table = self._table(momdp)
        if table is not None:
            return POMCPPolicy(momdp, self, problem, no_plans(problem), table)
        return POMCPPolicy(momdp, self, problem, plans_for(problem), _no_table(momdp))

    def _table(self, momdp: MOMDP) -> Table | None:
        known = np.isinf(momdp.precision).all() and np.isinf(momdp.limit).all()
        if not self.points or not known or not momdp.kind_is_truth:
            return None
        try:
            return Factored(self.points).solve(momdp, np.random.default_rng(0)).estimate
        except SettingsError:  # too many attributes, or shaping that promises without end
            return None


@dataclass(frozen=True, slots=True)
class POMCPPolicy:
    """Policy of `POMCP`; every decision grows a fresh tree."""

    momdp: MOMDP
    settings: POMCP
    problem: Compiled
    plans: Plans
    table: Table

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Search from the present belief and take the best value."""
        begin = time.thread_time()
        momdp, belief, settings = self.momdp, history.belief, self.settings
        outcomes = float(momdp.levels) ** len(momdp.query)
        width = self.problem.branch_x.shape[2] * int(min(outcomes, ENUMERATE)) + 2
        nodes = settings.room
        if settings.milliseconds is None:
            nodes = min(nodes, (settings.simulations + 1) * width + 1)
        tree = _room((nodes + width, *belief.weight.shape, momdp.n_behaviors))
        work = room_for(self.problem, self.plans)
        work.weight[:] = np.exp(belief.weight)
        tree.size[0] = 0
        tabled = len(self.table.value) > 0
        exploration = 0.0 if tabled else settings.exploration
        leaf = Leaf(self.plans, self.table, make_scratch(self.table, momdp.levels))

        def grow(simulations: int) -> int:
            made = search(
                self.problem,
                leaf,
                tree,
                work,
                belief.x,
                belief.seen.astype(np.float64),
                simulations,
                exploration * float(momdp.correct - momdp.incorrect),
                rng,
            )
            return int(made)

        if settings.milliseconds is None:
            done = grow(settings.simulations)
        else:
            done = _within(begin + 1e-3 * settings.milliseconds, grow)
        exit_value = float(self.problem.exit_value[belief.x])
        action, values = choose(momdp, belief, tree.edge_value[0], exit_value)
        visits = np.append(tree.edge_visits[0], tree.visits[0] - tree.edge_visits[0].sum())
        exact = np.where(np.isnan(values), np.nan, 0.0)
        exact[:-1][tree.edge_visits[0] > 0] = _spread(tree)[tree.edge_visits[0] > 0]
        return Decision(action, values, exact, visits, _top(tree), done)


def _within(end: float, grow: Callable[[int], int]) -> int:
    """Grow a tree until this thread's CPU clock shows `end`, s; return the simulations made."""
    begin, done, chunk = time.thread_time(), 0, _CHUNK
    while True:
        made = grow(chunk)
        done += made
        now = time.thread_time()
        left = int(0.9 * (end - now) * done / max(now - begin, 1e-9))
        if made < chunk or left < 1:
            return done
        chunk = min(left, 4 * chunk)


def _no_table(momdp: MOMDP) -> Table:
    n = len(momdp.query)
    return Table(np.ones((n, 1)), np.ones(n, np.int64), np.zeros((0, 0), np.float32))


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
            if not tree.visits[child]:  # never opened, so without edges
                continue
            levels = tuple(int(z) for z in tree.levels[child] if z >= 0)
            for a in np.flatnonzero(tree.edge_visits[child]):
                visits, value = int(tree.edge_visits[child, a]), float(tree.edge_value[child, a])
                below.append(TreeEdge(2, parent, int(a), levels, visits, value))
    below.sort(key=lambda edge: -edge.visits)
    return (*edges, *below[:_LOGGED])


_rooms = threading.local()  # each thread searches in its own


def _room(size: tuple[int, ...]) -> Tree:
    """Give room for one search; reused, as allocating it costs more than a short search."""
    held, tree = getattr(_rooms, "last", (None, None))
    if tree is None or held != size:
        tree = _new_room(*size)
        _rooms.last = size, tree
    return tree


def _new_room(nodes: int, n_attributes: int, n_kinds: int, n_behaviors: int) -> Tree:
    edges = (nodes, n_behaviors)
    return Tree(
        size=np.zeros(1, np.int64),
        x=np.empty(nodes, np.int64),
        weight=np.empty((nodes, n_attributes, n_kinds)),
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
    """Compile the kernels, or load what an earlier process compiled; the first `solve` does it."""
    domain, rng = load_domain("toy"), np.random.Generator(np.random.PCG64(0))
    rows = np.broadcast_to([[0.6, 0.4], [0.4, 0.6]], (1, len(domain.behaviors), 2, 2))
    momdp = build_momdp(domain, Query(domain.attributes[:1]), rows)
    POMCP(simulations=1)._prepare(momdp).decide(History(initial_belief(momdp)), rng)
    plans_for(compile_momdp(momdp))

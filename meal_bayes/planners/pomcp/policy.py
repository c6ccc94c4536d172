"""POMCP: online tree search in sampled MOMDPs, from the exact belief [Silver2010, Katt2017].

Each simulation draws a MOMDP from the posterior and walks the tree in it; its
rewards are those of the MOMDP it is given, so ITRS-shaped ones where the MOMDP is shaped. What
departs from textbook POMCP, each because the textbook fails here:

- Queries with groups are left to open-loop plans: a node's beliefs are independent.
- All 2^N reports are one action whose value is computed, never sampled.
- Nodes carry the exact factored belief, no particles.
- New nodes are not valued by random roll-outs but by open-loop plans and tables.
- `backup="expected"`: sampled MOMDPs decide where the tree grows; values are backed up as exact
  expectations over an edge's outcomes (drawn ones beyond 64), which is what the returns of sampled
  MOMDPs average to, without their variance. `backup="sampled"` averages the returns.
"""

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from meal_bayes.arrays import Floats
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, answer_value
from meal_bayes.momdp.belief import next_percept
from meal_bayes.planners.compiled import Compiled, compile_momdp, dynamics_of
from meal_bayes.planners.factored import grid
from meal_bayes.planners.factored.policy import Factored, FactoredPolicy
from meal_bayes.planners.open_loop.errors import Scratch
from meal_bayes.planners.open_loop.library import diagram_of, plan_library, retabulate
from meal_bayes.planners.open_loop.policy import OpenLoopPolicy
from meal_bayes.planners.open_loop.values import Plans, plan_values
from meal_bayes.planners.pomcp.search import ENUMERATE, Tabled, search
from meal_bayes.planners.pomcp.tree import KEPT, make_sampled, make_tree, standard_errors, top_edges
from meal_bayes.planners.solver import Decision, History, choose, no_errors

_CHUNK = 8  # simulations between two looks at the clock, at first
_BACKUPS = ("expected", "sampled")


@dataclass(frozen=True, slots=True)
class POMCP:
    """Settings of the search.

    Attributes
    ----------
    simulations : int
        A decision, at most.
    milliseconds : float | None
        CPU time a decision; then as many simulations as it takes.
    exploration : float
        UCB1's c, as a fraction of r+ - r-; with a table at the leaf 0.
    capacity : int
        Nodes of a tree; the search ends when they are used up.
    points : int
        Of a table at the leaf, at most; 0 = open-loop plans for every MOMDP.
    backup : str
        "expected" or "sampled", see the module.
    paid : float
        Percepts of a behavior in a trial that shaping pays for, at most.

    Raises
    ------
    SettingsError
        A negative budget or exploration constant, no capacity, an unknown backup.
    """

    simulations: int = 100
    milliseconds: float | None = None
    exploration: float = 0.06
    capacity: int = 4_000
    points: int = 50_000
    backup: str = "expected"
    paid: float = np.inf

    def __post_init__(self) -> None:
        budget = self.simulations if self.milliseconds is None else self.milliseconds
        if budget < 0 or self.exploration < 0 or self.capacity < 1 or self.points < 0:
            needed = "a budget, exploration and points >= 0, and capacity >= 1"
            raise SettingsError(f"POMCP needs {needed}; found {self}.")
        if self.backup not in _BACKUPS:
            raise SettingsError(f"POMCP has backups {_BACKUPS}; found {self.backup!r}.")

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "POMCPPolicy":
        """Return the policy; plans and tables are built when a decision first needs them."""
        return POMCPPolicy(momdp, self)


class _Lent(threading.local):
    """One generator a thread for the kernels: numba keeps every one that it was ever given."""

    def __init__(self) -> None:
        self.generator = np.random.Generator(np.random.PCG64(0))


_LENT = _Lent()


class POMCPPolicy:
    """Policy of `POMCP`; every decision that leaves a choice grows a fresh tree.

    To keep the last tree would not pay: 36 simulations a decision more, as many as it holds of what
    then happened, change the reward by -1.2 +- 2.1 (s.e., four attributes, 100 simulations).
    """

    deterministic = True  # given its generator; a decision may be remembered

    def __init__(self, momdp: MOMDP, settings: POMCP) -> None:
        self.momdp, self.settings = momdp, settings

    def sharing_plans(self, momdp: MOMDP) -> "POMCPPolicy":
        """Return a policy of another MOMDP of the query and diagram, with the same plans."""
        policy = POMCPPolicy(momdp, self.settings)
        policy.plans = retabulate(self.plans, policy.problem)
        return policy

    @cached_property
    def problem(self) -> Compiled:
        """The compiled MOMDP."""
        return compile_momdp(self.momdp, self.settings.paid)

    @cached_property
    def plans(self) -> Plans:
        """The open-loop plans of the leaf."""
        return plan_library(self.momdp, self.problem)

    @cached_property
    def tables(self) -> FactoredPolicy | None:
        """Factored value iteration; None where the marginals are not the state, or too many."""
        if not self.settings.points or not np.isinf(self.momdp.limit).all():
            return None
        try:
            return Factored(self.settings.points).solve(self.momdp, np.random.default_rng(0))
        except SettingsError:  # not Eq. 8, too many attributes, shaping that promises without end
            return None

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the best value, by search where anything is left to decide."""
        momdp, belief, end = self.momdp, history.belief, None
        if momdp.query.groups:  # nodes of the tree hold attributes that are independent
            return OpenLoopPolicy(momdp, self.problem, self.plans).decide(history, rng)
        if self.settings.milliseconds is not None:
            end = time.thread_time() + 1e-3 * self.settings.milliseconds
        if certain := _certain(momdp, belief):
            return certain
        scratch = plan_values(self.problem, self.plans, belief)
        lower, upper = scratch.value.copy(), np.full(momdp.n_behaviors, np.inf)
        if self.tables is not None:
            upper = self.tables.upper_bounds(belief.x, belief.positive)
        decision = _settled(momdp, belief, lower, upper) or self._search(end, belief, scratch, rng)
        if self.tables is None:
            return decision
        worth = np.append(lower, decision.values[-1])[min(decision.action, len(lower))]
        return replace(decision, gap=float(max(0.0, upper.max() - worth)))

    def _search(
        self, end: float | None, belief: Belief, scratch: Scratch, rng: np.random.Generator
    ) -> Decision:
        """Decide by a tree; `scratch.value` holds the lower bounds of the behaviors."""
        settings, momdp = self.settings, self.momdp
        width = self.problem.dynamics.branch.shape[2] * ENUMERATE  # nodes of an expansion, at most
        tree = make_tree(momdp, belief, settings.capacity + width + 1)
        tree.edge["value"][0], tree.edge["first"][0] = scratch.value, -1  # before simulations
        tabled = None
        if self.tables is not None:
            table = self.tables.estimate
            tabled = Tabled(table, grid.make_scratch(table, momdp.levels))
        sampled = make_sampled(self.problem.percepts, tree.prob[0].copy(), scratch.counts.copy())
        exploration = 0.0 if tabled else settings.exploration * self.problem.gap
        options = np.array([0, exploration, settings.backup == "sampled"], dtype=float)
        usual = isinstance(rng.bit_generator, np.random.PCG64)
        lent = _LENT.generator if usual else rng
        lent.bit_generator.state = rng.bit_generator.state

        def grow(simulations: int) -> int:
            options[0], problem = simulations, self.problem
            return int(search(problem, self.plans, tabled, scratch, tree, sampled, options, lent))

        done = grow(settings.simulations) if end is None else _within(end, grow)
        rng.bit_generator.state = lent.bit_generator.state
        action, values = choose(momdp, belief, tree.edge["value"][0])
        visits = tree.edge["visits"][0]
        errors = no_errors(values) + np.append(standard_errors(tree), 0.0)
        rows = sampled.kept[action, : min(KEPT, visits[action])] if action < len(visits) else None
        visits = np.append(visits, tree.node["visits"][0] - visits.sum())
        return Decision(action, values, errors, visits, top_edges(tree), done, rows)


def _certain(momdp: MOMDP, belief: Belief) -> Decision | None:
    """Return the decision where nothing is left to choose, else None.

    Where nothing can be done it is the answer. Where one behavior can, it is that if a report is
    worse for certain: if it is worth less than going for a first percept of some behavior and then
    reporting, where each attribute is judged by the one percept on the way that tells most of it.
    """
    dynamics = dynamics_of(momdp)
    legal = np.flatnonzero(dynamics.step["legal"][belief.x])
    if not len(legal):
        return Decision.exact(*choose(momdp, belief, np.full(momdp.n_behaviors, -np.inf)))
    if len(legal) != 1 or momdp.bonus.any():
        return None
    ways = diagram_of(dynamics).ways
    error = next_percept(momdp, belief).min(axis=2).sum(axis=2)  # (N,E) Bayes error of a percept
    left = belief.percept_counts[0].sum(axis=1) < momdp.limit
    used = (ways.observation_counts[belief.x] > 0) & left  # (goal,E)
    least = np.where(used[:, None], error, 1.0 - belief.right[:, None]).min(axis=2)  # (goal,N)
    value = ways.discount[belief.x] * momdp.report_reward(1.0 - least) - ways.cost[belief.x]
    best = float(np.where(ways.hop[belief.x] >= 0, value, -np.inf).max(initial=-np.inf))
    ending = answer_value(momdp, belief)
    if best <= ending:
        return None
    values = np.full(momdp.n_behaviors + 1, np.nan)
    values[legal[0]], values[-1] = best, ending
    return Decision.exact(int(legal[0]), values)


def _settled(momdp: MOMDP, belief: Belief, lower: Floats, upper: Floats) -> Decision | None:
    """Decide by bounds alone, where an action is worth at least what any other is at most."""
    action, values = choose(momdp, belief, lower)
    chosen = min(action, len(lower))
    others = np.append(np.where(np.isfinite(lower), upper, -np.inf), values[-1])
    others[chosen] = -np.inf
    return Decision.exact(action, values) if values[chosen] >= others.max() else None


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

"""POMCP: online tree search in sampled MOMDPs, from the exact belief [Silver2010, Katt2017].

Each simulation draws a MOMDP from the posterior and descends the tree in it. Rewards include the
exploration bonus if the MOMDP has one. The search departs from textbook POMCP in these points,
because the textbook version fails here:

- Queries about dependent attributes (a group or a joint prior) use open-loop plans, because a node
  of the tree stores independent beliefs.
- All 2^N reports are one action whose value is computed, never sampled.
- Nodes store the exact factored belief instead of particles.
- The values of new nodes come from open-loop plans or tables instead of random roll-outs.
- `backup="expected"`: sampled MOMDPs determine where the tree grows, but the value of an edge is
  the exact expectation over its outcomes (over sampled outcomes if there are more than 64). The
  returns of sampled MOMDPs have the same mean, with more variance. `backup="sampled"` averages the
  returns.
"""

import contextlib
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from meal_bayes.arrays import Floats, plain_fields
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, answer_value
from meal_bayes.momdp.belief import next_percept, percepts_left
from meal_bayes.planners.momdp_arrays import MOMDPArrays, arrays_of, dynamics_of
from meal_bayes.planners.plans.coupled import SAMPLES
from meal_bayes.planners.plans.library import plan_library, retabulate
from meal_bayes.planners.plans.paths import diagram_of
from meal_bayes.planners.plans.policy import OpenLoopPolicy
from meal_bayes.planners.plans.values import Evaluator, Plans, plan_values
from meal_bayes.planners.search.search import ENUMERATE, Growing, TreeSearch, grow_tree
from meal_bayes.planners.search.tree import (
    KEPT,
    make_sampled,
    make_tree,
    standard_errors,
    top_edges,
)
from meal_bayes.planners.solver import (
    Decision,
    History,
    choose,
    is_worth_going_on,
    no_errors,
)
from meal_bayes.planners.table.policy import Factored, FactoredPolicy

_TABLE_WORK = 3.4e9  # largest number of multiplications for a table, .8 s at the first decision
_BACKUPS = ("expected", "sampled")


@dataclass(frozen=True, slots=True)
class POMCP:
    """Planner by POMCP, a Monte Carlo tree search over sampled histories.

    Attributes
    ----------
    simulations : int
        Maximum number of simulations for a decision. If attributes are dependent, there is no tree
        search; the number is then the number of samples (at least 256) that estimate the values of
        open-loop plans.
    milliseconds : float | None
        Limit of the CPU time of a decision in milliseconds; it replaces the number of simulations.
        If earlier simulations in the same state took longer than the limit, the planner makes none
        and executes the best open-loop plan.
    exploration : float
        Exploration constant c of UCB1, as a fraction of the difference between the rewards of a
        right and a wrong report. The search uses 0 instead if a table gives the values of leaves.
    capacity : int
        Maximum number of nodes of a tree; the search ends when they are used up.
    points : int
        Maximum number of grid points of a table for the values of leaves. With 0, leaves always get
        their values from open-loop plans.
    backup : str
        Kind of backup: "expected" or "sampled"; see the docstring of the module.

    Raises
    ------
    SettingsError
        The budget or the exploration constant is negative, the capacity is zero, or the backup is
        unknown.

    Examples
    --------
    >>> import meal_bayes
    >>> isinstance(meal_bayes.POMCP(), meal_bayes.Solver)
    True
    """

    simulations: int = 100
    milliseconds: float | None = None
    exploration: float = 0.06
    capacity: int = 4_000
    points: int = 50_000
    backup: str = "expected"

    def __post_init__(self) -> None:
        plain_fields(self)
        budget = self.simulations if self.milliseconds is None else self.milliseconds
        if budget < 0 or self.exploration < 0 or self.capacity < 1 or self.points < 0:
            needed = "a budget, exploration and points >= 0, and capacity >= 1"
            raise SettingsError(f"POMCP needs {needed}; found {self}.")
        if self.backup not in _BACKUPS:
            raise SettingsError(f"POMCP has backups {_BACKUPS}; found {self.backup!r}.")

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "POMCPPolicy":
        """Return the policy, which builds plans and tables when a decision first needs them."""
        return POMCPPolicy(momdp, self)


class POMCPPolicy:
    """Policy of `POMCP`, which builds a new tree for every decision.

    Reusing the last tree would save about 36 simulations for each decision. This many more
    simulations change the mean reward by -1.2 +- 2.1 s (standard error; four attributes, 100
    simulations).
    """

    deterministic = True  # given the state of the generator, so decisions may be cached

    def __init__(self, momdp: MOMDP, settings: POMCP) -> None:
        self.momdp = momdp
        self.settings = settings
        self._lasted: dict[int, float] = {}  # CPU seconds of the last first simulation, by x

    def sharing_plans(self, momdp: MOMDP) -> "POMCPPolicy":
        """Return a policy of another MOMDP of the query and diagram, with the same plans."""
        policy = POMCPPolicy(momdp, self.settings)
        policy.plans = retabulate(self.plans, policy.model)
        return policy

    @cached_property
    def model(self) -> MOMDPArrays:
        """The compiled MOMDP."""
        return arrays_of(self.momdp)

    @cached_property
    def plans(self) -> Plans:
        """The open-loop plans of the leaf."""
        return plan_library(self.momdp, self.model)

    @cached_property
    def tables(self) -> FactoredPolicy | None:
        """Factored value iteration; None if marginals are not a sufficient state or are too many.

        It is also None if there is an exploration bonus: if the bonus is for a limited number of
        percepts, this number is part of the state, and otherwise a table holds sums of reward and
        bonus, from which the reward alone cannot be read.
        """
        momdp = self.momdp
        if not self.settings.points or not np.isinf(momdp.limit).all() or momdp.bonus.any():
            return None
        try:
            table = Factored(self.settings.points, work=_TABLE_WORK)
            return table.solve(momdp, np.random.default_rng(0))
        except SettingsError:  # not Eq. 8, or too many attributes or behaviors
            return None

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the action with the best value, by search if bounds do not decide."""
        momdp = self.momdp
        belief = history.belief
        if momdp.coupled:  # nodes of the tree store independent beliefs
            samples = max(SAMPLES, self.settings.simulations)
            return OpenLoopPolicy(momdp, self.model, self.plans, samples).decide(history, rng)
        end = None
        if self.settings.milliseconds is not None:
            end = time.thread_time() + 1e-3 * self.settings.milliseconds
        # First check whether there is a choice, then whether bounds decide; otherwise search.
        certain = _certain(momdp, belief)
        if certain is not None:
            return certain
        evaluator = plan_values(self.model, self.plans, belief)
        lower = evaluator.scratch.value.copy()
        # L(b, a) <= Q*(b, a) <= U(b, a): plans are policies; U is of factored value iteration.
        upper = np.full(momdp.n_behaviors, np.inf)
        if self.tables is not None:
            upper = self.tables.priced_bounds(belief.x, belief.positive)
        bonus = evaluator.scratch.bonus.copy()
        decision = _settled(momdp, belief, lower, bonus, upper)
        if decision is None:
            decision = self._search(end, belief, evaluator, rng)
        if self.tables is None:  # with a table, there is no exploration bonus
            return decision
        action = decision.action
        worth = lower[action] if action < momdp.n_behaviors else decision.values[-1]
        return replace(decision, gap=float(max(0.0, upper.max() - worth)))

    def _search(
        self, end: float | None, belief: Belief, evaluator: Evaluator, rng: np.random.Generator
    ) -> Decision:
        """Decide by a tree search; the evaluator contains lower bounds for the behaviors."""
        settings = self.settings
        momdp = self.momdp
        model = self.model
        width = model.dynamics.branch.shape[2] * ENUMERATE  # largest number of new nodes at once
        tree = make_tree(momdp, belief, settings.capacity + width + 1)
        # Without simulations, the values of plans are used; the first simulation opens the root.
        tree.edge["value"][0] = evaluator.scratch.value  # before simulations
        tree.edge["bonus"][0] = evaluator.scratch.bonus
        tree.edge["first"][0] = -1
        counts = evaluator.scratch.evidence.counts.copy()
        sampled = make_sampled(model.percepts, tree.prob[0].copy(), counts)
        reader = self.tables.estimate_reader() if self.tables is not None else None
        # c is a fraction of r+ - r-, so it does not depend on the scale of rewards.
        exploration = settings.exploration * model.reward_range if reader is None else 0.0
        averaged = settings.backup == "sampled"
        with _kernel_generator(rng) as kernel_rng:

            def grow(simulations: int) -> int:
                search = TreeSearch(tree, sampled, Growing(simulations, exploration, averaged))
                return int(grow_tree(evaluator, search, reader, kernel_rng))

            if end is None:
                simulated = grow(settings.simulations)
            else:
                left = end - time.thread_time() + 0.5e-3 * (settings.milliseconds or 0.0)
                simulated = 0
                if self._lasted.get(belief.x, 0.0) <= left:
                    simulated, self._lasted[belief.x] = _simulate(grow, end)
        root = tree.edge[0]
        action, values, bonus = choose(momdp, belief, root["value"], root["bonus"])
        visits = root["visits"]
        rows = None
        if action < len(visits):
            rows = sampled.recent[action, : min(KEPT, visits[action])]
        return Decision(
            action=action,
            values=values,
            value_se=no_errors(values) + np.append(standard_errors(tree), 0.0),
            visits=np.append(visits, tree.node["visits"][0] - visits.sum()),
            tree=top_edges(tree),
            simulations=simulated,
            sampled_rows=rows,
            bonus=bonus,
        )


def _certain(momdp: MOMDP, belief: Belief) -> Decision | None:
    """Return the decision if there is only one reasonable action, and otherwise None.

    If no behavior is legal, the action is the answer. If one behavior is legal, the action is this
    behavior if answering now is certainly worse. This is so if its value is below that of a plan
    that goes on to the first percept of some behavior and then reports each attribute by the most
    informative percept on the way.
    """
    dynamics = dynamics_of(momdp)
    legal = np.flatnonzero(dynamics.step["legal"][belief.x])
    if not len(legal):
        return Decision.exact(*choose(momdp, belief, np.full(momdp.n_behaviors, -np.inf)))
    if len(legal) != 1 or momdp.bonus.any() or momdp.reports.event is not None:
        return None
    shortest = diagram_of(dynamics).shortest
    error = next_percept(momdp, belief).min(axis=2).sum(axis=2)  # (N,E) Bayes error of a percept
    available = percepts_left(momdp, belief) > 0
    # Pr(right) >= prod_i (1 - min over percepts on the path of Bayes error_i); V = g V_end - c. If
    # the path cannot be completed, the robot answers at once.
    on_path = (shortest.observation_counts[belief.x] > 0) & available  # (goal,E)
    least = np.where(on_path[:, None], error, 1.0 - belief.right[:, None]).min(axis=2)  # (goal,N)
    ending = answer_value(momdp, belief)
    value = (
        shortest.discount[belief.x] * momdp.reports.of_right(1.0 - least) - shortest.cost[belief.x]
    )
    value = value + shortest.lost[belief.x] * ending
    best = float(
        np.where(shortest.first_action[belief.x] >= 0, value, -np.inf).max(initial=-np.inf)
    )
    if not is_worth_going_on(best, ending):
        return None
    values = np.full(momdp.n_behaviors + 1, np.nan)
    values[legal[0]] = best
    values[-1] = ending
    return Decision.exact(int(legal[0]), values)


def _settled(
    momdp: MOMDP, belief: Belief, lower: Floats, bonus: Floats, upper: Floats
) -> Decision | None:
    """Decide by bounds if the lower bound of one action is at least the upper bounds of all others.

    Bounds (E,) are for the sum of reward and exploration bonus. Otherwise, return None.
    """
    action, values, bonuses = choose(momdp, belief, lower, bonus)
    answers = action >= len(lower)
    # The value of the answer (the last entry) is exact, and it has no bonus.
    worth = values[-1] if answers else lower[action]
    others = np.append(np.where(np.isfinite(lower), upper, -np.inf), values[-1])
    others[len(lower) if answers else action] = -np.inf
    # L(chosen) >= max over others of U: no search can change the choice.
    return Decision.exact(action, values, bonuses) if worth >= others.max() else None


class _KernelGenerator(threading.local):
    """One generator per thread for the kernels, because numba keeps a reference to each one."""

    def __init__(self) -> None:
        self.generator = np.random.Generator(np.random.PCG64(0))


_KERNEL = _KernelGenerator()


@contextlib.contextmanager
def _kernel_generator(rng: np.random.Generator) -> Iterator[np.random.Generator]:
    """Yield a generator for the kernels with the state of `rng`; then copy its state to `rng`."""
    if not isinstance(rng.bit_generator, np.random.PCG64):
        yield rng
        return
    generator = _KERNEL.generator
    generator.bit_generator.state = rng.bit_generator.state
    yield generator
    rng.bit_generator.state = generator.bit_generator.state


def _simulate(grow: Callable[[int], int], end: float) -> tuple[int, float]:
    """Grow a tree until the CPU clock of this thread reaches `end` (in seconds).

    Returns the number of simulations, which is at least one, and the time of the first one in
    seconds.
    """
    begin = time.thread_time()
    first = 0.0
    total = 0
    chunk = 1  # simulations between two checks of the clock
    while True:
        made = grow(chunk)
        total += made
        now = time.thread_time()
        first = first or now - begin
        # The number that fits into 90 % of the remaining time; the rest is for the decision.
        fitting = int(0.9 * (end - now) * total / max(now - begin, 1e-9))
        if made < chunk or fitting < 1:
            return total, first
        chunk = min(fitting, 4 * chunk)

"""Factored value iteration: a certified upper bound on the optimum, and a policy that nears it.

With attributes that are independent a priori, percepts that are independent given them (Eq. 8) and
rows that are known, the belief stays a product of N marginals b = (b_1 .. b_N). That is solved by
value iteration on a product grid of marginals, multilinear between the points, from above.

*The bound.* (1) What a fixed policy earns is an expectation over the truth y of something that does
not depend on b, and Pr(y) = prod_i Pr(y_i) is linear in each b_i. So the optimum V(x, b), the
supremum over policies, is convex in each b_i while the others are held (in all of b at once it need
not be). (2) Hence interpolation along one axis lies above V, and is still convex along the next, as
its weights are >= 0: axis by axis, the multilinear interpolation I U of any U >= V on the grid lies
above V everywhere. (3) A Bellman backup T is monotone and T V = V, so T I U >= V on the grid, and
so is min(U, T I U). Started from a constant that no reward exceeds, every table is therefore an
upper bound, however coarse the grid and however few the sweeps, and tight as the grid grows.
Bonuses of shaping are linear in each b_i; geometric failures are summed out.

*The policy* takes the best behavior by one exact step ahead of a second table, or ends. On a coarse
grid the bound promises information that is not there, and its policy puts the report off; so the
second table, the estimate, is iterated with cubic interpolation in log-odds, which is no bound but
much nearer the optimum.

What is left out of the state, and what then holds:

- percepts that run out (`limit`): tables suppose that they never do, which can only raise the bound
  (unless shaping takes pay away). Behaviors that have run out are planned without, by a table that
  is made when first needed.
- finite precision and several latent classes a truth: `Factored` refuses; plan with `POMCP`.
- undiscounted behaviors that cost nothing and inform of nothing: going round them for ever is worth
  what the table started from. The bound holds, but is idle, and the policy may go round.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, answer_value, initial_belief
from meal_bayes.planners.compiled import Compiled, Floats, compile_momdp
from meal_bayes.planners.factored.grid import Table, add_values_ahead, make_scratch, value_after
from meal_bayes.planners.factored.iteration import ValueIteration
from meal_bayes.planners.solver import Decision, History, choose

_FINER = 8  # times `points` are those of the estimate, and of the bound of _MANY attributes
_MANY = 5  # of fewer, the bound has points enough


@dataclass(frozen=True, slots=True)
class Factored:
    """Settings of factored value iteration.

    Solves up to three attributes in tenths of a second at the default, five in some seconds, with
    eight times the points.

    Attributes
    ----------
    points : int
        Of the grid, at most.
    tolerance : float
        An axis is fine enough when its refinement gains less, as a fraction of r+ - r-.

    Raises
    ------
    SettingsError
        A tolerance of 0 or less, or no points.
    """

    points: int = 50_000
    tolerance: float = 2e-4

    def __post_init__(self) -> None:
        if self.points < 1 or not self.tolerance > 0:
            raise SettingsError(f"Factored needs points >= 1 and tolerance > 0; found {self}.")

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "FactoredPolicy":
        """Solve a MOMDP; nothing in it is random.

        Raises
        ------
        SettingsError
            Finite precision, several latent classes a truth, more attributes than `points` allow,
            or rewards without a bound.
        """
        known = np.isinf(momdp.precision).all() and momdp.class_is_truth
        if not known or momdp.query.groups:
            raise SettingsError(
                "Factored value iteration needs attributes without a group, and percepts that are "
                "independent given the truth, with known rates (Eq. 8: infinite precision, one "
                "latent class a truth); plan with POMCP."
            )
        momdp = _without_percepts(momdp, momdp.limit <= 0)
        tolerance = self.tolerance * max(momdp.correct - momdp.incorrect, 1e-9)
        free = ValueIteration(momdp, compile_momdp(momdp, price=0.0), tolerance)
        many = free.edges.moves.any(axis=1).sum() == _MANY
        bound = free.bounds((_FINER if many else 1) * self.points)
        iteration = replace(free, problem=compile_momdp(momdp))
        estimate = iteration.estimate(bound, _FINER * self.points)
        iteration.forget_grids()
        return FactoredPolicy(iteration, _rounded_up(bound), _rounded_up(estimate))


@dataclass(frozen=True, slots=True)
class FactoredPolicy:
    """Policy of `Factored`: tables of upper bounds, and of estimates next to the optimum."""

    iteration: ValueIteration
    bound: Table
    estimate: Table
    _rest: dict[tuple[int, ...], tuple[ValueIteration, Table]] = field(
        default_factory=dict, repr=False, compare=False
    )  # what is left when behaviors have run out
    deterministic: ClassVar[bool] = True

    @property
    def upper_bound(self) -> float:
        """Bound on the value that any policy has from the start.

        Certified, unless percepts run out and shaping takes pay away for them.
        """
        momdp, x = self.iteration.momdp, self.iteration.momdp.start
        ending = answer_value(momdp, initial_belief(momdp))
        free = compile_momdp(momdp, price=0.0)
        ahead = _values_ahead(free, self.bound, self.iteration.edges.moves, x, momdp.prior)
        return min(max(ending, float(ahead.max())), self.value_at(x, momdp.prior))

    def upper_bounds(self, x: int, prob: Floats) -> Floats:
        """Bound the value of each behavior (E,) from x at marginals (N,); -inf where not legal."""
        iteration = self.iteration
        return _values_ahead(iteration.problem, self.bound, iteration.edges.moves, x, prob)

    def value_at(self, x: int, prob: Floats) -> float:
        """Bound the value from x at marginals (N,); those that no percept moves count as prior."""
        rows, moves = self.iteration.problem.percepts.rows, self.iteration.edges.moves
        scratch = make_scratch(self.bound, rows.shape[3])
        return float(value_after(self.bound, rows, moves, x, -1, np.array(prob), scratch))

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the best action by one step ahead of the estimate."""
        belief, prob = history.belief, history.belief.positive
        iteration, table = self._left(belief)
        momdp, problem = iteration.momdp, iteration.problem
        ahead = _values_ahead(problem, table, iteration.edges.moves, belief.x, prob)
        if iteration is self.iteration:  # weak percepts: the estimate may pass the bound
            ahead = np.minimum(ahead, self.upper_bounds(belief.x, prob))
        return Decision.exact(*choose(momdp, belief, ahead))

    def _left(self, belief: Belief) -> tuple[ValueIteration, Table]:
        """Return iteration and table without the behaviors whose percepts have run out."""
        momdp = self.iteration.momdp
        gone = (belief.percept_counts[0].sum(axis=1) >= momdp.limit) & (momdp.limit > 0)
        if gone.any():
            gone &= self.iteration.edges.moves.any(axis=0) | momdp.bonus.any(axis=(0, 2))
        if not gone.any():
            return self.iteration, self.estimate
        key = tuple(np.flatnonzero(gone).tolist())
        if key not in self._rest:
            rest = _without_percepts(momdp, gone)
            iteration = replace(self.iteration, momdp=rest, problem=compile_momdp(rest))
            start = self.bound
            if self.iteration.problem.shaped:  # what is gone may have taken pay away
                top = np.full_like(start.value, iteration.constant_bound())
                start = start._replace(value=top)
            self._rest[key] = iteration, _rounded_up(iteration.lowered(start))
        return self._rest[key]


def _without_percepts(momdp: MOMDP, gone: NDArray[np.bool_]) -> MOMDP:
    """Remove percepts and bonus from some behaviors (E,)."""
    limit, bonus = np.where(gone, 0.0, momdp.limit), np.where(gone[:, None], 0.0, momdp.bonus)
    return replace(momdp, limit=limit, bonus=bonus)


def _rounded_up(table: Table) -> Table:
    """Convert a table to float32, rounded up: it stays an upper bound."""
    return table._replace(value=np.nextafter(table.value.astype(np.float32), np.float32(np.inf)))


def _values_ahead(
    problem: Compiled, table: Table, moves: NDArray[np.bool_], x: int, prob: Floats
) -> Floats:
    """Compute the value of each behavior (E,), one step ahead of a table; -inf where not legal."""
    dynamics, percepts, step = problem.dynamics, problem.percepts, problem.dynamics.step[x]
    out = -step["cost"]
    if problem.shaped:
        bonus = (1 - prob) @ problem.bonus[..., 0] + prob @ problem.bonus[..., 1]
        out += step["bonus_scale"] * bonus
    scratch = make_scratch(table, percepts.rows.shape[3])
    add_values_ahead(dynamics, percepts, table, moves, x, np.array(prob), scratch, out)
    return np.where(step["legal"], out, -np.inf)

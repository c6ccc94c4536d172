"""Factored value iteration: a certified upper bound on the optimum, and a policy that nears it.

With attributes that are independent a priori, percepts that are independent given them (Eq. 8) and
rows that are known, the belief stays a product of N marginals b = (b_1 .. b_N). That is solved by
value iteration on a product grid of marginals, multilinear between the points, from above.

*The bound.* (1) Fix a policy, as a rule from histories to actions. What it earns is an expectation
over the truth y of something that does not depend on b; Pr(y) = prod_i Pr(y_i) is linear in each
b_i while the others are held. The optimum V(x, b) is the supremum over policies, so it is convex
in each b_i while the others are held (in all of b at once it need not be). (2) Hence interpolation
along one axis lies above V, and the mixture it makes over that axis is still convex along the next
(weights are >= 0 and depend on the first b_i only): axis by axis, the multilinear interpolation I U
of any U >= V on the grid lies above V everywhere. (3) A Bellman backup T is monotone and T V = V,
so T I U >= V on the grid, and so is min(U, T I U). Started from a constant that no reward exceeds,
every table is therefore an upper bound, however coarse the grid and however few the sweeps; reading
it off at the points of a finer grid keeps it one (2). Bonuses of shaping are linear in each b_i,
additive reports convex; failures are folded into their behavior, and ending by an illegal behavior
is a constant. As the grid grows the interpolation error vanishes and the bound is tight.

*The policy* takes the best behavior by one exact step ahead of a second table, or ends. On a grid
that is too coarse the bound promises information that is not there, and its policy puts the report
off; so the second table is iterated with cubic interpolation in log-odds, which is no bound but
much nearer the optimum on the same grid.

What is left out of the state, and what then holds:

- percepts that run out (`limit`): tables suppose that they never do, which can only raise the bound
  (unless shaping takes pay away). In a trial, behaviors that have run out are planned without; the
  table for what is left is made when first needed, starting from the table at hand.
- finite precision and several kinds of objects a truth: the marginals are no longer the state.
  `Factored` refuses; plan with `POMCP`.
- behaviors that never do anything where they are legal: as for the other planners they are no
  choice, not even to pass discounted time with.
- undiscounted behaviors that cost nothing and tell nothing: going round them for ever is worth what
  the table started from. The bound holds, but is idle, and the policy may go round.
"""

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.planners.compiled import Compiled, compile_momdp
from meal_bayes.planners.factored.grid import Table, make_room, value_after
from meal_bayes.planners.factored.iteration import (
    smoothed,
    solve_again,
    solve_on_grid,
    worth_at_most,
)
from meal_bayes.planners.solver import Decision, History, choose

_FINER = 8  # times the points of a bound may be those of the estimate, whose steps are even


@dataclass(frozen=True, slots=True)
class Factored:
    """Settings of factored value iteration.

    Solves up to three attributes in tenths of a second at the default; `points` of a million reach
    five attributes in some ten seconds.

    Raises
    ------
    SettingsError : a tolerance of 0 or less, or no points.
    """

    points: int = 50_000  # of the grid, at most
    tolerance: float = 2e-4  # share of r+ - r-: an axis whose refinement gains less is fine enough

    def __post_init__(self) -> None:
        if self.points < 1 or not self.tolerance > 0:
            raise SettingsError(f"Factored needs points >= 1 and tolerance > 0; found {self}.")

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "FactoredPolicy":
        """Solve; nothing in it is random.

        Raises
        ------
        SettingsError : finite precision, several kinds of objects a truth, more attributes than
            `points` allow, or rewards without a bound.
        """
        problem = compile_momdp(_bereft(_checked(momdp), momdp.limit <= 0))
        tolerance = self.tolerance * max(momdp.correct - momdp.incorrect, 1e-9)
        table = solve_on_grid(momdp, problem, points=self.points, tolerance=tolerance)
        near = smoothed(momdp, problem, table, _FINER * self.points, tolerance)
        return FactoredPolicy(momdp, problem, _rounded_up(table), _rounded_up(near), tolerance)


@dataclass(frozen=True, slots=True)
class FactoredPolicy:
    """Policy of `Factored`; its values are estimates next to the optimum."""

    momdp: MOMDP
    problem: Compiled
    table: Table  # upper bounds
    near: Table  # estimates
    tolerance: float
    _rest: dict[tuple[int, ...], tuple[Compiled, Table]] = field(
        default_factory=dict, repr=False, compare=False
    )  # what is left when behaviors have run out

    @property
    def upper_bound(self) -> float:
        """Bound on the value that any policy has from the start.

        Certified, unless percepts run out and shaping takes pay away for them.
        """
        momdp, x = self.momdp, self.momdp.start
        report = float(momdp.report_reward(np.maximum(momdp.prior, 1 - momdp.prior)))
        ahead = _values(self.problem, self.table, x, momdp.prior).max()
        return min(
            max(report, float(self.problem.exit_value[x]), float(ahead)),
            self._read_off(x, momdp.prior),
        )

    def value_at(self, x: int, log_odds: ArrayLike) -> float:
        """Bound on the value from x, believing with log-odds (N,).

        Attributes that no percept tells of are taken at their prior.
        """
        with np.errstate(over="ignore"):
            positive = 1 / (1 + np.exp(-np.asarray(log_odds, dtype=float)))
        return self._read_off(x, positive)

    def _read_off(self, x: int, chance: NDArray[np.float64]) -> float:
        room = make_room(self.table, self.momdp.levels)
        return float(value_after(self.table, self.momdp.confusion, x, -1, chance, room))

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Take the best by one step ahead of the table."""
        momdp, belief = self.momdp, history.belief
        problem, table = self._left(belief)
        ahead = _values(problem, table, belief.x, belief.positive)
        if problem is self.problem:  # where percepts tell little the estimate may pass the bound
            bound = _values(problem, self.table, belief.x, belief.positive)
            ahead = np.minimum(ahead, bound)
        action, values = choose(momdp, belief, ahead, float(problem.exit_value[belief.x]))
        exact = np.where(np.isnan(values), np.nan, 0.0)
        return Decision(action, values, exact, np.zeros(len(values), dtype=np.int64))

    def _left(self, belief: Belief) -> tuple[Compiled, Table]:
        """Give problem and table without the behaviors whose percepts have run out."""
        momdp = self.momdp
        gone = (belief.seen[0].sum(axis=1) >= momdp.limit) & (momdp.limit > 0)
        gone &= self.table.tells.any(axis=0) | momdp.bonus.any(axis=(0, 2))
        if not gone.any():
            return self.problem, self.near
        key = tuple(np.flatnonzero(gone).tolist())
        if key not in self._rest:
            rest = _bereft(momdp, gone | (momdp.limit <= 0))
            problem = compile_momdp(rest)
            above = self.table.value
            if self.problem.shaped:  # what is gone may have taken pay away
                above = np.full_like(above, worth_at_most(rest, problem))
            start = self.table._replace(value=above)
            table = solve_again(rest, problem, start, self.tolerance)
            self._rest[key] = problem, _rounded_up(table)
        return self._rest[key]


def _checked(momdp: MOMDP) -> MOMDP:
    if not np.isinf(momdp.precision).all() or not momdp.kind_is_truth:
        raise SettingsError(
            "Factored value iteration needs percepts that are independent given the truth, with "
            "known rates (Eq. 8: infinite precision, one kind of object a truth); plan with POMCP."
        )
    return momdp


def _bereft(momdp: MOMDP, gone: NDArray[np.bool_]) -> MOMDP:
    """Take percepts and bonus from some behaviors (E,)."""
    limit, bonus = np.where(gone, 0.0, momdp.limit), np.where(gone[:, None], 0.0, momdp.bonus)
    return replace(momdp, limit=limit, bonus=bonus)


def _rounded_up(table: Table) -> Table:
    """Halve a table's memory; it stays an upper bound."""
    value = np.nextafter(table.value.astype(np.float32), np.float32(np.inf))
    value.setflags(write=False)
    return table._replace(value=value)


def _values(
    problem: Compiled, table: Table, x: int, chance: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Value of each behavior (E,), one step ahead of a table; -inf where not legal."""
    out = -problem.cost[x]
    if problem.shaped:
        mean = np.moveaxis(problem.bonus, 2, 0)  # (2,N,E)
        out += problem.bonus_scale[x] * ((1 - chance) @ mean[0] + chance @ mean[1])
    room = make_room(table, problem.confusion.shape[3])
    for e in range(len(out)):
        for k in range(problem.branches[x, e]):
            behavior = e if problem.branch_sense[x, e, k] else -1
            target = problem.branch_x[x, e, k]
            mean = value_after(table, problem.confusion, target, behavior, chance, room)
            out[e] += problem.discount[x, e] * problem.branch_p[x, e, k] * mean
    return np.where(problem.legal[x], out, -np.inf)

"""Factored value iteration: an upper bound on the optimal value, and a near-optimal policy.

If attributes are independent a priori, percepts are independent given the attributes (Eq. 8), and
confusion matrices are known, the belief is always a product of N marginals b = (b_1 .. b_N). The
problem is solved by value iteration on a product grid of marginals, with multilinear interpolation
and a start from above.

*The bound.* (1) The reward of a fixed policy is an expectation over the truth y of a quantity that
does not depend on b, and Pr(y) = prod_i Pr(y_i) is linear in each b_i. So the optimum V(x, b), the
supremum over policies, is convex in each b_i while the others are fixed (but not necessarily in
b). (2) Therefore linear interpolation along one axis lies above V. Its weights are >= 0, so the
result is still convex along the next axis. By induction, the multilinear interpolation I U of any
U >= V on the grid lies above V everywhere. (3) A Bellman backup T is monotone and T V = V, so
T I U >= V on the grid, and min(U, T I U) >= V, too. If value iteration starts from a constant that
no reward exceeds, every table is therefore an upper bound, for any grid and any number of sweeps,
and it converges to V as the grid becomes finer. Exploration bonuses are linear in each b_i, and
failures are marginalized out.

*The policy* chooses the best action by one exact step of look-ahead, with values from a second
table. On a coarse grid the bound overestimates the value of information, so its own policy would
report too late. The second table is therefore computed with cubic interpolation in log-odds. Its
values are not bounds, but much closer to the optimal ones.

The table does not model these cases:

- A limited number of percepts (`limit`). Tables assume that it is unlimited, which can only
  increase the bound (unless a bonus is negative). When percepts have run out, open-loop plans
  decide.
- Finite precision and several latent classes for one truth. `Factored` raises an error; use
  `POMCP`.
- Behaviors without discount, cost and information. The value of repeating them forever is the
  constant with which the table begins. The bound is valid but useless, and the policy may repeat
  them.
"""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import ByValue, Floats, plain_fields
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, answer_value, initial_belief
from meal_bayes.momdp.belief import percepts_left
from meal_bayes.planners.jit import NO_BEHAVIOR
from meal_bayes.planners.momdp_arrays import MOMDPArrays, arrays_of
from meal_bayes.planners.plans.policy import OpenLoop
from meal_bayes.planners.solver import Decision, History, choose
from meal_bayes.planners.table import grid
from meal_bayes.planners.table.grid import Reader, Table
from meal_bayes.planners.table.sweep import Edges, Ending, make_backups, percepts_on, sweep

_FINER = 8  # factor of `points` for the estimate, and for the bound with _MANY attributes
# Largest number of attributes of a table. With six, the coarsest grid, of at least seven points on
# each axis, is larger than the default `points`, and `_coarsest` raises an error.
_MANY = 5
_SWEEPS = 1_000  # largest number of sweeps; a table is a bound after any number of them
_SETTLED = 0.05  # change of a sweep, as a fraction of the tolerance, below which iteration ends
_SMOOTH_SWEEPS = 150  # the same numbers for the estimate
_SMOOTH_SETTLED = 0.1
_SETTLED_AT_ONCE = 0.3  # the same if work is limited
_INNER = (0, 101, 41, 25, 15)  # inner points on an axis of the estimate, by N < 5
_LEAST = 9  # smallest number of inner points
_COARSE = (3, 5, 7)  # inner points of the first grids, if work is limited
_FEWER = 0.6  # approximate ratio of the numbers of sweeps of a grid and the previous one
_BOUND_SHARE = 0.06  # fraction of limited work for the bound; the search uses the estimate
_EVENLY = 30  # an evenly refined grid has at most 1/30 of the points


@dataclass(frozen=True, slots=True)
class Factored:
    """Settings of factored value iteration.

    With the default settings, problems with up to three attributes take tenths of a second, and
    problems with five attributes take some seconds.

    Attributes
    ----------
    points : int
        Maximum number of grid points.
    tolerance : float
        An axis of the grid is refined until one more refinement improves the bound by less than
        this fraction of r+ - r-.
    work : float
        Maximum number of multiplications, which limits the size of grids; 1e9 take about .25 s.

    Raises
    ------
    SettingsError
        The tolerance is not positive, or `points` or `work` is zero.
    """

    points: int = 50_000
    tolerance: float = 2e-4
    work: float = math.inf

    def __post_init__(self) -> None:
        plain_fields(self)
        if self.points < 1 or not self.tolerance > 0 or not self.work > 0:
            needed = "points >= 1, tolerance > 0 and work > 0"
            raise SettingsError(f"Factored needs {needed}; found {self}.")

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "FactoredPolicy":
        """Solve a MOMDP deterministically, and return the policy.

        Raises
        ------
        SettingsError
            If attributes are dependent, the precision is finite, a truth has several latent
            classes, the number of percepts with a bonus is limited, there are too many attributes
            for `points` or too many behaviors for `work`, or values are unbounded.
        """
        if momdp.joint is not None:
            raise SettingsError(
                "Factored value iteration needs attributes that are independent a priori, but "
                "some of the queried attributes are coupled in the labels; plan with POMCP or "
                "OpenLoop, or use an agent with co_occurrence=False."
            )
        exact = np.isinf(momdp.precision).all() and momdp.class_is_truth
        if not exact or momdp.query.groups:
            raise SettingsError(
                "Factored value iteration needs attributes without a group, and percepts that are "
                "independent given the truth, with known rates (Eq. 8: infinite precision, one "
                "latent class for each truth); plan with POMCP."
            )
        if momdp.bonus_runs_out:
            raise SettingsError(
                "Factored value iteration does not count percepts, so the exploration bonus "
                "would be unlimited; plan with POMCP or OpenLoop."
            )
        momdp = replace(momdp, bonus=np.where((momdp.limit <= 0)[:, None], 0.0, momdp.bonus))
        tolerance = self.tolerance * max(momdp.correct - momdp.incorrect, 1e-9)
        # The bound uses the true costs; the estimate gives free behaviors a small cost.
        share = _BOUND_SHARE * self.work
        free = _ValueIteration(momdp, arrays_of(momdp, price=0.0), tolerance, share)
        many = free.edges.moves.any(axis=1).sum() == _MANY
        bound = free.bounds((_FINER if many else 1) * self.points)
        priced = _ValueIteration(momdp, arrays_of(momdp), tolerance, self.work - free.spent)
        estimate = priced.estimate(bound, _FINER * self.points)
        # Values are rounded up to float32, so that a table stays an upper bound.
        tables = (
            table._replace(value=np.nextafter(table.value.astype(np.float32), np.float32(np.inf)))
            for table in (bound, estimate)
        )
        return FactoredPolicy(momdp, priced.model, priced.edges.moves, *tables)


@dataclass(frozen=True, slots=True)
class FactoredPolicy(ByValue):
    """Policy of `Factored`, with a table of upper bounds and a table of estimates."""

    momdp: MOMDP
    model: MOMDPArrays
    moves: NDArray[np.bool_]  # (N,E) do percepts move the belief?
    bound: Table
    estimate: Table
    deterministic: ClassVar[bool] = True

    @property
    def upper_bound(self) -> float:
        """Upper bound on the value of any policy from the start of the trial.

        If the number of percepts is limited and a bonus is negative, this is not a bound.
        """
        momdp = self.momdp
        ending = answer_value(momdp, initial_belief(momdp))
        free = replace(self, model=arrays_of(momdp, price=0.0))
        ahead = float(free._values_ahead(self.bound, momdp.start, momdp.prior).max())
        prior = np.array(momdp.prior)
        value = float(grid.value_after(self._reader(self.bound), momdp.start, NO_BEHAVIOR, prior))
        return min(max(ending, ahead), value)

    def priced_bounds(self, x: int, prob: Floats) -> Floats:
        """Return bounds on the values of behaviors (E,) from x at marginals (N,); -inf if illegal.

        As in the estimate, behaviors cost at least 1e-4 of r+ - r-. So the bound of a behavior
        without cost can be below its value by this amount. `upper_bound` uses the true costs.
        """
        return self._values_ahead(self.bound, x, prob)

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the best action by one step of look-ahead with the estimate."""
        momdp = self.momdp
        belief = history.belief
        exhausted = (percepts_left(momdp, belief) <= 0) & (momdp.limit > 0)
        if (exhausted & (self.moves.any(axis=0) | momdp.bonus.any(axis=(0, 2)))).any():
            return OpenLoop().solve(momdp, rng).decide(history, rng)
        ahead = self._values_ahead(self.estimate, belief.x, belief.positive)
        # Cubic interpolation may overshoot; no behavior is worth more than its bound.
        ahead = np.minimum(ahead, self.priced_bounds(belief.x, belief.positive))
        decision = Decision.exact(*choose(momdp, belief, ahead))
        return replace(decision, bonus=None) if self.model.shaped else decision  # tables hold sums

    def estimate_reader(self) -> Reader:
        """Return a reader of the estimate, for percepts with enough information."""
        percepts = self.model.percepts
        return grid.make_reader(self.estimate, percepts.rows, percepts.informative)

    def _reader(self, table: Table) -> Reader:
        return grid.make_reader(table, self.model.percepts.rows, self.moves)

    def _values_ahead(self, table: Table, x: int, prob: Floats) -> Floats:
        """Compute the value (E,) of each behavior by a table; -inf if it is not legal."""
        model = self.model
        step = model.dynamics.step[x]
        out = -step["cost"]
        if model.shaped:
            bonus = (1 - prob) @ model.bonus[..., 0] + prob @ model.bonus[..., 1]
            out += step["percepts"] * bonus
        grid.add_values_ahead(model, self._reader(table), x, np.array(prob), out)
        return np.where(step["legal"], out, -np.inf)


class _ValueIteration:
    """Value iteration for a MOMDP with infinite precision and one latent class for each truth.

    An axis is fine enough if halving its steps lowers the bound by at most `tolerance` (in
    seconds), or would take more multiplications than are left of `work`.
    """

    def __init__(self, momdp: MOMDP, model: MOMDPArrays, tolerance: float, work: float) -> None:
        self.momdp = momdp
        self.model = model
        self.tolerance = tolerance
        self.work = work
        self.spent = 0.0
        self.edges = Edges.of(momdp, model)

    def bounds(self, points: int) -> Table:
        """Compute upper bounds on a grid of at most `points` points.

        Attributes need different numbers of points. First, all axes are refined together. Then, in
        each round, the steps of every axis are halved for one sweep. The axis that lowers the bound
        at the start most for its number of points is kept, and sweeps follow until nothing changes.
        """
        table = self._swept(self._coarsest(points))
        fall = np.inf
        finer = dict.fromkeys(np.flatnonzero(table.size > 1).tolist(), 1)  # next level of an axis
        while fall > self.tolerance:
            even = self._finer(table, finer, points // _EVENLY)
            if even is None:
                break
            even = self._swept(even)
            fall = self._at_start(table) - self._at_start(even)
            table = even
            finer = {i: level + 1 for i, level in finer.items()}
        fine: set[int] = set()

        def merit(other: Table) -> float:
            # Fall of the bound at the start, for each factor e in points.
            growth = math.log(other.value.shape[1] / table.value.shape[1])
            return (self._at_start(table) - self._at_start(other)) / growth

        while True:
            tables = {i: self._finer(table, {i: finer[i]}, points) for i in finer if i not in fine}
            tried = {i: finer_table for i, finer_table in tables.items() if finer_table}
            if not tried:
                return table
            best = next(iter(tried))
            if len(tried) > 1:
                tried = {i: self._swept(candidate, sweeps=1) for i, candidate in tried.items()}
                best = max(tried, key=lambda i: merit(tried[i]))
            refined = self._swept(tried[best])
            fall = self._at_start(table) - self._at_start(refined)
            fine = fine | {best} if fall <= self.tolerance else set()
            table = refined
            finer[best] += 1

    def estimate(self, bounds: Table, points: int) -> Table:
        """Estimate the optimum by smooth interpolation, starting from the bounds.

        Linear interpolation adds a small error at every step, so a policy with a coarse table
        reports too late. With smooth interpolation on an even grid, errors do not add up. The
        estimate has its own grid of at most `points` points. It is close to the optimum, but not a
        bound.
        """
        moving = np.flatnonzero(bounds.size > 1)
        if not len(moving):
            return bounds
        inner = _inner_points(bounds.size[moving].astype(float), points)
        if math.isinf(self.work):
            return self._smoothed(bounds, inner) if min(inner) >= _LEAST else bounds
        # Values change most on a coarse grid, which also shows how many sweeps are necessary. The
        # next grid is as fine as possible for the same number of sweeps with the remaining work. A
        # table without enough sweeps has values that are too high.
        affordable = math.inf  # points
        for coarse in _COARSE:
            at_first = [min(coarse, points_inside) for points_inside in inner]
            if _FEWER * math.prod(points_inside + 2 for points_inside in at_first) > affordable:
                raise SettingsError(
                    f"A table of {len(moving)} attributes and {len(self.edges.edge)} pairs of a "
                    f"state and a behavior takes more than {self.work:.1g} multiplications; raise "
                    "`work`, or plan with POMCP, which needs no table."
                )
            earlier = self.spent
            bounds = self._smoothed(bounds, at_first)
            for_point = max(self.spent - earlier, 1.0) / bounds.value.shape[1]
            affordable = (self.work - self.spent) / for_point
        while math.prod(points_inside + 2 for points_inside in inner) > affordable:
            longest = max(inner)
            inner = [min(points_inside, longest - 1) for points_inside in inner]
        return self._smoothed(bounds, inner) if max(inner) > _COARSE[-1] else bounds

    def _smoothed(self, table: Table, inner: Sequence[int]) -> Table:
        """Iterate values with smooth interpolation on axes with given numbers of inner points."""
        moving = np.flatnonzero(table.size > 1)
        for i, points_inside in zip(moving.tolist(), inner, strict=True):
            table = grid.refine(table, i, grid.even_axis(self.momdp, i, points_inside))
        return self._swept(table, _SMOOTH_SWEEPS, smooth=True)

    def _swept(self, table: Table, sweeps: int = _SWEEPS, *, smooth: bool = False) -> Table:
        """Iterate values on the same grid until a sweep changes none of them."""
        axes = enumerate(table.axes)
        percepts = [percepts_on(self.momdp, i, axis, smooth=smooth) for i, axis in axes]
        value = table.value.astype(np.float64)
        backups = make_backups(self.momdp, self.edges, table, percepts)
        settled = _SETTLED
        if smooth:
            settled = _SMOOTH_SETTLED if math.isinf(self.work) else _SETTLED_AT_ONCE
        work = self.edges.work(value.shape[1], smooth=smooth)  # of an edge
        ending = Ending(settled * self.tolerance, sweeps, smooth, (self.work - self.spent) / work)
        self.spent += work * sweep(backups, value, np.zeros((4, value.shape[1])), ending)
        return table._replace(value=value)

    def _coarsest(self, points: int) -> Table:
        """Build the coarsest grid, with a constant that no value exceeds."""
        momdp = self.momdp
        moves = np.asarray(self.edges.moves.any(axis=1))
        axes = [
            grid.make_axis(momdp, i, 0) if moved else momdp.prior[i : i + 1]
            for i, moved in enumerate(moves.tolist())
        ]
        size = math.prod(len(axis) for axis in axes)
        if size > points:
            raise SettingsError(
                f"The coarsest grid of beliefs in {moves.sum()} attributes has {size} points; "
                f"`points` allows {points}. Increase `points`, or plan with POMCP, which needs no "
                "grid."
            )
        value = np.full((momdp.terminal, size), self._constant_bound())
        return grid.make_table(axes, value)

    def _constant_bound(self) -> float:
        """Return a bound on all values: the best answer, or the best bonus forever."""
        step = self.model.dynamics.step
        bonus = self.momdp.bonus.max(axis=2).sum(axis=0)
        best = max(self.momdp.correct, self.model.dynamics.exit_value)
        pay = (bonus * step["percepts"] - step["cost"])[step["legal"]]
        # The bonus forever: sum_t g^t (bonus - c) = (bonus - c) / (1 - g).
        leak = 1 - step["discount"][step["legal"]]
        lasting = leak > 0
        if (pay[~lasting] > 0).any():
            raise SettingsError(
                "Without a discount, the value of behaviors whose bonus exceeds their cost is "
                "infinite; plan with a discount below 1, or with POMCP."
            )
        return float(max(best, (pay[lasting] / leak[lasting]).max(initial=-np.inf)))

    def _finer(self, table: Table, levels: Mapping[int, int], points: int) -> Table | None:
        """Refine some axes to their levels.

        The result is None if the grid would have too many points, or if a sweep would take more
        work than is left.
        """
        axes = {i: grid.make_axis(self.momdp, i, level) for i, level in levels.items()}
        size = math.prod(len(axes.get(i, axis)) for i, axis in enumerate(table.axes))
        sweep = len(self.edges.edge) * self.edges.work(size, smooth=False)
        if not axes or size > points or self.spent + sweep > self.work:
            return None
        for i, axis in axes.items():
            table = grid.refine(table, i, axis)
        return table

    def _at_start(self, table: Table) -> float:
        """Return the bound at the start, which is a point of the grid."""
        axes = zip(table.axes, self.momdp.prior, strict=True)
        indices = [int(axis.searchsorted(p)) for axis, p in axes]
        point = np.ravel_multi_index(indices, tuple(table.size))
        return float(table.value[self.momdp.start, point])


def _inner_points(size: Floats, points: int) -> list[int]:
    """Return the numbers of inner points of the estimate's axes.

    With many attributes, axes that are finer in the bound get more points.
    """
    n = len(size)
    least = _LEAST + 2
    scale = 1.0
    if n < len(_INNER) or least**n > points:
        even = min(_INNER[min(n, len(_INNER) - 1)], int(points ** (1 / n)))
        return list(itertools.repeat(even, n))
    size = size * (points / size.prod()) ** (1 / n)
    while np.maximum(size * scale, least).prod() > points:
        scale *= 0.98
    return [int(points_on) - 2 for points_on in np.maximum(size * scale, least)]

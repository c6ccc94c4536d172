"""Value iteration from above on a grid of marginal beliefs, and the grid's refinement."""

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import set_frozen
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.factored.grid import (
    Floats,
    Table,
    even_axis,
    make_axis,
    make_table,
    refine,
)
from meal_bayes.planners.factored.operators import (
    Edges,
    Percepts,
    make_backups,
    make_edges,
    percepts_on,
    sweep,
)

_SWEEPS = 1_000  # at most; a table is a bound after any number of them
_SETTLED = 0.05  # of the tolerance: a sweep that changes less is the last
_SMOOTHED = 150  # sweeps of the estimate, at most
_INNER = (0, 101, 41, 25, 15, 11)  # uncertain beliefs on an axis of the estimate, by N
_LEAST = 9  # fewer are no grid
_EVENLY = 30  # an even grid has at most this share of the points, as halving N axes adds many


class _Grid(NamedTuple):
    """A table under iteration.

    Attributes
    ----------
    table : upper bounds.
    percepts : (N,) on its axes.
    levels : (N,) of the axes.
    bound : on the value at the start.
    """

    table: Table
    percepts: tuple[Percepts, ...]
    levels: tuple[int, ...]
    bound: float


@dataclass(frozen=True, slots=True)
class ValueIteration:
    """Value iteration of one problem.

    Attributes
    ----------
    momdp : of infinite precision, one latent class a truth.
    problem : the same, compiled.
    tolerance : an axis is fine enough when halving its steps lowers the bound by no more, reward.
    """

    momdp: MOMDP
    problem: Compiled
    tolerance: float
    edges: Edges = field(init=False, repr=False, compare=False)
    _made: dict[tuple[int, int], tuple[Floats, Percepts]] = field(
        default_factory=dict, repr=False, compare=False
    )  # axes of every attribute and level

    def __post_init__(self) -> None:
        set_frozen(self, edges=make_edges(self.momdp, self.problem))

    def bounds(self, points: int) -> Table:
        """Compute upper bounds on a grid of some points at most.

        Easy attributes need few points, hard ones many. So the grid is refined first evenly; then
        every round tries each axis at half its steps for one sweep, keeps the one that lowered the
        bound at the start most for the points it took, and sweeps until nothing changes.

        Raises
        ------
        SettingsError : the coarsest grid has more points, or no bound on the rewards is known.
        """
        grid = self._iterate(self._coarsest(points))
        moving = np.flatnonzero(grid.table.size > 1).tolist()
        fall = np.inf
        while fall > self.tolerance and (even := self._finer(grid, moving, points // _EVENLY)):
            even = self._iterate(even)
            grid, fall = even, grid.bound - even.bound
        fine: set[int] = set()
        while True:
            finer = {i: self._finer(grid, [i], points) for i in moving if i not in fine}
            tried = {i: g for i, g in finer.items() if g is not None}
            if not tried:
                return grid.table
            if len(tried) > 1:
                tried = {i: self._iterate(g, sweeps=1) for i, g in tried.items()}
            best = max(tried, key=lambda i: _gain(grid, tried[i]))
            chosen = self._iterate(tried[best])
            fine = fine | {best} if grid.bound - chosen.bound <= self.tolerance else set()
            grid = chosen

    def lowered(self, start: Table) -> Table:
        """Compute upper bounds on the grid of a table that holds such bounds already."""
        percepts = tuple(percepts_on(self.momdp, i, axis) for i, axis in enumerate(start.axes))
        return self._swept(start, percepts, _SETTLED, _SWEEPS)

    def estimate(self, bounds: Table, points: int) -> Table:
        """Estimate the optimum by smooth interpolation, starting from bounds: near, but no bound.

        Linear interpolation adds a little at every step ahead; a policy that trusts a coarse table
        puts the report off. Here nothing adds up, if the steps are even: the grid is one of its
        own, of some points at most.
        """
        moving = np.flatnonzero(bounds.size > 1).tolist()
        if not moving:
            return bounds
        inner = min(_INNER[min(len(moving), len(_INNER) - 1)], int(points ** (1 / len(moving))))
        if inner < _LEAST:
            return bounds
        for i in moving:
            bounds = refine(bounds, i, even_axis(self.momdp, i, inner))
        percepts = tuple(
            percepts_on(self.momdp, i, axis, smooth=True) for i, axis in enumerate(bounds.axes)
        )
        return self._swept(bounds, percepts, 0.1, _SMOOTHED, smooth=True)

    def _swept(
        self,
        table: Table,
        percepts: tuple[Percepts, ...],
        settled: float,
        sweeps: int,
        *,
        smooth: bool = False,
    ) -> Table:
        """Iterate until a sweep changes no value by more than a share of the tolerance."""
        value = table.value.astype(np.float64)
        backups = make_backups(self.momdp, self.edges, table, percepts)
        work = np.empty((4, value.shape[1]))
        sweep(backups, value, work, settled * self.tolerance, sweeps, smooth)
        return table._replace(value=value)

    def _iterate(self, grid: _Grid, sweeps: int = _SWEEPS) -> _Grid:
        table = self._swept(grid.table, grid.percepts, _SETTLED, sweeps)
        bound = table.value[self.momdp.start, table.position(self.momdp.prior)]
        return grid._replace(table=table, bound=float(bound))

    def _coarsest(self, points: int) -> _Grid:
        moves = self.edges.moves.any(axis=1)
        axes, percepts = zip(*(self._axis(i, 0) for i in range(len(moves))), strict=True)
        size, top = math.prod(len(axis) for axis in axes), self.worth_at_most()
        if size > points:
            raise SettingsError(
                f"The coarsest grid of beliefs in {moves.sum()} attributes has {size} points; "
                f"`points` allows {points}. Raise it, or plan with POMCP, which needs none."
            )
        table = make_table(axes, np.full((self.momdp.terminal, size), top))
        return _Grid(table, percepts, (0,) * len(axes), top)

    def _finer(self, grid: _Grid, attributes: list[int], points: int) -> _Grid | None:
        """Halve the steps of some axes, unless the grid would have too many points."""
        finer = {i: self._axis(i, grid.levels[i] + 1) for i in attributes}
        size = grid.table.size.tolist()
        for i, (axis, _) in finer.items():
            size[i] = len(axis)
        if not attributes or math.prod(size) > points:
            return None
        table, percepts, levels = grid.table, list(grid.percepts), list(grid.levels)
        for i, (axis, own) in finer.items():
            table, percepts[i] = refine(table, i, axis), own
            levels[i] += 1
        return _Grid(table, tuple(percepts), tuple(levels), grid.bound)

    def _axis(self, i: int, level: int) -> tuple[Floats, Percepts]:
        """Build an axis, a single point where no percept moves the belief, and the percepts."""
        if (i, level) not in self._made:
            momdp, moves = self.momdp, self.edges.moves[i].any()
            axis = make_axis(momdp, i, level) if moves else momdp.prior[i : i + 1]
            self._made[i, level] = axis, percepts_on(momdp, i, axis)
        return self._made[i, level]

    def worth_at_most(self) -> float:
        """Bound every value by a constant: the best ending, or the best pay for ever.

        Raises
        ------
        SettingsError : shaping that pays more than a behavior costs, undiscounted.
        """
        problem, bonus = self.problem, self.momdp.bonus.max(axis=2).sum(axis=0)
        best = max(self.momdp.correct, float(problem.exit_value[:-1].max()))
        pay = (bonus * problem.bonus_scale - problem.cost)[problem.legal]
        kept = 1 - problem.discount[problem.legal]
        lasting = kept > 0
        if (pay[~lasting] > 0).any():
            raise SettingsError(
                "Undiscounted, behaviors that are shaped to pay more than they cost promise "
                "without end; plan with a discount below 1, or with POMCP."
            )
        return float(max(best, (pay[lasting] / kept[lasting]).max(initial=-np.inf)))


def _gain(grid: _Grid, finer: _Grid) -> float:
    growth = finer.table.value.shape[1] / grid.table.value.shape[1]
    return float((grid.bound - finer.bound) / np.log(growth))

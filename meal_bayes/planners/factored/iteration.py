"""Value iteration from above on a grid of marginal beliefs, and the grid's refinement."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import set_frozen
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.factored.grid import Table, even_axis, make_axis, make_table, refine
from meal_bayes.planners.factored.sweep import Edges, Matrices, make_backups, percepts_on, sweep

_SWEEPS = 1_000  # at most; a table is a bound after any number of them
_SETTLED = 0.05  # of the tolerance: a sweep that changes less is the last
_SMOOTHED, _SMOOTH_SETTLED = 150, 0.1  # the same of the estimate
_INNER = (0, 101, 41, 25, 15)  # uncertain beliefs on an axis of the estimate, by N; five share
_LEAST = 9  # fewer are no grid
_EVENLY = 30  # an even grid has at most this share of the points, as halving N axes adds many


class _Grid(NamedTuple):
    """Upper bounds, and how often each of the N axes was refined."""

    table: Table
    levels: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class ValueIteration:
    """Value iteration of a MOMDP of infinite precision and one latent class a truth.

    An axis is fine enough when halving its steps lowers the bound by no more than `tolerance` (s).
    """

    momdp: MOMDP
    problem: Compiled
    tolerance: float
    edges: Edges = field(init=False, repr=False, compare=False)
    _percepts: dict[tuple[int, int, bool], Matrices] = field(
        default_factory=dict, repr=False, compare=False
    )  # by attribute, size of its axis, and interpolation

    def __post_init__(self) -> None:
        set_frozen(self, edges=Edges.of(self.momdp, self.problem))

    def bounds(self, points: int) -> Table:
        """Compute upper bounds on a grid of so many points at most.

        Easy attributes need few points, hard ones many. So the grid is refined first evenly; then
        every round tries each axis at half its steps for one sweep, keeps the one that lowered the
        bound at the start most for the points it took, and sweeps until nothing changes.

        Raises
        ------
        SettingsError
            The coarsest grid has more points, or no bound on the rewards is known.
        """
        grid, fall = self._lowered(self._coarsest(points)), np.inf
        moving = np.flatnonzero(grid.table.size > 1).tolist()
        while fall > self.tolerance and (even := self._finer(grid, moving, points // _EVENLY)):
            even = self._lowered(even)
            grid, fall = even, self._fall(grid, even)
        fine: set[int] = set()

        def grown(finer: _Grid) -> float:
            return math.log(finer.table.value.shape[1] / grid.table.value.shape[1])

        while True:
            finer = {i: self._finer(grid, [i], points) for i in moving if i not in fine}
            tried = {i: g for i, g in finer.items() if g is not None}
            if not tried:
                return grid.table
            best = next(iter(tried))
            if len(tried) > 1:
                tried = {i: self._lowered(g, sweeps=1) for i, g in tried.items()}
                best = max(tried, key=lambda i: self._fall(grid, tried[i]) / grown(tried[i]))
            chosen = self._lowered(tried[best])
            fine = fine | {best} if self._fall(grid, chosen) <= self.tolerance else set()
            grid = chosen

    def lowered(self, table: Table, sweeps: int = _SWEEPS) -> Table:
        """Iterate upper bounds, on their own grid, until a sweep changes none of them."""
        return self._swept(table, sweeps, _SETTLED, smooth=False)

    def estimate(self, bounds: Table, points: int) -> Table:
        """Estimate the optimum by smooth interpolation, starting from bounds.

        Linear interpolation adds a little at every step ahead; a policy that trusts a coarse table
        puts the report off. Here nothing adds up, if the steps are even: the grid is one of its
        own, of so many points at most. What results is near the optimum, but no bound.
        """
        moving = np.flatnonzero(bounds.size > 1)
        if not len(moving):
            return bounds
        inner = _inner_points(bounds.size[moving].astype(float), points)
        if min(inner) < _LEAST:
            return bounds
        for i, each in zip(moving.tolist(), inner, strict=True):
            bounds = refine(bounds, i, even_axis(self.momdp, i, each))
        return self._swept(bounds, _SMOOTHED, _SMOOTH_SETTLED, smooth=True)

    def constant_bound(self) -> float:
        """Bound every value by a constant: the best ending, or the best pay for ever.

        Raises
        ------
        SettingsError
            Shaping that pays more than a behavior costs, undiscounted.
        """
        step, bonus = self.problem.dynamics.step, self.momdp.bonus.max(axis=2).sum(axis=0)
        best = max(self.momdp.correct, self.problem.dynamics.exit_value)
        pay = (bonus * step["bonus_scale"] - step["cost"])[step["legal"]]
        kept = 1 - step["discount"][step["legal"]]
        lasting = kept > 0
        if (pay[~lasting] > 0).any():
            raise SettingsError(
                "Undiscounted, behaviors that are shaped to pay more than they cost promise "
                "without end; plan with a discount below 1, or with POMCP."
            )
        return float(max(best, (pay[lasting] / kept[lasting]).max(initial=-np.inf)))

    def forget_grids(self) -> None:
        """Clear what was kept of all grids; it is built again when needed."""
        self._percepts.clear()

    def _swept(self, table: Table, sweeps: int, settled: float, *, smooth: bool) -> Table:
        percepts = []
        for i, axis in enumerate(table.axes):
            key = i, len(axis), smooth
            if key not in self._percepts:
                self._percepts[key] = percepts_on(self.momdp, i, axis, smooth=smooth)
            percepts.append(self._percepts[key])
        value = table.value.astype(np.float64)
        backups = make_backups(self.momdp, self.edges, table, percepts)
        scratch = np.zeros((4, value.shape[1]))
        sweep(backups, value, scratch, settled * self.tolerance, sweeps, smooth)
        return table._replace(value=value)

    def _lowered(self, grid: _Grid, sweeps: int = _SWEEPS) -> _Grid:
        return grid._replace(table=self.lowered(grid.table, sweeps))

    def _coarsest(self, points: int) -> _Grid:
        momdp, moves = self.momdp, np.asarray(self.edges.moves.any(axis=1))
        axes = [
            make_axis(momdp, i, 0) if moved else momdp.prior[i : i + 1]
            for i, moved in enumerate(moves.tolist())
        ]
        size = math.prod(len(axis) for axis in axes)
        if size > points:
            raise SettingsError(
                f"The coarsest grid of beliefs in {moves.sum()} attributes has {size} points; "
                f"`points` allows {points}. Raise it, or plan with POMCP, which needs none."
            )
        value = np.full((momdp.terminal, size), self.constant_bound())
        return _Grid(make_table(axes, value), (0,) * len(axes))

    def _finer(self, grid: _Grid, attributes: Sequence[int], points: int) -> _Grid | None:
        """Divide the steps of some axes by two; None if the grid would have too many points."""
        table, levels, size = grid.table, list(grid.levels), grid.table.size.copy()
        axes = {i: make_axis(self.momdp, i, levels[i] + 1) for i in attributes}
        for i, axis in axes.items():
            size[i] = len(axis)
        if not attributes or math.prod(size.tolist()) > points:
            return None
        for i, axis in axes.items():
            table, levels[i] = refine(table, i, axis), levels[i] + 1
        return _Grid(table, tuple(levels))

    def _fall(self, grid: _Grid, finer: _Grid) -> float:
        """Compute by how much the bound at the start has fallen."""
        x, prior = self.momdp.start, self.momdp.prior
        one, other = (t.value[x, t.position(prior)] for t in (grid.table, finer.table))
        return float(one - other)


def _inner_points(size: NDArray[np.float64], points: int) -> list[int]:
    """Return how many uncertain beliefs each axis of the estimate has, given those of the bounds.

    Where many attributes share the points, axes that the bounds refined most get most.
    """
    n, least, scale = len(size), _LEAST + 2, 1.0
    if n < len(_INNER) or least**n > points:
        return [min(_INNER[min(n, len(_INNER) - 1)], int(points ** (1 / n)))] * n
    size = size * (points / size.prod()) ** (1 / n)
    while np.maximum(size * scale, least).prod() > points:
        scale *= 0.98
    return [int(each) - 2 for each in np.maximum(size * scale, least)]

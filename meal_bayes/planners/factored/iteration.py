"""Value iteration from above on a grid of marginal beliefs, and the grid's refinement."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.factored.grid import (
    Percepts,
    Table,
    even_axis,
    expectation,
    make_axis,
    make_table,
    percepts_on,
    refine,
    telling,
)

_SWEEPS = 1_000  # at most; a table is a bound after any number of them
_SETTLED = 0.05  # of the tolerance: a sweep that changes less is the last
_SMOOTHED = 150  # sweeps of the estimate, at most
_INNER = (0, 101, 41, 25, 15, 11)  # uncertain beliefs on an axis of the estimate, by N
_LEAST = 9  # fewer are no grid
_EVENLY = 30  # an even grid has at most this share of the points, as halving N axes adds many
_LOOPED = 0.2  # of what a visit to an x has changed: what its loops may still change


class Grid(NamedTuple):
    """A table under iteration."""

    table: Table
    percepts: tuple[Percepts, ...]  # (N,)
    levels: tuple[int, ...]  # (N,) of the axes
    bound: float  # on the value at the start


def solve_on_grid(momdp: MOMDP, problem: Compiled, *, points: int, tolerance: float) -> Table:
    """Solve on a grid that is refined first evenly, then wherever that lowers the bound most.

    Easy attributes need few points, hard ones many. So each later round tries every axis at half
    its steps for one sweep, keeps the one that lowered the bound at the start most for the points
    it took, and sweeps until nothing changes.

    Parameters
    ----------
    momdp : of infinite precision, one kind of object a truth.
    problem : the same, compiled.
    points : of the grid, at most.
    tolerance : an axis is fine enough when halving its steps lowers the bound by no more.

    Raises
    ------
    SettingsError : the coarsest grid has more points, or no bound on the rewards is known.
    """
    settled = _SETTLED * tolerance
    grid = iterate(momdp, problem, _coarsest(momdp, problem, points), settled)
    moving = np.flatnonzero(grid.table.size > 1).tolist()
    fall = np.inf
    while fall > tolerance and (even := _finer(momdp, grid, moving, points // _EVENLY)):
        even = iterate(momdp, problem, even, settled)
        grid, fall = even, grid.bound - even.bound
    fine: set[int] = set()
    while True:
        finer = {i: _finer(momdp, grid, [i], points) for i in moving if i not in fine}
        tried = {i: g for i, g in finer.items() if g is not None}
        if not tried:
            return grid.table
        if len(tried) > 1:
            tried = {i: iterate(momdp, problem, g, settled, sweeps=1) for i, g in tried.items()}
        best = max(tried, key=lambda i: _gain(grid, tried[i]))
        chosen = iterate(momdp, problem, tried[best], settled)
        fine = fine | {best} if grid.bound - chosen.bound <= tolerance else set()
        grid = chosen


def solve_again(momdp: MOMDP, problem: Compiled, start: Table, tolerance: float) -> Table:
    """Solve another MOMDP on the grid of a table, whose values must bound its values."""
    percepts = tuple(percepts_on(momdp, i, axis) for i, axis in enumerate(start.axes))
    table = start._replace(value=start.value.astype(float), tells=telling(momdp))
    grid = Grid(table, percepts, (), np.inf)
    return iterate(momdp, problem, grid, _SETTLED * tolerance).table


def _coarsest(momdp: MOMDP, problem: Compiled, points: int) -> Grid:
    tells = telling(momdp)
    axes = [
        make_axis(momdp, i, 0) if told.any() else momdp.prior[i : i + 1]
        for i, told in enumerate(tells)
    ]
    size, top = math.prod(len(axis) for axis in axes), worth_at_most(momdp, problem)
    if size > points:
        raise SettingsError(
            f"The coarsest grid of beliefs in {tells.any(axis=1).sum()} attributes has {size} "
            f"points; `points` allows {points}. Raise it, or plan with POMCP, which needs none."
        )
    table = make_table(axes, tells, np.full((momdp.terminal, size), top))
    percepts = tuple(percepts_on(momdp, i, axis) for i, axis in enumerate(axes))
    return Grid(table, percepts, (0,) * len(axes), top)


def _finer(momdp: MOMDP, grid: Grid, axes: list[int], points: int) -> Grid | None:
    """Halve the steps of some axes, unless the grid would have too many points."""
    finer = {i: make_axis(momdp, i, grid.levels[i] + 1) for i in axes}
    size = [len(finer[i]) if i in finer else n for i, n in enumerate(grid.table.size.tolist())]
    if not axes or math.prod(size) > points:
        return None
    table, percepts, levels = grid.table, list(grid.percepts), list(grid.levels)
    for i, axis in finer.items():
        table, percepts[i] = refine(table, i, axis), percepts_on(momdp, i, axis)
        levels[i] += 1
    return Grid(table, tuple(percepts), tuple(levels), grid.bound)


def _gain(grid: Grid, finer: Grid) -> float:
    growth = finer.table.value.shape[1] / grid.table.value.shape[1]
    return float((grid.bound - finer.bound) / np.log(growth))


def worth_at_most(momdp: MOMDP, problem: Compiled) -> float:
    """Bound every value by a constant: the best ending, or the best pay for ever.

    Raises
    ------
    SettingsError : shaping that pays more than a behavior costs, undiscounted.
    """
    best = max(momdp.correct, float(problem.exit_value[:-1].max()))
    pay = momdp.bonus.max(axis=2).sum(axis=0) * problem.bonus_scale - problem.cost  # (X,E)
    pay, kept = pay[problem.legal], 1 - problem.discount[problem.legal]
    if (pay[kept <= 0] > 0).any():
        raise SettingsError(
            "Undiscounted, behaviors that are shaped to pay more than they cost promise without "
            "end; plan with a discount below 1, or with POMCP."
        )
    lasting = kept > 0
    return float(max(best, (pay[lasting] / kept[lasting]).max(initial=-np.inf)))


class _Edge(NamedTuple):
    """A legal behavior of an x: where it leads, with discounted probabilities."""

    behavior: int
    sensed: list[tuple[float, int]]  # (weight, next x) with a percept
    silent: list[tuple[float, int]]  # and without

    def keeps(self, x: int) -> bool:
        return any(target == x for _, target in self.sensed + self.silent)


def smoothed(momdp: MOMDP, problem: Compiled, table: Table, points: int, tolerance: float) -> Table:
    """Estimate the optimum by smooth interpolation, starting from a bound: no bound, but near.

    Linear interpolation adds a little at every step ahead; a policy that trusts a coarse table
    puts the report off. Here nothing adds up, if the steps are even: the grid is one of its own.
    """
    moving = np.flatnonzero(table.size > 1).tolist()
    inner = min(_INNER[min(len(moving), len(_INNER) - 1)], int(points ** (1 / max(1, len(moving)))))
    if inner < _LEAST or not moving:
        return table
    for i in moving:
        table = refine(table, i, even_axis(momdp, i, inner))
    percepts = tuple(percepts_on(momdp, i, axis, smooth=True) for i, axis in enumerate(table.axes))
    grid = Grid(table._replace(value=table.value.astype(float)), percepts, (), np.inf)
    return iterate(momdp, problem, grid, 0.1 * tolerance, sweeps=_SMOOTHED, smooth=True).table


def iterate(
    momdp: MOMDP,
    problem: Compiled,
    grid: Grid,
    settled: float,
    *,
    sweeps: int = _SWEEPS,
    smooth: bool = False,
) -> Grid:
    """Sweep over the x, latest first, until a sweep changes no value by more than `settled`.

    Values only fall, unless interpolation is smooth.
    """
    table, beliefs = grid.table, grid.table.beliefs
    report = momdp.report_reward(np.maximum(beliefs, 1 - beliefs))  # (B,)
    slope = momdp.bonus[..., 1] - momdp.bonus[..., 0]  # (N,E)
    edges = [_edges(problem, x) for x in range(momdp.terminal)]
    value = list(table.value)

    def backup(x: int, edge: _Edge) -> NDArray[np.float64]:
        e, total = edge.behavior, np.zeros(len(beliefs))
        if edge.sensed:
            total = expectation(table, grid.percepts, e, _mix(value, edge.sensed))
        if edge.silent:
            total = total + _mix(value, edge.silent)
        total -= problem.cost[x, e]
        if problem.shaped:
            bonus = momdp.bonus[:, e, 0].sum() + beliefs @ slope[:, e]
            total += problem.bonus_scale[x, e] * bonus
        return total

    def settle(x: int) -> float:
        """Lower the values of x, again while behaviors that keep it do; return by how much."""
        floor, fallen = np.maximum(report, problem.exit_value[x]), 0.0
        loops = [edge for edge in edges[x] if edge.keeps(x)]
        for edge in edges[x]:
            if edge not in loops:
                np.maximum(floor, backup(x, edge), out=floor)
        while True:
            new = floor.copy()
            for edge in loops:
                np.maximum(new, backup(x, edge), out=new)
            if not smooth:
                np.minimum(new, value[x], out=new)
            fall, value[x] = float(np.abs(value[x] - new).max()), new
            fallen = max(fallen, fall)
            if smooth or not loops or fall <= max(settled, _LOOPED * fallen):
                return fallen

    for _ in range(sweeps):
        if max(settle(x) for x in reversed(range(momdp.terminal))) <= settled:
            break
    if smooth:
        return grid._replace(table=table._replace(value=np.stack(value)))
    point = 0
    for axis, p in zip(table.axes, momdp.prior, strict=True):
        point = point * len(axis) + int(axis.searchsorted(p))
    bound = value[momdp.start][point]
    return grid._replace(table=table._replace(value=np.stack(value)), bound=float(bound))


def _edges(problem: Compiled, x: int) -> list[_Edge]:
    out = []
    for e in np.flatnonzero(problem.legal[x]).tolist():
        edge = _Edge(e, [], [])
        for k in range(problem.branches[x, e]):
            weight = float(problem.discount[x, e] * problem.branch_p[x, e, k])
            part = edge.sensed if problem.branch_sense[x, e, k] else edge.silent
            part.append((weight, int(problem.branch_x[x, e, k])))
        out.append(edge)
    return out


def _mix(value: list[NDArray[np.float64]], parts: list[tuple[float, int]]) -> NDArray[np.float64]:
    total = parts[0][0] * value[parts[0][1]]
    for weight, x in parts[1:]:
        total += weight * value[x]
    return total

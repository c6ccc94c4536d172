"""Bellman backups on the grid: the expectation over percepts, and sweeps over all x.

As percepts of the attributes are independent and interpolation is multilinear, the expectation over
all K^N percept vectors is a Kronecker product of N sparse matrices, applied one axis after the
other: 2 K N multiplications a point instead of (2 K)^N.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.compiled import Compiled
from meal_bayes.planners.factored.grid import Table, between, informative_pairs
from meal_bayes.planners.kernels import entry_kernel, kernel

_BLOCK = 32  # rows that fit the cache together
_LOOPED = 0.2  # of what a visit to an x has changed: what its loops may still change

Matrices = tuple[Ints, Floats]  # columns and entries (E,G,J) of sparse matrices (G,G)


class Edges(NamedTuple):
    """The M legal pairs of x and behavior, whatever the grid."""

    edge: Ints  # (M,3) x, behavior, and 1 if it may keep x
    outcome: Floats  # (M,2,X-1) discounted Pr(next x), without and with a percept
    reward: Floats  # (M,1+N) a constant, and slopes in the marginals
    exit_value: float  # of abstaining
    moves: NDArray[np.bool_]  # (N,E) do percepts move the belief?

    @classmethod
    def of(cls, momdp: MOMDP, problem: Compiled) -> "Edges":
        """List the legal pairs of a problem."""
        dynamics = problem.dynamics
        x, e = np.nonzero(dynamics.step["legal"][: momdp.terminal])
        step, branch = dynamics.step[x, e], dynamics.branch[x, e]  # (M,), (M,B)
        p = step["discount"][:, None] * branch["p"]  # 0 beyond the branches
        outcome, rows = np.zeros((len(x), 2, momdp.terminal)), np.arange(len(x))
        at = rows[:, None], branch["senses"].astype(int), branch["x"]
        np.add.at(outcome, at, p)
        bonus = np.vstack([momdp.bonus[..., 0].sum(axis=0), np.diff(momdp.bonus)[..., 0]])
        reward = step["bonus_scale"][:, None] * bonus[:, e].T
        reward[:, 0] -= step["cost"]
        edge = np.stack([x, e, outcome[rows, :, x].any(axis=1)], axis=1)
        moves = informative_pairs(momdp)
        return cls(np.ascontiguousarray(edge), outcome, reward, dynamics.exit_value, moves)


class Backups(NamedTuple):
    """All that a sweep reads besides the values."""

    edge: Ints  # of `Edges`, as `outcome`
    outcome: Floats
    reward: Floats  # (M,B), or (M,1) where it is the same for every belief
    floor: Floats  # (B,) value of ending
    size: Ints  # (N,) of the axes
    point: Ints  # (N,E,G,J) columns of the percepts' matrices; -1 first: the belief stays
    weight: Floats  # (N,E,G,J) entries


def percepts_on(momdp: MOMDP, attribute: int, axis: Floats, *, smooth: bool = False) -> Matrices:
    """Build the sparse matrices of an attribute's percepts, one a behavior.

    Row g weighs the points beside each belief that may follow point g: linearly in the belief,
    never below a convex function (J = 2K), or smooth, cubic in log-odds, but no bound (J = 4K).
    """
    false, true = momdp.confusion[attribute].transpose(1, 0, 2)[..., None]  # (E,K,1)
    joint = true * axis
    p = joint + false * (1 - axis)  # (E,K,G)
    after = np.divide(joint, p, out=np.broadcast_to(axis, p.shape).copy(), where=p > 0)
    low, fraction = between(axis, after)
    point = np.stack([low, np.minimum(low + 1, len(axis) - 1)], axis=-1)
    weight = np.stack([1 - fraction, fraction], axis=-1)
    if smooth:
        point, weight = _cubic(axis, after, low, point, weight)
    shape = (len(p), len(axis), -1)
    point, weight = (part.transpose(0, 2, 1, 3) for part in (point, p[..., None] * weight))
    return point.reshape(shape), weight.reshape(shape)


def _cubic(axis: Floats, at: Floats, low: Ints, point: Ints, weight: Floats) -> tuple[Ints, Floats]:
    """Interpolate by the cubic through four points in log-odds; linearly next to certainty."""
    last = len(axis) - 1
    point = np.concatenate([point, point], axis=-1)
    weight = np.concatenate([weight, np.zeros_like(weight)], axis=-1)
    inner = (low > 0) & (low < last - 1)
    if last < 5 or not inner.any():  # four points and certainty on both sides
        return point, weight
    log_odds = np.log(axis[1:-1]) - np.log1p(-axis[1:-1])
    four = np.clip(low[inner] - 1, 1, last - 4)[:, None] + np.arange(4)
    x, node = np.log(at[inner]) - np.log1p(-at[inner]), log_odds[four - 1]  # (B,), (B,4)
    factor = np.ones_like(node)
    for i, j in np.argwhere(~np.eye(4, dtype=np.bool_)).tolist():
        factor[:, i] *= (x - node[:, j]) / (node[:, i] - node[:, j])
    point[inner], weight[inner] = four, factor
    return point, weight


def make_backups(momdp: MOMDP, edges: Edges, table: Table, percepts: Sequence[Matrices]) -> Backups:
    """Build the arrays of `sweep` for the grid of a table and the percepts (N,) on its axes."""
    axes, reward = table.axes, np.ascontiguousarray(edges.reward[:, :1])  # one layout, one kernel
    if edges.reward[:, 1:].any():
        slopes = edges.reward[:, 1:].T[..., None]  # (N,M,1)
        pay = table.combined(map(np.multiply, slopes, axes), np.add)
        reward = np.add(reward, pay, out=pay)
    shape = (*edges.moves.shape, table.points.shape[1], max(part.shape[2] for part, _ in percepts))
    point, weight = np.zeros(shape, np.int64), np.zeros(shape)
    for i, (size, part) in enumerate(zip(table.size.tolist(), percepts, strict=True)):
        point[i, :, :size], weight[i, :, :size] = part
    point[~edges.moves, 0, 0] = -1
    right = table.combined((np.maximum(axis, 1 - axis) for axis in axes), np.multiply)  # (B,)
    floor = np.maximum(momdp.report_reward(right[:, None]), edges.exit_value)
    return Backups(edges.edge, edges.outcome, reward, floor, table.size, point, weight)


@entry_kernel
def sweep(backups, value, scratch, settled, sweeps, smooth):
    """Update the values (X-1,B) of every x, latest first, until a sweep changes none by `settled`.

    Values only fall, unless interpolation is smooth. Within a sweep, an x is backed up again while
    behaviors that keep it lower its values; not if smooth. `scratch` (4,B) comes with zeros.
    """
    edge, points = backups.edge, value.shape[1]
    for _ in range(sweeps):
        largest = 0.0
        for x in range(value.shape[0] - 1, -1, -1):
            for b in range(points):
                scratch[0, b] = backups.floor[b]
            fallen, keeps, loops = 0.0, min(0, x), False
            while True:  # once those that leave x, then those that may keep it
                for m in range(edge.shape[0]):
                    if edge[m, 0] == x and edge[m, 2] == keeps:
                        loops = keeps == 1
                        _back_up(backups, value, m, scratch, keeps)
                fall = 0.0
                for b in range(points):
                    if keeps == 1:
                        new = scratch[1, b] if smooth else min(scratch[1, b], value[x, b])
                        fall = max(fall, abs(value[x, b] - new))
                        value[x, b] = new
                    scratch[1, b] = scratch[0, b]
                fallen = max(fallen, fall)
                if keeps == 1 and (smooth or not loops or fall <= max(settled, _LOOPED * fallen)):
                    break
                keeps = min(1, points)
            largest = max(largest, fallen)
        if largest <= settled:
            return


@kernel
def _back_up(backups, value, m, scratch, row):
    """Raise scratch[row] to the value of edge m, one step ahead of the values."""
    outcome, reward, points = backups.outcome, backups.reward, value.shape[1]
    source = min(2, scratch.shape[0])  # not a literal, for which there would be a second kernel
    scratch[2] = 0.0
    for percept in range(1, -1, -1):  # sum over x' of Pr(x', no z) V(x', b) + Pr(x', z) E V(x', b')
        comes = False
        for x in range(value.shape[0]):
            p = outcome[m, percept, x]
            if p > 0.0:
                comes = True
                for b in range(points):
                    scratch[source, b] += p * value[x, b]
        if percept == 1 and comes:
            left = min(1, points)  # no literal either
            for i in range(backups.size.shape[0]):
                if backups.point[i, backups.edge[m, 1], 0, 0] >= 0:
                    _expect(backups, i, backups.edge[m, 1], left, scratch, source)
                    source = 5 - source
                left *= backups.size[i]
    for b in range(points):
        pay = reward[m, b if reward.shape[1] > 1 else 0]
        scratch[row, b] = max(scratch[row, b], scratch[source, b] + pay)


@kernel
def _expect(backups, i, e, left, scratch, source):
    """Compute the expectation of scratch[source] over percepts of attribute i -> [5 - source].

    Rows have J entries, a multiple of four. The innermost loop runs over the later attributes, or,
    for the last one, over a block of the earlier ones.
    """
    point, weight, size = backups.point, backups.weight, backups.size[i]
    value, out = scratch[source], scratch[5 - source]
    right = scratch.shape[1] // (left * size)
    rows, step = (1, 1) if right > 1 else (_BLOCK, size)
    for first in range(0, left, rows):
        width = right if right > 1 else min(rows, left - first) * step
        for g in range(size):
            to = (first * size + g) * right
            for j in range(0, point.shape[3], 4):
                keep = 0.0 if j == 0 else 1.0
                a = (first * size + point[i, e, g, j]) * right
                b = (first * size + point[i, e, g, j + 1]) * right
                c = (first * size + point[i, e, g, j + 2]) * right
                d = (first * size + point[i, e, g, j + 3]) * right
                s, t = weight[i, e, g, j], weight[i, e, g, j + 1]
                u, v = weight[i, e, g, j + 2], weight[i, e, g, j + 3]
                for r in range(0, width, step):
                    first_two = s * value[np.uintp(a + r)] + t * value[np.uintp(b + r)]
                    last_two = u * value[np.uintp(c + r)] + v * value[np.uintp(d + r)]
                    place = np.uintp(to + r)
                    out[place] = keep * out[place] + (first_two + last_two)

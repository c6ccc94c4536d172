"""Bellman backups on the grid: expectations over percepts, and sweeps over all states.

Percepts of different attributes are independent and interpolation is multilinear. Therefore the
expectation over all K^N percept vectors is a Kronecker product of N sparse matrices, which are
applied to one axis after the other. This takes 2 K N multiplications per grid point instead of (2
K)^N.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP, Reports
from meal_bayes.planners.jit import by_reference, entry_kernel, kernel
from meal_bayes.planners.momdp_arrays import MOMDPArrays
from meal_bayes.planners.table.grid import Table, between, informative_pairs

_BLOCK = 32  # number of rows that fit into the CPU cache
_LOOPED = 0.2  # fraction of a visit's change below which its loops end

Matrices = tuple[Ints, Floats]  # columns and entries (E,G,J) of sparse matrices (G,G)


class Edges(NamedTuple):
    """The M legal pairs of x and behavior; they do not depend on the grid."""

    edge: Ints  # (M,3) x, behavior, and 1 if it may keep x
    outcome: Floats  # (M,2,X-1) discounted Pr(next x), without and with a percept
    reward: Floats  # (M,1+N) a constant, and slopes in the marginals
    exit_value: float  # of abstaining
    moves: NDArray[np.bool_]  # (N,E) do percepts move the belief?
    levels: int  # K of the percepts

    @classmethod
    def of(cls, momdp: MOMDP, model: MOMDPArrays) -> "Edges":
        """List the legal pairs of a problem."""
        dynamics = model.dynamics
        x, e = np.nonzero(dynamics.step["legal"][: momdp.terminal])
        step = dynamics.step[x, e]  # (M,)
        branch = dynamics.branch[x, e]  # (M,B)
        p = step["discount"][:, None] * branch["p"]  # 0 beyond the branches
        outcome = np.zeros((len(x), 2, momdp.terminal))
        row = np.arange(len(x))
        np.add.at(outcome, (row[:, None], branch["senses"].astype(int), branch["x"]), p)
        bonus = np.vstack([momdp.bonus[..., 0].sum(axis=0), np.diff(momdp.bonus)[..., 0]])
        reward = step["percepts"][:, None] * bonus[:, e].T
        reward[:, 0] -= step["cost"]
        edge = np.stack([x, e, outcome[row, :, x].any(axis=1)], axis=1)
        return cls(
            edge=np.ascontiguousarray(edge),
            outcome=outcome,
            reward=reward,
            exit_value=dynamics.exit_value,
            moves=informative_pairs(momdp),
            levels=momdp.levels,
        )

    def work(self, points: int, *, smooth: bool) -> float:
        """Return the approximate number of multiplications for one edge at `points` points."""
        outcomes = np.count_nonzero(self.outcome, axis=(1, 2))
        # Each informative attribute applies a matrix with 2K or 4K entries per row.
        applied = self.moves[:, self.edge[:, 1]].sum(axis=0) * self.outcome[:, 1].any(axis=1)
        entries = applied * (4 if smooth else 2) * self.levels
        return float(points * (2.0 + (outcomes + entries).sum() / max(len(self.edge), 1)))


class Matrix(NamedTuple):
    """A sparse matrix of an attribute's percept; rows of J entries, a multiple of four."""

    size: int  # rows and columns; G or fewer
    point: Ints  # (G,J) columns
    weight: Floats  # (G,J) entries


@by_reference
class Backups(NamedTuple):
    """The data of a sweep, without the values."""

    edge: Ints  # as in `Edges`
    outcome: Floats  # as in `Edges`
    reward: Floats  # (M,B), or (M,1) if it is the same for all beliefs
    floor: Floats  # (B,) value of answering
    size: Ints  # (N,) sizes of the axes
    point: Ints  # (N,E,G,J) columns of the percepts' matrices; the first is -1 for the identity
    weight: Floats  # (N,E,G,J) entries


def percepts_on(momdp: MOMDP, attribute: int, axis: Floats, *, smooth: bool = False) -> Matrices:
    """Build the sparse matrices of an attribute's percepts, one for each behavior.

    Row g contains the weights of the points next to the possible beliefs after point g.
    Interpolation is linear in the belief, which never lies below a convex function (J = 2K), or
    `smooth`, cubic in log-odds, which gives no bound (J = 4K).
    """
    false, true = momdp.confusion[attribute].transpose(1, 0, 2)[..., None]  # (E,K,1)
    # Bayes' rule: b' = b Pr(z | true) / Pr(z), Pr(z) = b Pr(z | true) + (1 - b) Pr(z | false).
    joint = true * axis
    p = joint + false * (1 - axis)  # (E,K,G)
    after = np.divide(joint, p, out=np.broadcast_to(axis, p.shape).copy(), where=p > 0)
    low, fraction = between(axis, after)
    point = np.stack([low, np.minimum(low + 1, len(axis) - 1)], axis=-1)
    weight = np.stack([1 - fraction, fraction], axis=-1)
    if smooth:
        point, weight = _cubic(axis, after, point, weight)
    shape = (len(p), len(axis), -1)
    by_point = point.transpose(0, 2, 1, 3).reshape(shape)
    return by_point, (p[..., None] * weight).transpose(0, 2, 1, 3).reshape(shape)


def _cubic(axis: Floats, at: Floats, point: Ints, weight: Floats) -> tuple[Ints, Floats]:
    """Interpolate by a cubic through four points in log-odds, and linearly next to certainty."""
    last = len(axis) - 1
    low = point[..., 0]
    point = np.concatenate([point, point], axis=-1)
    weight = np.concatenate([weight, np.zeros_like(weight)], axis=-1)
    inner = (low > 0) & (low < last - 1)
    if last < 5 or not inner.any():  # four points and certainty on both sides
        return point, weight
    log_odds = np.log(axis[1:-1]) - np.log1p(-axis[1:-1])
    four = np.clip(low[inner] - 1, 1, last - 4)[:, None] + np.arange(4)
    x = np.log(at[inner]) - np.log1p(-at[inner])  # (B,)
    node = log_odds[four - 1]  # (B,4)
    # Lagrange: factor_i = prod_{j != i} (x - node_j) / (node_i - node_j)
    factor = np.ones_like(node)
    for i, j in np.argwhere(~np.eye(4, dtype=np.bool_)).tolist():
        factor[:, i] *= (x - node[:, j]) / (node[:, i] - node[:, j])
    point[inner] = four
    weight[inner] = factor
    return point, weight


def make_backups(momdp: MOMDP, edges: Edges, table: Table, percepts: Sequence[Matrices]) -> Backups:
    """Build the arrays of `sweep` for the grid of a table and the percepts (N,) on its axes."""
    axes = table.axes
    reward = np.ascontiguousarray(edges.reward[:, :1])  # one layout, one kernel
    if edges.reward[:, 1:].any():
        slopes = edges.reward[:, 1:].T[..., None]  # (N,M,1)
        pay = table.combined(map(np.multiply, slopes, axes), np.add)
        reward = np.add(reward, pay, out=pay)
    shape = (*edges.moves.shape, table.points.shape[1], max(part.shape[2] for part, _ in percepts))
    point = np.zeros(shape, np.int64)
    weight = np.zeros(shape)
    for i, (size, (columns, entries)) in enumerate(zip(table.size.tolist(), percepts, strict=True)):
        point[i, :, :size] = columns
        weight[i, :, :size] = entries
    # The matrix of an uninformative percept is the identity.
    point[~edges.moves, 0, 0] = -1
    return Backups(
        edge=edges.edge,
        outcome=edges.outcome,
        reward=reward,
        floor=np.maximum(_best_reward(momdp.reports, table), edges.exit_value),
        size=table.size,
        point=point,
        weight=weight,
    )


def _best_reward(reports: Reports, table: Table) -> Floats:
    """Compute the reward of the best report at all points of the grid, (B,).

    It is convex in each marginal, because it is the maximum of linear functions.
    """
    event = reports.event
    # Values: r- + (r+ - r-) prod_i max(b_i, 1 - b_i). Yes or no: max over assertion and denial.
    if event is None:
        sure = (np.maximum(axis, 1 - axis) for axis in table.axes)
        return reports.of_right(table.combined(sure, np.multiply)[:, None])
    literals = (p if yes else 1 - p for p, yes in zip(table.axes, event.allowed, strict=True))
    conjunction = table.combined(literals, np.multiply)
    holds = 1 - conjunction if event.complement else conjunction
    return np.asarray(reports.answers(holds).max(axis=-1))


class Ending(NamedTuple):
    """When value iteration ends, and how it interpolates."""

    settled: float  # change of values in a sweep below which iteration ends
    sweeps: int  # largest number of sweeps
    smooth: bool  # is interpolation smooth?
    backups: float  # number of backed-up edges after which iteration ends


@entry_kernel
def sweep(backups, value, scratch, ending):
    """Update the values (X-1,B) of every x, last state first, until changes are below `settled`.

    Values only decrease, unless interpolation is smooth. `scratch` (4,B) must contain zeros.
    Returns the number of edges that were backed up.
    """
    made = np.int64(0)
    for _ in range(ending.sweeps):
        largest = 0.0
        # Later states first, because most behaviors lead to later states.
        for x in range(value.shape[0] - 1, -1, -1):
            change, backed_up = _update(backups, value, x, scratch, ending)
            largest = max(largest, change)
            made += backed_up
        if largest <= ending.settled or made >= ending.backups:
            break
    return made


@kernel
def _update(backups, value, x, scratch, ending):
    """Update the values (B,) of one x; return the largest change, and how many edges it took.

    V(x, b) = max(stop(b), max_a R(x, a, b) + g sum over x', z of Pr(x', z | x, a, b) V(x', b'_z))

    Behaviors that always leave x depend only on other states, so they are backed up once. Then the
    behaviors that may keep x are backed up as long as they lower the values, or once if smooth.
    """
    edge = backups.edge
    points = value.shape[1]
    made = np.int64(0)
    # scratch[0]: the best of ending and of the behaviors that leave x.
    for b in range(points):
        scratch[0, b] = backups.floor[b]
    for m in range(edge.shape[0]):
        if edge[m, 0] == x and edge[m, 2] == 0:
            made += 1
            _back_up(backups, value, m, scratch, np.int64(0))
    # scratch[1]: the best of all, which begins with those.
    for b in range(points):
        scratch[1, b] = scratch[0, b]
    changed = 0.0
    while True:
        loops = False
        for m in range(edge.shape[0]):
            if edge[m, 0] == x and edge[m, 2] == 1:
                loops = True
                made += 1
                _back_up(backups, value, m, scratch, np.int64(1))
        # min(U, T U) is an upper bound if U is one, and never increases.
        change = 0.0
        for b in range(points):
            backed_up = scratch[1, b] if ending.smooth else min(scratch[1, b], value[x, b])
            change = max(change, abs(value[x, b] - backed_up))
            value[x, b] = backed_up
            scratch[1, b] = scratch[0, b]
        changed = max(changed, change)
        if ending.smooth or not loops or change <= max(ending.settled, _LOOPED * changed):
            return changed, made


@kernel
def _back_up(backups, value, m, scratch, row):
    """Raise scratch[row] to the value of edge m, one step ahead of the values.

    sum over x' of Pr(x', no z) V(x', b) + Pr(x', z) E V(x', b'_z), and the edge's reward
    """
    outcome = backups.outcome
    reward = backups.reward
    points = value.shape[1]
    e = backups.edge[m, 1]
    source = np.int64(2)
    scratch[2] = 0.0
    # First the outcomes with a percept, then those without.
    for percept in range(1, -1, -1):
        comes = False
        for x in range(value.shape[0]):
            p = outcome[m, percept, x]
            if p > 0.0:
                comes = True
                for b in range(points):
                    scratch[source, b] += p * value[x, b]
        # E over K^N percept vectors = the attributes' matrices, one axis after the other.
        if percept == 1 and comes:
            earlier = np.int64(1)  # points of the axes before i
            for i in range(backups.size.shape[0]):
                if backups.point[i, e, 0, 0] >= 0:
                    matrix = Matrix(backups.size[i], backups.point[i, e], backups.weight[i, e])
                    _expect(matrix, earlier, scratch, source)
                    source = 5 - source
                earlier *= backups.size[i]
    for b in range(points):
        pay = reward[m, b if reward.shape[1] > 1 else 0]
        scratch[row, b] = max(scratch[row, b], scratch[source, b] + pay)


@kernel
def _expect(matrix, earlier, scratch, source):
    """Compute the expectation of scratch[source] over percepts of one attribute -> [5 - source].

    Values have the shape (points of earlier axes, of this axis, of later axes), and the matrix is
    applied to the middle index. The innermost loop is over the later points or, for the last
    attribute, over a block of earlier ones.
    """
    size = matrix.size
    point = matrix.point
    weight = matrix.weight
    value = scratch[source]
    out = scratch[5 - source]
    later = scratch.shape[1] // (earlier * size)
    # out[f, g, r] = sum_j weight[g, j] value[f, point[g, j], r], four entries j at a time
    rows = 1 if later > 1 else _BLOCK
    step = 1 if later > 1 else size
    for first in range(0, earlier, rows):
        width = later if later > 1 else min(rows, earlier - first) * step
        for g in range(size):
            to = (first * size + g) * later
            for j in range(0, point.shape[1], 4):
                keep = 0.0 if j == 0 else 1.0
                a = (first * size + point[g, j]) * later
                b = (first * size + point[g, j + 1]) * later
                c = (first * size + point[g, j + 2]) * later
                d = (first * size + point[g, j + 3]) * later
                s = weight[g, j]
                t = weight[g, j + 1]
                u = weight[g, j + 2]
                v = weight[g, j + 3]
                for r in range(0, width, step):
                    first_two = s * value[np.uintp(a + r)] + t * value[np.uintp(b + r)]
                    last_two = u * value[np.uintp(c + r)] + v * value[np.uintp(d + r)]
                    place = np.uintp(to + r)
                    out[place] = keep * out[place] + (first_two + last_two)

"""Tables over a grid of marginal beliefs: laid out, read off, and backed up by one percept.

The grid is a product of axes, one an attribute. As percepts of the attributes are independent and
interpolation is multilinear, the expectation over all K^N percept vectors is a Kronecker product
of N sparse matrices, applied one axis after the other: 2 K N multiplications a point instead of
(2 K)^N.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP
from meal_bayes.planners.kernels import entry_kernel, kernel

_EQUAL = 1e-12  # rows that differ by less, which is rounding, tell nothing
_WIDEST = 10.0  # log-odds that an axis reaches from the prior, at most; certainty follows
_NEAR, _STEP = 1.3, 0.15  # reach of an even axis of m points: 1.3 + 0.15 m


class Table(NamedTuple):
    """Values of beliefs, multilinear between the points of a product grid."""

    size: NDArray[np.int64]  # (N,) points of an axis; 1 where the belief never moves
    chance: NDArray[np.float64]  # (N,G) Pr(attribute is true) at an axis' points, padded by 1
    tells: NDArray[np.bool_]  # (N,E) do percepts of the behavior move the belief?
    value: NDArray[Any]  # (X-1,B) floats; B points, the last attribute's vary fastest

    @property
    def axes(self) -> tuple[NDArray[np.float64], ...]:
        """Pr(attribute is true) at the points of each axis, ascending."""
        return tuple(row[:size] for row, size in zip(self.chance, self.size, strict=True))

    @property
    def beliefs(self) -> NDArray[np.float64]:
        """All points, (B,N)."""
        points, left = int(self.size.prod()), 1
        out = np.empty((points, len(self.size)))
        for i, axis in enumerate(self.axes):  # of a query, there may be more than array dimensions
            out[:, i] = np.tile(np.repeat(axis, points // (left * len(axis))), left)
            left *= len(axis)
        return out


class Percepts(NamedTuple):
    """The next percept of one attribute, as a sparse matrix over its axis for each behavior.

    Row g holds the points beside each belief that may follow point g, weighted by the percept's
    probability and by linear interpolation.
    """

    point: NDArray[np.int64]  # (E,G,2K)
    weight: NDArray[np.float64]  # (E,G,2K)


class Room(NamedTuple):
    """Room for reading a table off one step ahead."""

    cell: NDArray[np.int64]  # (2K^N,) points that the next belief is spread over
    mass: NDArray[np.float64]  # (2K^N,) their weights
    near: NDArray[np.int64]  # (2K,) points of one axis
    share: NDArray[np.float64]  # (2K,) their weights


def telling(momdp: MOMDP) -> NDArray[np.bool_]:
    """Tell which behaviors' percepts can move the belief in which attributes, (N,E)."""
    differ = (np.abs(momdp.confusion[:, :, 1] - momdp.confusion[:, :, 0]) > _EQUAL).any(axis=-1)
    comes = (momdp.transition * momdp.informative).any(axis=2).T & momdp.legal  # (X,E)
    unsure = (momdp.prior > 0) & (momdp.prior < 1)
    return np.asarray(differ & comes.any(axis=0) & (momdp.limit > 0) & unsure[:, None])


def make_axis(momdp: MOMDP, attribute: int, level: int) -> NDArray[np.float64]:
    """Lay out beliefs in an attribute; each level halves the steps of the last.

    Points are even in log-odds around the prior, up to half of where the cheapest percept could
    not pay any more, and half as dense beyond; 0, 1/2 (where the best report changes) and 1 are
    points too.
    """
    worth = (momdp.correct - momdp.incorrect) / max(float(momdp.cost.min()), 1e-9)
    reach = float(np.clip(np.log(max(worth, 1.0)), _WIDEST / 2, _WIDEST))
    even = np.linspace(0.0, reach / 2, 2**level + 1)
    rest = np.linspace(reach / 2, reach, max(2**level // 2, 1) + 1)
    half = np.concatenate([even, rest[1:]])
    prior = float(momdp.prior[attribute])
    log_odds = np.log(prior / (1 - prior)) + np.concatenate([-half[:0:-1], half])
    if np.abs(log_odds).min() > 1e-6:  # noqa: PLR2004  no point of the axis yet
        log_odds = np.sort(np.append(log_odds, 0.0))
    return np.concatenate([[0.0], 1 / (1 + np.exp(-log_odds)), [1.0]])


def even_axis(momdp: MOMDP, attribute: int, inner: int) -> NDArray[np.float64]:
    """Lay out beliefs evenly in log-odds, as far around the prior as the steps stay small."""
    prior = float(momdp.prior[attribute])
    reach = _NEAR + _STEP * inner
    log_odds = np.log(prior / (1 - prior)) + np.linspace(-reach, reach, inner)
    return np.concatenate([[0.0], 1 / (1 + np.exp(-log_odds)), [1.0]])


def make_table(
    axes: Sequence[NDArray[np.float64]], tells: NDArray[np.bool_], value: NDArray[np.float64]
) -> Table:
    """Make a table of values (X-1,B) over the product of axes."""
    size = np.array([len(axis) for axis in axes])
    chance = np.ones((len(axes), int(size.max())))
    for row, axis in zip(chance, axes, strict=True):
        row[: len(axis)] = axis
    return Table(size, chance, tells, value)


def percepts_on(
    momdp: MOMDP, attribute: int, axis: NDArray[np.float64], *, smooth: bool = False
) -> Percepts:
    """Make the sparse matrices of an attribute's percepts.

    Linear interpolation is in the belief and never below a convex function; smooth interpolation
    is cubic in log-odds, no bound but much nearer (4 points instead of 2).
    """
    false, true = momdp.confusion[attribute].transpose(1, 0, 2)[..., None]  # (E,K,1)
    joint = true * axis
    p = joint + false * (1 - axis)  # (E,K,G)
    after = np.divide(joint, p, out=np.broadcast_to(axis, p.shape).copy(), where=p > 0)
    low, share = _between(axis, after)
    high = np.minimum(low + 1, len(axis) - 1)
    around, parts = np.stack([low, high], axis=-1), np.stack([1 - share, share], axis=-1)
    if smooth:
        around, parts = _cubic(axis, after, low, around, parts)
    point = around.transpose(0, 2, 1, 3)  # (E,G,K,2 or 4)
    weight = (p[..., None] * parts).transpose(0, 2, 1, 3)
    shape = (*point.shape[:2], -1)
    return Percepts(
        np.ascontiguousarray(point.reshape(shape)), np.ascontiguousarray(weight.reshape(shape))
    )


def _cubic(
    axis: NDArray[np.float64],
    at: NDArray[np.float64],
    low: NDArray[np.int64],
    around: NDArray[np.int64],
    parts: NDArray[np.float64],
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Interpolate by the cubic through four points in log-odds; linearly next to certainty."""
    last = len(axis) - 1
    around = np.concatenate([around, around], axis=-1)
    parts = np.concatenate([parts, np.zeros_like(parts)], axis=-1)
    inner = (low > 0) & (low < last - 1)
    if last < 5 or not inner.any():  # noqa: PLR2004  four points and certainty on both sides
        return around, parts
    odds = np.log(axis[1:-1]) - np.log1p(-axis[1:-1])
    four = np.clip(low[inner] - 1, 1, last - 4)[:, None] + np.arange(4)
    x, near = np.log(at[inner]) - np.log1p(-at[inner]), odds[four - 1]  # (B,), (B,4)
    weight = np.ones_like(near)
    for i, j in np.argwhere(~np.eye(4, dtype=np.bool_)).tolist():
        weight[:, i] *= (x - near[:, j]) / (near[:, i] - near[:, j])
    around[inner], parts[inner] = four, weight
    return around, parts


def _between(
    axis: NDArray[np.float64], at: NDArray[np.float64]
) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Point below each belief, and how far on the belief lies towards the next."""
    low = np.clip(np.searchsorted(axis, at, side="right") - 1, 0, max(len(axis) - 2, 0))
    width = axis[np.minimum(low + 1, len(axis) - 1)] - axis[low]
    share = np.divide(at - axis[low], width, out=np.zeros_like(at), where=width > 0)
    return low, share.clip(0.0, 1.0)


def refine(table: Table, attribute: int, axis: NDArray[np.float64]) -> Table:
    """Give one attribute another axis, reading values off between the points."""
    axes = list(table.axes)
    low, share = _between(axes[attribute], axis)
    high = np.minimum(low + 1, len(axes[attribute]) - 1)
    left = len(table.value) * int(table.size[:attribute].prod())
    old = table.value.reshape(left, len(axes[attribute]), -1)
    new = old[:, low] * (1 - share)[:, None] + old[:, high] * share[:, None]
    axes[attribute] = axis
    return make_table(axes, table.tells, new.reshape(len(table.value), -1))


def expectation(
    table: Table, percepts: Sequence[Percepts], e: int, value: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Take the expected value (B,) after a percept of a behavior, at every point."""
    left = 1
    for i, size in enumerate(table.size.tolist()):
        if table.tells[i, e]:
            source = value.reshape(left, size, -1)
            value = np.empty_like(source)
            expect(source, percepts[i].point[e], percepts[i].weight[e], value)
        left *= size
    return value.reshape(-1)


def make_room(table: Table, levels: int) -> Room:
    """Make the room that reading a table off needs, for percepts of K levels."""
    near = 2 * levels
    joint = near ** int((table.size > 1).sum())
    return Room(
        np.empty(joint, np.int64), np.empty(joint), np.empty(near, np.int64), np.empty(near)
    )


@entry_kernel
def expect(
    source: NDArray[np.float64],
    point: NDArray[np.int64],
    weight: NDArray[np.float64],
    out: NDArray[np.float64],
) -> None:
    """out[l,g,r] = sum_j weight[g,j] source[l,point[g,j],r]; 2K terms, K even, four at once."""
    left, right = source.shape[0], source.shape[2]
    for begin in range(0, left, 32):  # rows that fit the cache together
        end = min(left, begin + 32)
        for g in range(point.shape[0]):
            for j in range(0, point.shape[1], 4):
                a, b, c, d = point[g, j], point[g, j + 1], point[g, j + 2], point[g, j + 3]
                s, t, u, v = weight[g, j], weight[g, j + 1], weight[g, j + 2], weight[g, j + 3]
                if right == 1:
                    for k in range(begin, end):
                        sum_ = s * source[k, a, 0] + t * source[k, b, 0]
                        sum_ += u * source[k, c, 0] + v * source[k, d, 0]
                        out[k, g, 0] = sum_ if j == 0 else out[k, g, 0] + sum_
                    continue
                for k in range(begin, end):
                    for r in range(right):
                        sum_ = s * source[k, a, r] + t * source[k, b, r]
                        sum_ += u * source[k, c, r] + v * source[k, d, r]
                        out[k, g, r] = sum_ if j == 0 else out[k, g, r] + sum_


@kernel
def _locate(table: Table, i: int, chance: float) -> tuple[int, float]:
    """Point below a belief, and how far on the belief lies towards the next."""
    low, high = 0, table.size[i] - 1
    if high == 0:
        return low, 0.0
    while high - low > 1:
        middle = (low + high) // 2
        if table.chance[i, middle] <= chance:
            low = middle
        else:
            high = middle
    below, above = table.chance[i, low], table.chance[i, high]
    return low, min(max((chance - below) / (above - below), 0.0), 1.0)


@entry_kernel
def value_after(
    table: Table,
    confusion: NDArray[np.float64],
    x: int,
    behavior: int,
    chance: NDArray[np.float64],
    room: Room,
) -> float:
    """Expect the value at x of a belief (N,) after a percept of a behavior, -1 for none.

    The next belief in each attribute is spread over the points beside it, 2K of them or fewer.
    """
    room.cell[0], room.mass[0], count = 0, 1.0, 1
    for i in range(chance.shape[0]):
        told = behavior >= 0 and table.tells[i, behavior]
        around = 0
        for z in range(confusion.shape[3] if told else 1):
            p, after = 1.0, chance[i]
            if told:
                joint = chance[i] * confusion[i, behavior, 1, z]
                p = joint + (1.0 - chance[i]) * confusion[i, behavior, 0, z]
                if p <= 0.0:
                    continue
                after = joint / p
            low, on = _locate(table, i, after)
            room.near[around], room.share[around] = low, p * (1.0 - on)
            around += 1
            if on > 0.0:
                room.near[around], room.share[around] = low + 1, p * on
                around += 1
        for k in range(count - 1, -1, -1):  # from the end, as each makes way for several
            offset, part = room.cell[k] * table.size[i], room.mass[k]
            for j in range(around):
                room.cell[k * around + j] = offset + room.near[j]
                room.mass[k * around + j] = part * room.share[j]
        count *= around
    value = 0.0
    for k in range(count):
        value += room.mass[k] * table.value[x, room.cell[k]]
    return value

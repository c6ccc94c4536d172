"""Tables over a product grid of marginal beliefs: axes, and interpolation between grid points."""

from collections.abc import Iterable, Sequence
from itertools import zip_longest
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, Ints
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.jit import NO_BEHAVIOR, by_reference, entry_kernel, kernel

_EQUAL = 1e-12  # difference of rows below which they are equal up to rounding
_WIDEST = 10.0  # largest distance of an axis from the prior in log-odds, before certainty
_NEAREST = 1.3  # smallest distance that an even axis reaches in log-odds,
_INNER_STEP = 0.15  # plus this distance for each of its points
_PERCEPTS = 1.5  # smallest distance in percepts of the most informative behavior


@by_reference
class Table(NamedTuple):
    """Values of beliefs, multilinear between the points of a product grid."""

    points: Floats  # (N,G) Pr(attribute is true) along each axis, ascending, padded by 1
    size: Ints  # (N,) points of an axis; 1 where no percept moves the belief
    value: NDArray[Any]  # (X-1,B) at all points of the grid; the last attribute's vary fastest

    @property
    def axes(self) -> list[Floats]:
        """Points of each axis, without the padding."""
        return [row[:size] for row, size in zip(self.points, self.size, strict=True)]

    def combined(self, parts: Iterable[Floats], combine: np.ufunc) -> Floats:
        """Combine numbers (..,G) at the points of the axes to numbers at all grid points (..,B)."""
        product, *others = parts
        for of_axis in others:
            pairs = combine(product[..., None], of_axis[..., None, :])
            product = pairs.reshape(*product.shape[:-1], -1)
        return product


@by_reference
class Reader(NamedTuple):
    """A table, with the arrays for expected values after a percept."""

    table: Table
    rows: Floats  # (N,E,2,K) Pr(level | truth)
    moves: NDArray[np.bool_]  # (N,E) do percepts move the belief?
    beside: Floats  # (2,M) buffer: points next to beliefs, and weights; the end is for one axis


def make_table(axes: Sequence[Floats], value: Floats) -> Table:
    """Build a table of values (X-1,B) over the product of axes."""
    size = np.array([len(axis) for axis in axes])
    points = np.array([*zip_longest(*axes, fillvalue=1.0)]).T
    return Table(np.ascontiguousarray(points), size, np.ascontiguousarray(value))


def refine(table: Table, attribute: int, axis: Floats) -> Table:
    """Interpolate the values of a table on another axis of one attribute."""
    axes = table.axes
    low, fraction = between(axes[attribute], axis)
    high = np.minimum(low + 1, len(axes[attribute]) - 1)
    leading = len(table.value) * int(table.size[:attribute].prod())
    old = table.value.reshape(leading, len(axes[attribute]), -1)
    below = old[:, low]
    above = old[:, high]
    # U(new point) = (1 - w) U(below) + w U(above), in place, because tables are large.
    below *= (1 - fraction)[:, None]
    above *= fraction[:, None]
    below += above
    axes[attribute] = axis
    return make_table(axes, below.reshape(len(table.value), -1))


def between(axis: Floats, at: Floats) -> tuple[Ints, Floats]:
    """Return the point below each belief, and the weight of the point above it."""
    last = len(axis) - 1
    low = (axis.searchsorted(at, side="right") - 1).clip(0, max(last - 1, 0))
    below = axis[low]
    width = axis[np.minimum(low + 1, last)] - below
    fraction = np.zeros_like(at)
    np.divide(at - below, width, out=fraction, where=width > 0)
    return low, fraction.clip(0.0, 1.0, out=fraction)


def informative_pairs(momdp: MOMDP) -> NDArray[np.bool_]:
    """Return which behaviors' percepts can move the belief in which attributes, (N,E)."""
    differ = (np.abs(momdp.confusion[:, :, 1] - momdp.confusion[:, :, 0]) > _EQUAL).any(axis=-1)
    comes = (momdp.transition * momdp.observation_probability).any(axis=2).T & momdp.legal  # (X,E)
    unsure = (momdp.prior > 0) & (momdp.prior < 1)
    return np.asarray(differ & comes.any(axis=0) & (momdp.limit > 0) & unsure[:, None])


def make_axis(momdp: MOMDP, attribute: int, level: int) -> Floats:
    """Build the axis of an attribute; each level halves the steps of the last.

    Points are evenly spaced in log-odds around the prior, up to half of the log-odds at which even
    the cheapest percept is not worth its cost, and half as dense beyond. The probabilities 0, 1/2
    (where the best report changes) and 1 are grid points too.
    """
    ratio = (momdp.correct - momdp.incorrect) / max(float(momdp.cost.min()), 1e-9)
    half_width = float(np.clip(np.log(max(ratio, 1.0)), _WIDEST / 2, _WIDEST))
    even = np.linspace(0.0, half_width / 2, 2**level + 1)
    sparse = np.linspace(half_width / 2, half_width, max(2**level // 2, 1) + 1)
    half = np.concatenate([even, sparse[1:]])
    # A percept adds ln Pr(z | true) / Pr(z | false) to the log-odds: even steps fit all of them.
    odds = momdp.prior[attribute] / (1 - momdp.prior[attribute])
    log_odds = np.log(odds) + np.concatenate([-half[:0:-1], half])
    if np.abs(log_odds).min() > 1e-6:  # no point of the axis yet
        log_odds = np.sort(np.append(log_odds, 0.0))
    return np.concatenate([[0.0], 1 / (1 + np.exp(-log_odds)), [1.0]])


def even_axis(momdp: MOMDP, attribute: int, inner: int) -> Floats:
    """Build an axis that is even in log-odds and reaches as far as the most informative percept.

    Beliefs between the last point and certainty are interpolated linearly, which is imprecise.
    """
    false, true = np.clip(np.moveaxis(momdp.confusion[attribute], 1, 0), 1e-300, None)  # (E,K)
    # E |ln Pr(z | true) / Pr(z | false)| at even odds: how far a percept moves the log-odds.
    shift = (0.5 * (false + true) * np.abs(np.log(true / false))).sum(axis=1)  # (E,)
    shift = np.where(informative_pairs(momdp)[attribute], shift, 0.0)
    half_width = float(np.clip(_PERCEPTS * shift.max(), _NEAREST + _INNER_STEP * inner, _WIDEST))
    odds = momdp.prior[attribute] / (1 - momdp.prior[attribute])
    log_odds = np.log(odds) + np.linspace(-half_width, half_width, inner)
    return np.concatenate([[0.0], 1 / (1 + np.exp(-log_odds)), [1.0]])


def make_reader(table: Table, rows: Floats, moves: NDArray[np.bool_]) -> Reader:
    """Make a reader of a table, for percepts of these rows (N,E,2,K); `moves` is (N,E)."""
    along = 2 * rows.shape[3]  # points that one axis has beside the beliefs after a percept
    several = along ** int((table.size > 1).sum())
    return Reader(table, rows, moves, beside=np.empty((2, several + along)))


@kernel
def _locate(table, i, prob):
    """Find the point below a belief, and the weight of the point above it, by bisection."""
    low = 0
    high = table.size[i] - 1
    if high == 0:
        return low, 0.0
    while high - low > 1:
        middle = (low + high) // 2
        if table.points[i, middle] <= prob:
            low = middle
        else:
            high = middle
    below = table.points[i, low]
    above = table.points[i, high]
    return low, min(max((prob - below) / (above - below), 0.0), 1.0)


@kernel
def _points_beside(reader, i, behavior, b):
    """List the points next to the possible beliefs after a percept, weighted by Pr(z).

    Bayes' rule: b' = b Pr(z | true) / Pr(z), Pr(z) = b Pr(z | true) + (1 - b) Pr(z | false). The
    points are written to the end of `beside`; the function returns their number.
    """
    rows = reader.rows
    levels = rows.shape[3]
    last = reader.beside.shape[1] - 2 * levels
    count = 0
    # If no percept moves the belief, there is one certain "percept", and the belief stays.
    moved = behavior >= 0 and reader.table.size[i] > 1 and reader.moves[i, behavior]
    for z in range(levels if moved else 1):
        p = 1.0
        after = b
        if moved:
            # joint = Pr(true, z)
            joint = b * rows[i, behavior, 1, z]
            p = joint + (1.0 - b) * rows[i, behavior, 0, z]
            if p <= 0.0:
                continue
            after = joint / p
        low, fraction = _locate(reader.table, i, after)
        # Linear interpolation between the two points next to b'.
        reader.beside[0, last + count] = low
        reader.beside[1, last + count] = p * (1.0 - fraction)
        count += 1
        if fraction > 0.0:
            reader.beside[0, last + count] = low + 1
            reader.beside[1, last + count] = p * fraction
            count += 1
    return count


@entry_kernel
def value_after(reader, x, behavior, prob):
    """Compute the expected value at x of a belief (N,) after a percept of a behavior (none = -1).

    The next belief about each attribute is interpolated between at most 2K points.
    """
    table = reader.table
    beside = reader.beside
    last = beside.shape[1] - 2 * reader.rows.shape[3]
    # E V(b') = sum over z_1 .. z_N and the corners beside b' of prod_i (Pr(z_i) weight_i) V: the
    # product of the attributes' points, one attribute after the other, in place.
    beside[0, 0] = 0.0
    beside[1, 0] = 1.0
    count = 1
    for i in range(prob.shape[0]):
        along = _points_beside(reader, i, behavior, prob[i])
        for k in range(count - 1, -1, -1):  # from the end, because each is replaced by several
            offset = beside[0, k] * table.size[i]
            weight = beside[1, k]
            for j in range(along):
                beside[0, k * along + j] = offset + beside[0, last + j]
                beside[1, k * along + j] = weight * beside[1, last + j]
        count *= along
    value = 0.0
    for k in range(count):
        value += beside[1, k] * table.value[x, int(beside[0, k])]
    return value


@entry_kernel
def add_values_ahead(model, reader, x, prob, out):
    """Add to `out` (E,) the discounted expected value after each legal behavior from x."""
    dynamics = model.dynamics
    for e in range(out.shape[0]):
        step = dynamics.step[x, e]
        for k in range(dynamics.branch.shape[2]):
            branch = dynamics.branch[x, e, k]
            # Q(x, b, a) = R + g sum_k p_k E V(x_k, b'), of which R is in `out` already
            if step.legal and branch.p > 0.0:
                perceives = branch.senses and model.percepts.limit[e] > 0.0
                behavior = e if perceives else NO_BEHAVIOR
                out[e] += step.discount * branch.p * value_after(reader, branch.x, behavior, prob)

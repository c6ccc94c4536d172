"""Attributes that exclude or imply each other: a joint prior from the labels of training objects.

Of each pair of attributes, the four joint values have a Dirichlet prior around the product of the
base rates. Its strength s, in objects, is the one of largest marginal likelihood; a pair is coupled
where that is `_BAYES_FACTOR` times the likelihood of the product, so that few labels couple
nothing. With counts c of n objects, the association (the odds ratio) of a coupled pair is that of

    (c + s product) / (n + s)

and its margins are the base rates, which more objects may tell. Of a query the prior is the joint
distribution of largest entropy that has these pairs and rates; it is found by iterative
proportional fitting [Deming1940]. Where no pair of it is coupled, there is none, and attributes are
independent.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from meal_bayes.arrays import Floats, FrozenArrays, Ints
from meal_bayes.domain import Domain, Query

MOST_VALUES = 256  # value vectors of a joint prior, those of eight attributes; of more, none
_BAYES_FACTOR = 20.0  # of the strongest Dirichlet over the product, from which a pair is coupled
_STRENGTHS = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0])  # objects' worth of the product
_SWEEPS = 200  # of proportional fitting, at most
_FITTED = 1e-12  # a sweep that changes no probability by more is the last


@dataclass(frozen=True, slots=True)
class CoOccurrence(FrozenArrays):
    """Pairs of attributes that the training objects couple.

    Attributes
    ----------
    pairs : NDArray[np.int64]
        (J,2) their places in the domain, the first below the second.
    probability : NDArray[np.float64]
        (J,4) Pr(neither, the second alone, the first alone, both); margins are the base rates.
    log_bayes_factor : NDArray[np.float64]
        (J,) nats by which the labels prefer the coupled pair to the product.
    """

    pairs: NDArray[np.int64]
    probability: NDArray[np.float64]
    log_bayes_factor: NDArray[np.float64]

    def among(self, columns: Sequence[int]) -> NDArray[np.int64]:
        """Return which pairs lie wholly in some columns, by their numbers."""
        return np.flatnonzero(np.isin(self.pairs, columns).all(axis=1))

    def moved(self, before: "CoOccurrence", attributes: int) -> NDArray[np.bool_]:
        """Return of which attributes (P,) a pair is not what it was."""
        changed = self._rows() ^ before._rows()
        moved = [int(attribute) for row in changed for attribute in row[:2]]
        return np.isin(np.arange(attributes), moved)

    def _rows(self) -> set[tuple[float, ...]]:
        """Return each pair's attributes and probabilities."""
        rows = zip(self.pairs.tolist(), self.probability.tolist(), strict=True)
        return {(*pair, *probability) for pair, probability in rows}


NOTHING = CoOccurrence(np.empty((0, 2), np.int64), np.empty((0, 4)), np.empty(0))


class _Margin(NamedTuple):
    """What a joint distribution must sum to: the cell of each value vector, and cells' sums."""

    cell: Ints  # (Y,)
    sums: Floats  # (cells,)


def learn_co_occurrence(domain: Domain, labels: NDArray[np.int8], rates: Floats) -> CoOccurrence:
    """Learn which pairs of attributes are coupled, from labels (O,P) and base rates (P,).

    Values of one group are left out: they are one variable already.
    """
    first, second = _pairs_apart(domain)
    true = (labels == 1).astype(float)
    false = (labels == 0).astype(float)
    # Objects (M,4) by both labels: neither, the second alone, the first alone, both.
    counts = np.stack(
        [(a.T @ b)[first, second] for a in (false, true) for b in (false, true)], axis=1
    )
    p = rates[first]
    q = rates[second]
    product = np.stack([(1 - p) * (1 - q), (1 - p) * q, p * (1 - q), p * q], axis=1)  # (M,4)
    # Coupled: a Dirichlet about independence, of several strengths; else independence itself.
    evidence = _log_evidence(counts, _STRENGTHS[:, None, None] * product)  # (S,M)
    gain = evidence.max(axis=0) - (counts * np.log(product)).sum(axis=1)
    coupled = np.flatnonzero(gain > np.log(_BAYES_FACTOR))
    if not len(coupled):
        return NOTHING
    strength = _STRENGTHS[evidence[:, coupled].argmax(axis=0), None]
    weights = counts[coupled] + strength * product[coupled]
    return CoOccurrence(
        pairs=np.column_stack([first, second])[coupled],
        probability=_with_margins(weights, p[coupled], q[coupled]),
        log_bayes_factor=gain[coupled],
    )


def joint_prior(
    query: Query,
    rates: Floats,
    co_occurrence: CoOccurrence,
    columns: Sequence[int],
    told: NDArray[np.float64] | None = None,
) -> Floats | None:
    """Compute Pr(values) (Y,) of a query in the order of `Query.values`; None where independent.

    Parameters
    ----------
    query : Query
        The N attributes asked.
    rates : NDArray[np.float64]
        (N,) their base rates.
    co_occurrence : CoOccurrence
        Pairs that are coupled.
    columns : Sequence[int]
        (N,) places of the attributes in the domain.
    told : NDArray[np.float64] | None
        (N,) Pr(attribute is true) of those that a person labeled on this object, NaN of the others,
        which then follow from them.
    """
    coupled = co_occurrence.among(columns)
    if not len(coupled) or query.n_values > MOST_VALUES:
        return None
    values = query.values
    index_of = {column: index for index, column in enumerate(columns)}
    pairs = []
    for number in coupled.tolist():
        first, second = map(index_of.__getitem__, co_occurrence.pairs[number].tolist())
        cell = 2 * values[:, first].astype(np.int64) + values[:, second]
        pairs.append(_Margin(cell, co_occurrence.probability[number]))
    singles = [_single(values, i, float(rate)) for i, rate in enumerate(rates)]
    grouped = np.isin(np.arange(len(query)), [i for group in query.groups for i in group])
    joint = np.where(values, rates, np.where(grouped, 1.0, 1.0 - rates)).prod(axis=1)
    # Pairs whose margins no joint distribution has together are met on average; the rates always.
    joint = _fitted(_fitted(joint / joint.sum(), [*pairs, *singles]), singles)
    if told is not None:
        labeled = np.flatnonzero(~np.isnan(told)).tolist()
        joint = _fitted(joint, [_single(values, i, float(told[i])) for i in labeled])
    return joint


def _pairs_apart(domain: Domain) -> tuple[Ints, Ints]:
    """Return the columns (M,) of all pairs of attributes that are not values of one group."""
    first, second = np.triu_indices(len(domain.attributes), 1)
    variable = np.arange(len(domain.attributes))
    for number, members in enumerate(domain.groups.values(), start=1):
        variable[domain.columns(members)] = -number
    apart = variable[first] != variable[second]
    return first[apart], second[apart]


def _log_evidence(counts: Floats, weights: Floats) -> Floats:
    """Return the log marginal likelihood of labels (...,4), in an order, under a Dirichlet."""
    total = gammaln(weights.sum(axis=-1)) - gammaln((weights + counts).sum(axis=-1))
    return np.asarray(total + (gammaln(weights + counts) - gammaln(weights)).sum(axis=-1))


def _with_margins(weights: Floats, p: Floats, q: Floats) -> Floats:
    """Return the pairs (J,4) that have the odds ratio of weights (J,4), and margins p and q (J,).

    Plackett's distribution [Plackett1965]: with odds ratio r, Pr(both) is the root of
    (r - 1) x^2 - (1 + (r - 1) (p + q)) x + r p q that lies in [0, min(p, q)].
    """
    ratio = weights[:, 0] * weights[:, 3] / (weights[:, 1] * weights[:, 2])
    linear = 1.0 + (ratio - 1.0) * (p + q)
    root = np.sqrt(linear**2 - 4.0 * ratio * (ratio - 1.0) * p * q)
    # Two forms of one root; each is free of cancellation where it is taken.
    low = linear < 0.0  # only with a ratio below 1
    p_both = np.where(
        low,
        (linear - root) / np.where(low, 2.0 * (ratio - 1.0), 1.0),
        2.0 * ratio * p * q / np.where(low, 1.0, linear + root),
    )
    return np.stack([1.0 - p - q + p_both, q - p_both, p - p_both, p_both], axis=1)


def _single(values: NDArray[np.bool_], i: int, rate: float) -> _Margin:
    return _Margin(values[:, i].astype(np.int64), np.array([1.0 - rate, rate]))


def _fitted(joint: Floats, margins: Iterable[_Margin]) -> Floats:
    """Fit a joint distribution (Y,) to margins, one after the other until nothing changes."""
    margins = list(margins)
    for _ in range(_SWEEPS):
        last_joint = joint
        # Iterative proportional fitting: each margin in turn is scaled to its sums.
        for cell, sums in margins:
            joint = joint * (sums / np.bincount(cell, joint, len(sums)))[cell]
        if np.abs(joint - last_joint).max() < _FITTED:
            break
    return joint

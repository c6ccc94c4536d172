"""Attributes that exclude or imply each other: a joint prior from the labels of training objects.

The four joint values of each pair of attributes have a Dirichlet prior around the product of the
base rates. Its strength s, in objects, maximizes the marginal likelihood of the labels. A pair is
coupled if this likelihood is at least `_BAYES_FACTOR` times that of independence, so that a few
labels couple no pair. With counts c of n objects, a coupled pair has the odds ratio of

    (c + s product) / (n + s)

and the base rates as margins, because the base rates may be known from more objects. The prior of a
query is the joint distribution of largest entropy that has these odds ratios and base rates. It is
found by iterative proportional fitting [Deming1940]. If no pair in the query is coupled, there is
no joint prior, and the attributes are independent.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import gammaln

from meal_bayes.arrays import Floats, Ints
from meal_bayes.domain import Domain, Query

MOST_VALUES = 256  # largest number of value vectors of a joint prior, that of eight attributes
_BAYES_FACTOR = 20.0  # smallest likelihood ratio of a coupled pair against independence
_STRENGTHS = np.array([1.0, 2.0, 4.0, 8.0, 16.0, 32.0, 64.0])  # candidates for s, in objects
_SWEEPS = 200  # largest number of sweeps of proportional fitting
_FITTED = 1e-12  # change of a probability in a sweep below which fitting ends


class Coupled(NamedTuple):
    """The J pairs of attributes that labels couple, in the order of the domain."""

    pairs: Ints  # (J,2) places in the domain, the first below the second
    probability: Floats  # (J,4) Pr(neither, the second alone, the first alone, both)
    log_bayes_factor: Floats  # (J,) nats by which the labels prefer the pair to the product


def joint_prior(
    domain: Domain,
    labels: NDArray[np.int8],
    base_rates: Floats,
    query: Query,
    told: Floats | None = None,
    of_labels: Floats | None = None,
) -> Floats | None:
    """Compute the joint prior Pr(values) (Y,) of a query, in the order of `Query.values`.

    The result is None if the attributes are independent.

    Parameters
    ----------
    domain : Domain
        Domain with P attributes and their groups.
    labels : NDArray[np.int8]
        (O,P) labels of the training objects; -1 unknown.
    base_rates : NDArray[np.float64]
        (P,) prior probability that an attribute of a new object is true.
    query : Query
        The N queried attributes.
    told : NDArray[np.float64] | None
        (N,) Pr(attribute is true) for attributes that a person labeled on this object, and NaN for
        the others, whose probabilities then follow from the joint prior.
    of_labels : NDArray[np.float64] | None
        (P,) Pr(a label says yes), if labels may be wrong; by default the base rates.
    """
    if query.n_values > MOST_VALUES:
        return None
    columns = domain.columns(query.attributes)
    coupled = coupled_pairs(domain, labels, base_rates, sorted(columns), of_labels)
    if not len(coupled.pairs):
        return None
    values = query.values.astype(np.int64)
    index_of = {column: index for index, column in enumerate(columns)}
    margins = []  # for each pair, the cell (Y,) of every value vector, and the sums of the cells
    for pair, probability in zip(coupled.pairs.tolist(), coupled.probability, strict=True):
        first, second = map(index_of.__getitem__, pair)
        margins.append((2 * values[:, first] + values[:, second], probability))
    rates = base_rates[columns]
    singles = [(values[:, i], np.array([1 - rate, rate])) for i, rate in enumerate(rates.tolist())]
    grouped = np.isin(np.arange(len(query)), [i for group in query.groups for i in group])
    joint = np.where(values, rates, np.where(grouped, 1.0, 1.0 - rates)).prod(axis=1)
    # If no joint distribution has all these pairs, they are fitted on average; rates always fit.
    joint = _fitted(_fitted(joint / joint.sum(), [*margins, *singles]), singles)
    if told is None:
        return joint
    known = np.flatnonzero(~np.isnan(told)).tolist()
    return _fitted(joint, [(values[:, i], np.array([1 - told[i], told[i]])) for i in known])


def coupled_pairs(
    domain: Domain,
    labels: NDArray[np.int8],
    base_rates: Floats,
    columns: list[int] | None = None,
    of_labels: Floats | None = None,
) -> Coupled:
    """Return the pairs that labels (O,P) couple, among all attributes or among some.

    Pairs within a group are left out, because a group is one variable. `columns` are positions of
    attributes in increasing order. If labels may be wrong, `of_labels` (P,) is the probability that
    a label says yes; the odds ratio of a pair is that of its labels.
    """
    places = np.arange(len(domain.attributes)) if columns is None else np.array(columns)
    variable = np.arange(len(domain.attributes))
    for number, members in enumerate(domain.groups.values(), start=1):
        variable[domain.columns(members)] = -number
    first, second = np.triu_indices(len(places), 1)
    apart = variable[places[first]] != variable[places[second]]
    first, second = first[apart], second[apart]
    sides = [(labels[:, places] == value).astype(float) for value in (0, 1)]
    # Objects (M,4) by both labels: neither, the second alone, the first alone, both.
    counts = np.stack([(a.T @ b)[first, second] for a in sides for b in sides], axis=1)
    rates = base_rates if of_labels is None else of_labels
    p, q = rates[places[first]], rates[places[second]]
    product = np.stack([(1 - p) * (1 - q), (1 - p) * q, p * (1 - q), p * q], axis=1)  # (M,4)
    # Compare Dirichlet priors of several strengths around independence with independence itself.
    evidence = _log_evidence(counts, _STRENGTHS[:, None, None] * product)  # (S,M)
    gain = evidence.max(axis=0) - (counts * np.log(product)).sum(axis=1)
    found = np.flatnonzero(gain > np.log(_BAYES_FACTOR))
    strength = _STRENGTHS[evidence[:, found].argmax(axis=0), None]
    weights = counts[found] + strength * product[found]
    pairs = np.column_stack([places[first], places[second]])[found]
    margins = base_rates[pairs].T
    return Coupled(pairs, _with_margins(weights, *margins), gain[found])


def _log_evidence(counts: Floats, weights: Floats) -> Floats:
    """Return the log marginal likelihood of ordered labels with counts (...,4), for a Dirichlet."""
    total = gammaln(weights.sum(axis=-1)) - gammaln((weights + counts).sum(axis=-1))
    return np.asarray(total + (gammaln(weights + counts) - gammaln(weights)).sum(axis=-1))


def _with_margins(weights: Floats, p: Floats, q: Floats) -> Floats:
    """Return joint probabilities (J,4) with the odds ratios of weights (J,4), and margins p and q.

    Plackett's distribution [Plackett1965]: with odds ratio r, Pr(both) is the root of
    (r - 1) x^2 - (1 + (r - 1) (p + q)) x + r p q that lies in [0, min(p, q)].
    """
    ratio = weights[:, 0] * weights[:, 3] / (weights[:, 1] * weights[:, 2])
    linear = 1.0 + (ratio - 1.0) * (p + q)
    root = np.sqrt(linear**2 - 4.0 * ratio * (ratio - 1.0) * p * q)
    # Two forms of the same root; each is used where it has no cancellation.
    low = linear < 0.0  # only with a ratio below 1
    p_both = np.where(
        low,
        (linear - root) / np.where(low, 2.0 * (ratio - 1.0), 1.0),
        2.0 * ratio * p * q / np.where(low, 1.0, linear + root),
    )
    return np.stack([1.0 - p - q + p_both, q - p_both, p - p_both, p_both], axis=1)


def _fitted(joint: Floats, margins: list[tuple[Ints, Floats]]) -> Floats:
    """Fit a joint distribution (Y,) to margins by iterative proportional fitting."""
    for _ in range(_SWEEPS):
        last_joint = joint
        # Iterative proportional fitting: each margin in turn is scaled to its sums.
        for cell, sums in margins:
            joint = joint * (sums / np.bincount(cell, joint, len(sums)))[cell]
        if np.abs(joint - last_joint).max() < _FITTED:
            break
    return joint

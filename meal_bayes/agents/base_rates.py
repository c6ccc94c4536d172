"""Base rates: how often each attribute is true, pooled over the attributes that a robot knows.

A robot that was told little of an attribute was told something of others: how often they are true,
and how far they differ. The hierarchy is

    mu ~ Beta(1, 2);  n0 in {1, 2, 4, ..., 64}, each as likely
    r_p | mu, n0 ~ Beta(n0 mu, n0 (1 - mu));  k_p of n_p labeled objects are true

and is exact on a grid of 49 values of mu and 7 of n0: r_p integrates out, so that a point weighs

    w(mu, n0) ~ Beta(mu; 1, 2) prod_p B(n0 mu + k_p, n0 (1 - mu) + n_p - k_p)
                                      / B(n0 mu, n0 (1 - mu)).

Given the weights, the posterior of a rate is a mixture of Betas, of mean

    sum w (k_p + n0 mu) / (n_p + n0).

With nothing told that is 1/3. Rates that differ much make n0 small, so that little is pooled. The
weights are constants between refits, as the objects' dispersions are; else a label of one attribute
would move all rates, and every plan would be made anew.

The values of a group exclude each other, so they are not pooled with the rest: they keep a
symmetric Dirichlet prior.

If labels are known to be right with a probability a below 1, a label counts as true in part, by

    Pr(true | yes) = a r / (a r + (1 - a) (1 - r))
    Pr(true | no) = (1 - a) r / ((1 - a) r + a (1 - r))

at the rates r at which all counts agree (expectation maximization). Labels of groups count in full.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaln, expit

from meal_bayes.arrays import Floats, FrozenArrays
from meal_bayes.domain import Domain
from meal_bayes.domain.domain import PRIOR_OBJECTS

_MEANS, _STRENGTHS = (
    points.ravel() for points in np.meshgrid(np.linspace(0.01, 0.99, 49), 2.0 ** np.arange(7))
)
_TRUE = _STRENGTHS * _MEANS  # Beta parameters of a rate at each of the Q points of the grid
_FALSE = _STRENGTHS * (1.0 - _MEANS)
_LOG_NORM = betaln(_TRUE, _FALSE)

_STEP = 0.5  # between log-odds of the rates that stand for the whole posterior
_LOG_ODDS = np.arange(-7.0, 7.0 + _STEP / 2, _STEP)
RATES: Floats = expit(_LOG_ODDS)  # (R,), see `BaseRates.probabilities`

_ROUNDS = 100  # of expectation maximization
_SAME = 1e-12  # rates that move by less stay
_SAME_COUNT = 1e-6  # objects; counts that move by less stay


@dataclass(frozen=True, slots=True)
class BaseRates(FrozenArrays):
    """Posterior of the rates at which P attributes are true.

    Attributes
    ----------
    true : NDArray[np.float64]
        (P,) labeled objects of which the attribute is true. An object whose value of a group is
        known in part counts in part for each value that is left, and so does a label that may be
        wrong.
    labeled : NDArray[np.float64]
        (P,) labeled objects.
    values : NDArray[np.int64]
        (P,) number of values of the attribute's group; 0 of an attribute that is in none.
    weights : NDArray[np.float64]
        (Q,) probabilities of the points (mu, n0) of the grid.
    label_accuracy : float
        Pr(a label is right).

    Examples
    --------
    >>> from meal_bayes import load_domain
    >>> domain = load_domain("toy")
    >>> learn_base_rates(domain, np.full((1, 2), -1)).mean.round(3).tolist()
    [0.333, 0.333]
    >>> learn_base_rates(domain, [[1, -1], [1, -1], [1, -1]]).mean.round(2).tolist()
    [0.78, 0.61]
    """

    true: NDArray[np.float64]
    labeled: NDArray[np.float64]
    values: NDArray[np.int64]
    weights: NDArray[np.float64]
    label_accuracy: float = 1.0

    @property
    def mean(self) -> Floats:
        """Pr(attribute) of a new object, (P,)."""
        pooled = (self.true[:, None] + _TRUE) / (self.labeled[:, None] + _STRENGTHS) @ self.weights
        values = np.maximum(self.values, 1)
        of_group = (self.true + PRIOR_OBJECTS) / (self.labeled + values * PRIOR_OBJECTS)
        return np.asarray(np.where(self.values > 0, of_group, pooled))

    @property
    def of_labels(self) -> Floats:
        """Pr(a label of a new object says yes), (P,); the mean, where labels are never wrong."""
        wrong = np.where(self.values > 0, 0.0, 1.0 - self.label_accuracy)
        return np.asarray(self.mean * (1.0 - wrong) + (1.0 - self.mean) * wrong)

    @property
    def probabilities(self) -> Floats:
        """Probabilities (P,R) that each attribute's rate is about each of `RATES`."""
        # Beta parameters (P,Q) of the mixture; the value of a group has one Beta, in each part.
        in_group = self.values[:, None] > 0
        true = self.true[:, None] + np.where(in_group, PRIOR_OBJECTS, _TRUE)
        others = np.where(in_group, (self.values[:, None] - 1) * PRIOR_OBJECTS, _FALSE)
        false = (self.labeled - self.true)[:, None] + others
        log_norm = betaln(true, false)
        # The density of log-odds is r^a (1 - r)^b / B(a, b); beyond the ends it is a power of r, or
        # of 1 - r, whose integral is known.
        log_true = np.log(RATES)
        log_false = np.log1p(-RATES)
        total = np.empty((len(self.true), len(RATES)))
        for p in range(len(total)):  # one attribute at a time, as P x Q x R is large
            a = true[p, :, None]
            b = false[p, :, None]
            mass = _STEP * np.exp(a * log_true + b * log_false - log_norm[p, :, None])
            end = np.log(expit(_LOG_ODDS[0] - _STEP / 2))
            mass[:, 0] += np.exp(true[p] * end - log_norm[p]) / true[p]
            mass[:, -1] += np.exp(false[p] * end - log_norm[p]) / false[p]
            mass /= mass.sum(axis=1, keepdims=True)
            total[p] = self.weights @ mass
        return total


def learn_base_rates(
    domain: Domain,
    labels: ArrayLike,
    weights: Floats | None = None,
    label_accuracy: float = 1.0,
) -> BaseRates:
    """Learn the rates of a domain's attributes from labels.

    Parameters
    ----------
    domain : Domain
        Of the attributes and their groups.
    labels : ArrayLike
        (O,P) of objects: 1 true, 0 false, -1 unknown.
    weights : Floats, optional
        (Q,) probabilities of the grid's points, where these were learned before; by default they
        are learned from the same labels.
    label_accuracy : float
        Pr(a label is right), above one half.
    """
    known = np.asarray(labels)
    labeled = (known >= 0).sum(axis=0).astype(float)
    true = (known == 1).sum(axis=0).astype(float)
    values = np.zeros(len(labeled), np.int64)
    for members in domain.groups.values():
        columns = domain.columns(members)
        true[columns], labeled[columns] = _shared_out(known[:, columns])
        values[columns] = len(columns)
    alone = values == 0
    said = true
    for _ in range(_ROUNDS):
        pooled = _grid_weights(true[alone], labeled[alone]) if weights is None else weights
        rates = BaseRates(true, labeled, values, pooled, label_accuracy)
        if label_accuracy == 1.0:
            break
        # Of the labels that say yes, and no, the part whose attribute is true.
        mean = rates.mean
        right, wrong = label_accuracy * mean, (1.0 - label_accuracy) * mean
        of_labels = rates.of_labels
        counts = said * right / of_labels + (labeled - said) * wrong / (1.0 - of_labels)
        counts = np.where(alone, counts, true)
        if np.allclose(counts, true, rtol=0.0, atol=_SAME_COUNT):
            break
        true = counts
    return rates


def _grid_weights(true: Floats, labeled: Floats) -> Floats:
    """Compute Pr(mu, n0 | labels), (Q,), from the numbers (P,) of true and of labeled objects."""
    # Attributes of equal counts have equal factors.
    counts, times = np.unique(np.stack([true, labeled], axis=1), axis=0, return_counts=True)
    k = counts[:, :1]
    n = counts[:, 1:]
    log_weight = np.log1p(-_MEANS)  # Beta(1, 2)
    log_weight = log_weight + times @ (betaln(_TRUE + k, _FALSE + n - k) - _LOG_NORM)
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


def _shared_out(labels: NDArray[np.integer]) -> tuple[Floats, float]:
    """Count the objects of each value of a group (K,), and in all, from labels (O,K).

    An object of which only some values are ruled out counts for the others by their rates, which
    are those at which all counts agree (expectation maximization; one step where values are known).
    """
    n_values = labels.shape[1]
    possible = np.where((labels == 1).any(axis=1, keepdims=True), labels == 1, labels != 0)
    possible = possible[possible.any(axis=1) & ~possible.all(axis=1)]  # else nothing is known
    rates = np.full(n_values, 1.0 / n_values)
    for _ in range(_ROUNDS):
        shared = possible * rates
        counts = (shared / shared.sum(axis=1, keepdims=True)).sum(axis=0)
        updated = (counts + PRIOR_OBJECTS) / (len(possible) + n_values * PRIOR_OBJECTS)
        if np.allclose(updated, rates, rtol=0.0, atol=_SAME):
            break
        rates = updated
    return counts, float(len(possible))

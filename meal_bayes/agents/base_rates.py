"""Base rates: how often each attribute is true, pooled over the attributes of a domain.

If an attribute has few labels, the labels of the other attributes show how often attributes are
true, and how much their rates differ. The hierarchical model is

    mu ~ Beta(1, 2);  n0 in {1, 2, 4, ..., 64}, equally probable
    r_p | mu, n0 ~ Beta(n0 mu, n0 (1 - mu));  k_p of n_p labeled objects are true

It is represented by a grid of 49 values of mu and 7 of n0. The rates r_p are integrated out in
closed form, so a point of the grid has the weight

    w(mu, n0) ~ Beta(mu; 1, 2) prod_p B(n0 mu + k_p, n0 (1 - mu) + n_p - k_p)
                                      / B(n0 mu, n0 (1 - mu)).

Given the weights, the posterior of a rate is a mixture of Betas, of mean

    sum w (k_p + n0 mu) / (n_p + n0).

Without labels, the mean is 1/3. If rates differ much, n0 is small and there is little pooling. The
weights are constant between refits, like the objects' dispersions. Otherwise a label of one
attribute would change all rates, and every plan would have to be computed again.

The values of a group exclude each other, so they are not pooled with other attributes: they have a
symmetric Dirichlet prior.

If labels are right with a known probability a below 1, a label counts as true with the probability

    Pr(true | yes) = a r / (a r + (1 - a) (1 - r))
    Pr(true | no) = (1 - a) r / ((1 - a) r + a (1 - r))

at rates r that agree with these counts (expectation maximization). Labels of groups have full
weight.
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

_STEP = 0.5  # step between the log-odds of the rates that represent the posterior
_LOG_ODDS = np.arange(-7.0, 7.0 + _STEP / 2, _STEP)
RATES: Floats = expit(_LOG_ODDS)  # (R,), see `BaseRates.probabilities`

_ROUNDS = 100  # of expectation maximization
_SAME = 1e-12  # change of rates below which the iteration ends
_SAME_COUNT = 1e-6  # change of counts below which the iteration ends


@dataclass(frozen=True, slots=True)
class BaseRates(FrozenArrays):
    """Posterior of the rates at which P attributes are true.

    Attributes
    ----------
    true : NDArray[np.float64]
        (P,) number of labeled objects for which the attribute is true. It is a fraction for labels
        that may be wrong, and for an object whose labels leave several values of a group possible.
    labeled : NDArray[np.float64]
        (P,) number of labeled objects.
    values : NDArray[np.int64]
        (P,) number of values of the attribute's group; 0 if the attribute is in no group.
    weights : NDArray[np.float64]
        (Q,) probabilities of the points (mu, n0) of the grid.
    label_accuracy : float
        Probability that a label is right.

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
        """Posterior mean of the base rates: the prior probability for a new object, (P,)."""
        pooled = (self.true[:, None] + _TRUE) / (self.labeled[:, None] + _STRENGTHS) @ self.weights
        values = np.maximum(self.values, 1)
        of_group = (self.true + PRIOR_OBJECTS) / (self.labeled + values * PRIOR_OBJECTS)
        return np.asarray(np.where(self.values > 0, of_group, pooled))

    @property
    def of_labels(self) -> Floats:
        """Pr(a label of a new object says yes), (P,); the mean if labels are always right."""
        wrong = np.where(self.values > 0, 0.0, 1.0 - self.label_accuracy)
        return np.asarray(self.mean * (1.0 - wrong) + (1.0 - self.mean) * wrong)

    @property
    def probabilities(self) -> Floats:
        """Posterior of the rates, as probabilities (P,R) of the points `RATES`."""
        # Beta parameters (P,Q) of the mixture; for a value of a group, all parts are equal.
        in_group = self.values[:, None] > 0
        true = self.true[:, None] + np.where(in_group, PRIOR_OBJECTS, _TRUE)
        others = np.where(in_group, (self.values[:, None] - 1) * PRIOR_OBJECTS, _FALSE)
        false = (self.labeled - self.true)[:, None] + others
        log_norm = betaln(true, false)
        # The density of the log-odds is r^a (1 - r)^b / B(a, b); beyond the ends, it is nearly a
        # power of r or of 1 - r, whose integral is known.
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
        Domain with the P attributes and their groups.
    labels : ArrayLike
        (O,P) labels of objects: 1 true, 0 false, -1 unknown.
    weights : Floats, optional
        (Q,) probabilities of the grid's points that were learned before. By default, they are
        learned from the same labels.
    label_accuracy : float
        Probability that a label is right, above one half.
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
        # Expected number of objects with a true attribute, from the labels that say yes and no.
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
    # Attributes with equal counts have equal factors, which are computed once.
    counts, times = np.unique(np.stack([true, labeled], axis=1), axis=0, return_counts=True)
    k = counts[:, :1]
    n = counts[:, 1:]
    log_weight = np.log1p(-_MEANS)  # Beta(1, 2)
    log_weight = log_weight + times @ (betaln(_TRUE + k, _FALSE + n - k) - _LOG_NORM)
    weight = np.exp(log_weight - log_weight.max())
    return np.asarray(weight / weight.sum())


def _shared_out(labels: NDArray[np.integer]) -> tuple[Floats, float]:
    """Count the objects with each value of a group (K,), and all objects, from labels (O,K).

    If the labels of an object exclude only some values, the object counts for the other values in
    proportion to their rates, which are found by expectation maximization (in one step if all
    values are known).
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

"""A latent class that all percepts of an object share: what `calibration.py` compares ours with.

Behaviors of one object are not independent given the truth: an object that looks and sounds empty
to one classifier does so to the next. Each object has, per attribute, one value it *seems* to have,
the truth but for a share epsilon of objects; every percept depends on that value alone. So no
number of percepts makes the belief surer than 1 - epsilon, and the decision problem is as small as
before. Epsilon is learned from the training objects: the maximum of

    sum over objects and attributes of  ln Pr(truth | all their percepts),

by the posterior's own Dirichlet-multinomial rows, under a Beta(1, 1 / TYPICAL) prior on epsilon.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import minimize_scalar

from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.pointwise import log_likelihood

TYPICAL = 0.05  # prior scale of epsilon
_BOUNDS = (-9.0, -0.1)  # of logit(epsilon)


def misperception(
    posterior: ConfusionPosterior,
    levels: ArrayLike,
    labels: ArrayLike,
    base_rates: ArrayLike,
) -> float:
    """Learn epsilon, the share of (object, attribute) pairs that seem to be what they are not.

    Parameters
    ----------
    posterior : learned from the same objects.
    levels : (O,P,E,K) how often each object showed each level.
    labels : (O,P) 1 true, 0 false, -1 unknown (left out); objects without percepts tell nothing.
    base_rates : (P,) prior that an attribute is true.
    """
    counts, truth = np.asarray(levels, dtype=float), np.asarray(labels)
    confusion, precision = posterior.select(range(truth.shape[1]))
    ratio = log_likelihood(counts, confusion[:, :, 1], precision[:, :, 1])
    ratio -= log_likelihood(counts, confusion[:, :, 0], precision[:, :, 0])
    evidence = ratio.sum(axis=-1)  # (O,P)
    rates = np.asarray(base_rates)
    prior = np.log(rates) - np.log1p(-rates)
    use = (truth >= 0) & (counts.sum(axis=(-1, -2)) > 0)
    sign = np.where(truth == 1, 1.0, -1.0)[use]
    odds, before = evidence[use], np.broadcast_to(prior, truth.shape)[use]

    def loss(logit: float) -> float:
        right, wrong = -np.logaddexp(0, logit), -np.logaddexp(0, -logit)
        softened = np.logaddexp(odds + right, wrong) - np.logaddexp(odds + wrong, right)
        nll = np.logaddexp(0, -sign * (before + softened)).sum()
        return float(nll - (1 / TYPICAL - 1) * right)

    if not use.any():
        return TYPICAL
    best = minimize_scalar(loss, bounds=_BOUNDS, method="bounded").x
    return float(1 / (1 + np.exp(-best)))

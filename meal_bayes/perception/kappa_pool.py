"""The paper's pool of machines (Sect. 4.2): sigmoids on their decisions, weighted by Cohen's kappa.

A machine's decision becomes a probability by a sigmoid; its weight is the kappa of these
probabilities, negative ones 0; the output is the weighted mean, or 1/2 where all weights are 0.
Percepts include the base rate; they are no likelihood ratios.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import expit, logit

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.datasets.levels import THRESHOLD
from meal_bayes.perception.compiled_stacking import fit_stacker

_SOFT = 1e-4  # ridge of the sigmoid's slope, for decisions that separate the classes


class KappaPool(NamedTuple):
    """Sigmoids (M,P,2), offset and slope on decisions, and their weights (M,P), Cohen's kappa."""

    sigmoid: Floats
    weights: Floats

    @classmethod
    def fitted(cls, decisions: Floats, truth: Bools, objects: Ints) -> "KappaPool":
        """Fit sigmoids and weights to out-of-fold decisions (r,M,P)."""
        sigmoid = np.zeros((*decisions.shape[1:], 2))
        weights = np.zeros(decisions.shape[1:])
        for m, p in np.ndindex(weights.shape):
            labels = truth[:, p]
            if labels.any() and not labels.all():
                offset, slope = sigmoid[m, p] = fit_sigmoid(decisions[:, m, p], labels)
                yes = offset + slope * decisions[:, m, p] > THRESHOLD
                # Cohen's kappa: agreement beyond chance, of what chance leaves.
                agree = (yes == labels).mean()
                p_yes = yes.mean()
                p_true = labels.mean()
                chance = p_yes * p_true + (1 - p_yes) * (1 - p_true)
                weights[m, p] = max((agree - chance) / (1 - chance), 0.0)
        return cls(sigmoid, weights)

    def log_odds(self, decisions: Floats) -> Floats:
        """Return log-odds of the pooled probability, (B,P), from decisions (B,M,P).

        Modalities whose decisions are NaN have no weight.
        """
        weights = np.where(np.isnan(decisions), 0.0, self.weights)
        decided = np.nan_to_num(decisions)
        probability = expit(self.sigmoid[..., 0] + self.sigmoid[..., 1] * decided)
        total = weights.sum(axis=1)
        pooled = np.einsum("bmp,bmp->bp", probability, weights)
        pooled = np.where(total > 0, pooled / np.where(total > 0, total, 1.0), 0.5)
        return np.asarray(logit(np.clip(pooled, 1e-9, 1 - 1e-9)))


def fit_sigmoid(decisions: Floats, truth: Bools) -> Floats:
    """Fit offset and slope of Pr(true | decision), with Platt's softened targets [Platt1999]."""
    positive = int(truth.sum())
    number = len(truth)
    soft = np.where(truth, (positive + 1) / (positive + 2), 1 / (number - positive + 2))
    theta = np.zeros(2)
    features = np.concatenate([decisions, decisions])[None]
    target = np.repeat([1.0, -1.0], number)
    # Each decision counts twice: as true with the weight t, as false with 1 - t.
    weight = np.concatenate([soft, 1 - soft])
    fit_stacker(features, target, weight, ridge=_SOFT, nonnegative=False, theta=theta)
    return theta

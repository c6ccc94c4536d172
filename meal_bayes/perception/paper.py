"""The paper's method: a support vector machine a modality, calibrated, pooled by Cohen's kappa.

Each modality's decision becomes a probability by a sigmoid fitted on out-of-fold decisions; its
weight is the Cohen's kappa of these probabilities, negative ones 0; the output is the weighted
mean, or 1/2 where all weights are 0. Decisions, sigmoids and weights are out of fold (see `folds`).
Percepts include the base rate; they are no likelihood ratios.
"""

import os
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit
from sklearn.svm import SVC

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets.percepts import THRESHOLD
from meal_bayes.display import short_repr
from meal_bayes.perception.ensemble import KernelFit
from meal_bayes.perception.folds import FoldProblem, folds_of, nested_outputs, table_outputs
from meal_bayes.perception.leave_out import known_patterns
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacking import fit_stacker

Floats = NDArray[np.float64]

_LOOSE = 1e-2  # decisions are calibrated, and a tighter fit takes up to forty times longer
_SOFT = 1e-4  # ridge of the sigmoid's slope, for decisions that separate the classes


@dataclass(frozen=True, slots=True)
class KappaPool:
    """Sigmoid a modality, and their mean weighted by Cohen's kappa.

    Attributes
    ----------
    sigmoid : (M,P,2) offset and slope on the decision.
    weights : (M,P) kappa, 0 where it is negative.
    """

    sigmoid: Floats
    weights: Floats

    __repr__ = short_repr

    def __post_init__(self) -> None:
        set_frozen(self, sigmoid=freeze(self.sigmoid), weights=freeze(self.weights))

    def log_odds(self, decisions: Floats) -> Floats:
        """Return log-odds of the pooled probability, (B,P), from decisions (B,M,P)."""
        probability = expit(self.sigmoid[..., 0] + self.sigmoid[..., 1] * decisions)
        total = self.weights.sum(axis=0)
        pooled = np.einsum("bmp,mp->bp", probability, self.weights)
        pooled = np.where(total > 0, pooled / np.where(total > 0, total, 1.0), 0.5)
        return np.asarray(logit(np.clip(pooled, 1e-9, 1 - 1e-9)))


@dataclass(frozen=True, slots=True)
class _Machines:
    """Support vector machines of some rows, M modalities and P attributes.

    Attributes
    ----------
    grams : (M,n,n).
    dual : (M,P,n).
    bias : (M,P).
    """

    grams: Floats
    dual: Floats
    bias: Floats

    def __call__(self, rows: NDArray[np.bool_]) -> Floats:
        """Decide on these rows, (B,M,P)."""
        return np.asarray(np.einsum("mbn,mpn->bmp", self.grams[:, rows], self.dual) + self.bias)


def _train(
    grams: Floats, truth: NDArray[np.bool_], rows: NDArray[np.bool_], box: float
) -> _Machines:
    """Train on these rows; zero where a class is missing."""
    dual = np.zeros((len(grams), truth.shape[1], len(truth)))
    bias = np.zeros(dual.shape[:2])
    chosen = np.flatnonzero(rows)
    for m in range(len(grams)):
        gram = grams[m][np.ix_(chosen, chosen)]
        for p in range(truth.shape[1]):
            own = truth[chosen, p]
            if own.all() or not own.any():
                continue
            machine = SVC(C=box, kernel="precomputed", tol=_LOOSE).fit(gram, own)
            dual[m, p, chosen[machine.support_]] = machine.dual_coef_[0]
            bias[m, p] = machine.intercept_[0]
    return _Machines(grams, dual, bias)


def _problem(recordings: BehaviorRecordings, settings: PerceptionSettings) -> FoldProblem:
    """Build the fold problem of recordings of which all labels are known, or none."""
    grams, truth = recordings.kernels(), recordings.labels == 1
    folds, units = folds_of(recordings, settings.folds)
    return FoldProblem(
        truth=truth,
        objects=recordings.objects,
        folds=folds,
        units=units,
        machines=len(grams),
        train=lambda rows: _train(grams, truth, rows, settings.box),
        fit_pool=_fit_pool,
        threads=os.cpu_count() or 1,  # support vector machines train without the interpreter's lock
    )


def _fit_pool(decisions: Floats, truth: NDArray[np.bool_], objects: NDArray[np.int64]) -> KappaPool:
    """Fit sigmoids and weights to out-of-fold decisions (r,M,P)."""
    _, n_modalities, n_attributes = decisions.shape
    sigmoid = np.zeros((n_modalities, n_attributes, 2))
    weights = np.zeros((n_modalities, n_attributes))
    for p in range(n_attributes):
        if not len(truth) or truth[:, p].all() or not truth[:, p].any():
            continue
        for m in range(n_modalities):
            sigmoid[m, p] = fit_sigmoid(decisions[:, m, p], truth[:, p])
            log_odds = sigmoid[m, p, 0] + sigmoid[m, p, 1] * decisions[:, m, p]
            weights[m, p] = max(_kappa(log_odds > THRESHOLD, truth[:, p]), 0.0)
    return KappaPool(sigmoid, weights)


def fit_sigmoid(decisions: Floats, truth: NDArray[np.bool_]) -> Floats:
    """Fit offset and slope of Pr(true | decision), with Platt's softened targets [Platt1999]."""
    positive, number = int(truth.sum()), len(truth)
    soft = np.where(truth, (positive + 1) / (positive + 2), 1 / (number - positive + 2))
    theta = np.zeros(2)
    features = np.concatenate([decisions, decisions])[None]
    target = np.repeat([1.0, -1.0], number)
    fit_stacker(features, target, np.concatenate([soft, 1 - soft]), _SOFT, False, theta)
    return theta


def _kappa(yes: NDArray[np.bool_], truth: NDArray[np.bool_]) -> float:
    agree = float((yes == truth).mean())
    chance = float(yes.mean() * truth.mean() + (1 - yes.mean()) * (1 - truth.mean()))
    return (agree - chance) / (1 - chance) if chance < 1 else 0.0


def fit_paper(recordings: BehaviorRecordings, settings: PerceptionSettings) -> KernelFit:
    """Fit one behavior; as `fit_stacked`, nested outputs by folds."""
    n_modalities, (n, n_attributes) = len(recordings.spaces), recordings.labels.shape
    dual, bias = np.zeros((n_modalities, n_attributes, n)), np.zeros((n_modalities, n_attributes))
    sigmoid, weights = np.zeros((n_modalities, n_attributes, 2)), np.zeros_like(bias)
    nested = np.full((n, n_attributes), np.nan)
    for _, attributes in known_patterns(recordings.labels >= 0):
        problem = _problem(recordings.of(attributes), settings)
        outputs, pool, machines = nested_outputs(problem)
        nested[:, attributes] = outputs
        dual[:, attributes], bias[:, attributes] = machines.dual, machines.bias
        sigmoid[:, attributes], weights[:, attributes] = pool.sigmoid, pool.weights
    return KernelFit(dual, bias, KappaPool(sigmoid, weights), nested)


def paper_outputs(
    recordings: BehaviorRecordings, held: NDArray[np.int64], settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; as `stacked_outputs`, by folds.

    The machine that scores held-out o has seen all other objects, where they are few; everything
    else for o (its sigmoids and weights, the training side) leaves o's whole fold out.
    """
    return table_outputs(_problem(recordings, settings), held, by_object=not recordings.large)

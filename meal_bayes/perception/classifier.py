"""Classifiers that must be trained anew for every fold: scikit-learn's, and the paper's.

A classifier of one's own: one clone an attribute learns from the features of all modalities side by
side. A class-balanced stacker with a nonnegative slope calibrates its decisions, on objects that
the clones never saw. So a classifier gains nothing by overfitting its objects or by preferring the
larger class.

The paper's method (Sect. 4.2): a support vector machine for each modality, pooled by Cohen's kappa.
A machine's decision becomes a probability by a sigmoid; its weight is the kappa of these
probabilities, negative ones 0; the output is the weighted mean, or 1/2 where all weights are 0.
Percepts include the base rate; they are no likelihood ratios. Decisions, sigmoids and weights are
out of fold (see `folds`).
"""

import os
from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.special import expit, logit
from sklearn.base import clone
from sklearn.svm import SVC

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.datasets.percepts import THRESHOLD
from meal_bayes.perception.folds import (
    UNKNOWN,
    FoldProblem,
    Machines,
    nested_outputs,
    table_outputs,
)
from meal_bayes.perception.leave_out import known_patterns, stacker_options
from meal_bayes.perception.perceiver import Pool
from meal_bayes.perception.recordings import BehaviorRecordings, FeatureSpace, dealt
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacked import Stacker
from meal_bayes.perception.stacking import fit_stacker, fit_stackers

_BOX = 10.0  # C of the support vector machines
_SEED = 0  # of estimators with random states that are not set
_LOOSE = 1e-2  # decisions are calibrated, and a tighter fit takes up to forty times longer
_SOFT = 1e-4  # ridge of the sigmoid's slope, for decisions that separate the classes


class Part(NamedTuple):
    """Attributes (a,) whose labels are known together, their machines and pool."""

    attributes: Ints
    machines: Machines
    pool: Pool


class ClassifierFit(NamedTuple):
    """A behavior fitted by scikit-learn, perhaps by the paper's method; a `BehaviorFit`."""

    parts: tuple[Part, ...]
    paper: bool
    n_attributes: int

    def scored(self, spaces: Sequence[FeatureSpace], rows: Sequence[Floats | None]) -> Floats:
        """Return log-odds of "true", (B,P); a missing modality has its mean features."""
        n = next(len(values) for values in rows if values is not None)
        pairs = zip(spaces, rows, strict=True)
        inputs: list[Floats | None]
        if self.paper:
            inputs = [None if values is None else s.similarity(values) for s, values in pairs]
        else:
            features = [np.zeros((n, len(s.varying))) if v is None else v for s, v in pairs]
            inputs = [np.hstack(features)]
        log_odds = np.zeros((n, self.n_attributes))
        for attributes, machines, pool in self.parts:
            log_odds[:, attributes] = pool.log_odds(machines.decide(inputs))
        return log_odds


def fit(
    recordings: BehaviorRecordings, settings: PerceptionSettings
) -> tuple[ClassifierFit, Floats]:
    """Fit one behavior; as `stacked.fit`, nested outputs by folds."""
    nested, parts = np.full(recordings.labels.shape, np.nan), []
    for _, attributes in known_patterns(recordings.labels >= 0):
        problem = _problem(recordings.of(attributes), settings)
        nested[:, attributes], pool = nested_outputs(problem)
        parts.append(Part(attributes, problem.train(problem.known), pool))
    return ClassifierFit(tuple(parts), settings.method == "paper", len(nested.T)), nested


def outputs(
    recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; as `stacked.outputs`, by folds of objects.

    The paper's machine that scores held-out o has seen all other objects, where they are few;
    everything else for o (its sigmoids and weights, the training side) leaves o's whole fold out.
    """
    by_object = settings.method == "paper" and not recordings.large
    return table_outputs(_problem(recordings, settings), held, by_object=by_object)


def _problem(recordings: BehaviorRecordings, settings: PerceptionSettings) -> FoldProblem:
    """Build the fold problem of recordings of which all labels are known, or none.

    Neighbors are in different folds. Many objects have the same folds for every behavior.
    """
    objects, known = recordings.objects, recordings.labels[:, 0] >= 0
    units = dealt(objects, settings.folds) if recordings.large else objects
    folds = np.where(known, units, UNKNOWN)
    if not recordings.large:
        folds[known] = np.unique(objects[known], return_inverse=True)[1].ravel() % settings.folds
    data = recordings.labels == 1, objects, folds, units
    if settings.method == "paper":
        machine = SVC(C=_BOX, kernel="precomputed", tol=_LOOSE)
        # Support vector machines train without the interpreter's lock; forests, below, set the
        # process's warning filters.
        threads = os.cpu_count() or 1
        return FoldProblem(recordings.kernels(), *data, machine, KappaPool.fitted, threads)
    features = np.hstack([space.rows for space in recordings.spaces])[None]
    pool = partial(_fit_stacker, settings=settings)
    return FoldProblem(features, *data, repeatable(settings.classifier), pool)


def repeatable(classifier: Any) -> Any:
    """Return a clone whose unset random states are set, so that equal calls give equal results."""
    parameters = clone(classifier).get_params().items()
    unset = [n for n, v in parameters if v is None and n.split("__")[-1] == "random_state"]
    return clone(classifier).set_params(**dict.fromkeys(unset, _SEED))


def _fit_stacker(
    decisions: Floats, truth: Bools, objects: Ints, settings: PerceptionSettings
) -> Stacker:
    """Calibrate decisions (r,1,P), each in units of its standard deviation: all share a ridge."""
    n_attributes = truth.shape[1]
    weights = np.zeros((n_attributes, 2))
    if not len(truth):
        return Stacker(weights)
    scale = decisions.std(axis=0)  # (1,P)
    scale = np.where(scale > 0, scale, 1.0)
    _, place, sizes = np.unique(objects, return_inverse=True, return_counts=True)
    features = np.ascontiguousarray((decisions / scale).transpose(2, 1, 0))
    targets, losses = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T), np.zeros(n_attributes)
    base, options = 2.0 / sizes[place.ravel()], stacker_options(settings)
    fit_stackers(base, features, targets, *options, weights, losses)
    weights[:, 1] /= scale[0]
    return Stacker(weights)


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
                agree, p_yes, p_true = (yes == labels).mean(), yes.mean(), labels.mean()
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
    positive, number = int(truth.sum()), len(truth)
    soft = np.where(truth, (positive + 1) / (positive + 2), 1 / (number - positive + 2))
    theta = np.zeros(2)
    features = np.concatenate([decisions, decisions])[None]
    target = np.repeat([1.0, -1.0], number)
    fit_stacker(features, target, np.concatenate([soft, 1 - soft]), _SOFT, False, theta)
    return theta

"""A classifier of one's own: any scikit-learn estimator, left out by folds of objects.

One clone an attribute learns from the features of all modalities side by side. A class-balanced
stacker with a nonnegative slope calibrates its decisions, on objects that the clones never saw. So
a classifier gains nothing by overfitting its objects or by preferring the larger class.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import logit
from sklearn.base import clone

from meal_bayes.display import short_repr
from meal_bayes.errors import DataError
from meal_bayes.perception.folds import FoldProblem, folds_of, nested_outputs, table_outputs
from meal_bayes.perception.leave_out import known_patterns
from meal_bayes.perception.modality import FeatureSpace
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacked import Stacker
from meal_bayes.perception.stacking import fit_stackers

Floats = NDArray[np.float64]
Rows = NDArray[np.bool_]

_SURE = 1e-3  # probabilities are kept this far from 0 and 1: 50 trees that agree are not certain
_SEED = 0  # of estimators with random states that are not set


@dataclass(frozen=True, slots=True)
class Clones:
    """Trained clones of an estimator, one an attribute; None where a class was missing."""

    estimators: tuple[Any, ...]

    def decide(self, features: Floats) -> Floats:
        """Return decisions (B,1,P) on features (B,d): 0 where a class was missing, NaN of NaN."""
        decisions = np.zeros((len(features), 1, len(self.estimators)))
        finite = np.isfinite(features).all(axis=1)
        decisions[~finite] = np.nan
        for p, estimator in enumerate(self.estimators):
            if estimator is not None and finite.any():
                decisions[finite, 0, p] = _decisions(estimator, features[finite])
        return decisions


@dataclass(frozen=True, slots=True)
class ClassifierFit:
    """A behavior fitted by clones of an estimator; a `BehaviorFit`.

    Attributes
    ----------
    clones : (P,) trained on all recordings.
    pool : log-odds of their decisions.
    nested : (n,P), see `BehaviorFit`.
    """

    clones: Clones
    pool: Stacker
    nested: Floats

    __repr__ = short_repr

    def scored(self, spaces: Sequence[FeatureSpace], rows: Sequence[Floats]) -> Floats:
        """Return log-odds of "true", (B,P), of each modality's standardized rows (B,d)."""
        return self.pool.log_odds(self.clones.decide(np.hstack(rows)))


def fit_classifier(recordings: BehaviorRecordings, settings: PerceptionSettings) -> ClassifierFit:
    """Fit one behavior; as `fit_stacked`, nested outputs by folds."""
    n, n_attributes = recordings.labels.shape
    estimators, weights = [None] * n_attributes, np.zeros((n_attributes, 2))
    nested = np.full((n, n_attributes), np.nan)
    for _, attributes in known_patterns(recordings.labels >= 0):
        problem = _problem(recordings.of(attributes), settings)
        nested[:, attributes], pool, trained = nested_outputs(problem)
        weights[attributes] = pool.weights
        for p, estimator in zip(attributes, trained.clones.estimators, strict=True):
            estimators[p] = estimator
    return ClassifierFit(Clones(tuple(estimators)), Stacker(weights), nested)


def classifier_outputs(
    recordings: BehaviorRecordings, held: NDArray[np.int64], settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; as `stacked_outputs`, by folds of objects."""
    return table_outputs(_problem(recordings, settings), held)


@dataclass(frozen=True, slots=True)
class _Trained:
    clones: Clones
    features: Floats  # (n,d) of all recordings

    def __call__(self, rows: Rows) -> Floats:
        return self.clones.decide(self.features[rows])


def _problem(recordings: BehaviorRecordings, settings: PerceptionSettings) -> FoldProblem:
    features, truth = recordings.features, recordings.labels == 1
    estimator = repeatable(settings.classifier)

    def train(rows: Rows) -> _Trained:
        clones = tuple(_fit(estimator, features[rows], own) for own in truth[rows].T)
        return _Trained(Clones(clones), features)

    def fit_pool(decisions: Floats, truth: Rows, objects: NDArray[np.int64]) -> Stacker:
        return _fit_pool(decisions, truth, objects, settings)

    folds, units = folds_of(recordings, settings.folds)
    return FoldProblem(truth, recordings.objects, folds, units, 1, train, fit_pool)


def repeatable(classifier: Any) -> Any:
    """Return a clone whose unset random states are set, so that equal calls give equal results."""
    copy = clone(classifier)
    unset = {
        name: _SEED
        for name, value in copy.get_params().items()
        if value is None and name.split("__")[-1] == "random_state"
    }
    return copy.set_params(**unset)


def _fit(estimator: Any, features: Floats, truth: Rows) -> Any:
    if truth.all() or not truth.any():
        return None
    return clone(estimator).fit(features, truth.astype(np.int64))


def _decisions(estimator: Any, features: Floats) -> Floats:
    """Return one number a row, which rises with the probability of "true"."""
    if hasattr(estimator, "decision_function"):
        decisions = np.asarray(estimator.decision_function(features), np.float64)
    else:
        prob = np.asarray(estimator.predict_proba(features), np.float64)
        decisions = logit(np.clip(prob[:, list(estimator.classes_).index(1)], _SURE, 1 - _SURE))
    if decisions.shape != (len(features),) or not np.isfinite(decisions).all():
        raise DataError(
            f"{type(estimator).__name__} decided {decisions.shape} numbers, perhaps not finite; "
            f"expected one finite number for each of {len(features)} recordings."
        )
    return decisions


def _fit_pool(
    decisions: Floats, truth: Rows, objects: NDArray[np.int64], settings: PerceptionSettings
) -> Stacker:
    """Calibrate decisions (r,1,P), each in units of its standard deviation: all share a ridge."""
    n_attributes = truth.shape[1]
    weights = np.zeros((n_attributes, 2))
    if not len(truth):
        return Stacker(weights)
    scale = decisions.std(axis=0)  # (1,P)
    scale = np.where(scale > 0, scale, 1.0)
    _, place, sizes = np.unique(objects, return_inverse=True, return_counts=True)
    fit_stackers(
        2.0 / sizes[place.ravel()],
        np.ascontiguousarray((decisions / scale).transpose(1, 2, 0)),
        np.ascontiguousarray(np.where(truth, 1.0, -1.0).T),
        settings.ridge,
        settings.nonnegative,
        settings.balanced,
        weights,
        np.zeros(n_attributes),
    )
    weights[:, 1] /= scale[0]
    return Stacker(weights)

"""Classifiers that are trained again for every fold: scikit-learn's, and the paper's.

All recordings of an object are in the same fold. Decisions on a fold come from classifiers without
this fold. The rule that combines and calibrates decisions on a fold is fitted to decisions on other
folds, by classifiers without both folds. Therefore each set of at most three folds is left out
once: with five folds, 25 trainings are enough for the percept tables of all objects.

A user's own classifier: for each attribute, one clone learns from the features of all modalities
side by side. A class-balanced stacker with a nonnegative slope calibrates its decisions, on objects
on which the clones were not trained. So a classifier gains nothing by overfitting its objects or by
preferring the larger class.

The paper's method (Sect. 4.2): a support vector machine for each modality, weighted by Cohen's
kappa. A sigmoid turns the decision of a machine into a probability. The weight of a machine is the
kappa of these probabilities, or 0 if kappa is negative. The output is the weighted mean, or 1/2 if
all weights are 0. Percepts include the base rate; they are not likelihood ratios.
"""

import os
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, logit
from sklearn.base import clone
from sklearn.svm import SVC

from meal_bayes.arrays import Bools, ByValue, Floats, Ints
from meal_bayes.datasets.percepts import THRESHOLD
from meal_bayes.perception.compiled_stacking import fit_stacker, fit_stackers
from meal_bayes.perception.feature_spaces import (
    BehaviorRecordings,
    FeatureSpace,
    Rows,
    assign_folds,
)
from meal_bayes.perception.kernel_ridge import RIDGE, Stacker, object_weights
from meal_bayes.perception.own_classifier import blamed, decisions_of, repeatable
from meal_bayes.perception.settings import PerceptionSettings

_SOFT = 1e-4  # ridge on the sigmoid's slope, needed if decisions separate the classes


class KappaPool(NamedTuple):
    """Sigmoids (M,P,2) of decisions, by offset and slope, and weights (M,P), Cohen's kappa."""

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
                # Cohen's kappa: (agreement - chance) / (1 - chance)
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


Decisions = Mapping[frozenset[int], Floats]  # folds left out -> (n,M,P) of their rows

_BOX = 10.0  # C of the support vector machines
_LOOSE = 1e-2  # tolerance of the fit; a smaller one takes up to forty times as long


class Machines(NamedTuple):
    """Trained estimators for M inputs and P attributes.

    An input is the features of all modalities, or the kernel of one modality between recordings.

    Attributes
    ----------
    estimators : NDArray[np.object_]
        (M,P) estimators; None if the training set had only one class.
    columns : Bools | slice
        Columns of an input that the estimators use; for a kernel, the training recordings.
    questions : Sequence[str]
        (P,) names of attribute, behavior and left-out folds for error messages.
    """

    estimators: NDArray[np.object_]
    columns: Bools | slice
    questions: Sequence[str]

    def decide(self, inputs: Sequence[Floats | None]) -> Floats:
        """Return decisions (B,M,P) on inputs (B,d).

        Decisions are 0 without an estimator, and NaN if an input is None.
        """
        n = next(len(values) for values in inputs if values is not None)
        decisions = np.zeros((n, *self.estimators.shape))
        for m, p in np.ndindex(self.estimators.shape):
            values = inputs[m]
            estimator = self.estimators[m, p]
            if values is None:
                decisions[:, m, p] = np.nan
            elif estimator is not None:
                features = np.array(values[:, self.columns])  # it may write into its own copy
                with blamed(estimator, f"decide {self.questions[p]}"):
                    decisions[:, m, p] = decisions_of(estimator, features)
        return decisions


@dataclass(frozen=True)
class FoldProblem(ByValue):
    """Recordings of one behavior, the folds of their objects, and how classifiers are trained.

    Attributes
    ----------
    inputs : Floats
        (M,n,d) inputs of `Machines`.
    truth : Bools
        (n,P) labels.
    objects : Ints
        (n,) objects in increasing order.
    folds : Ints
        (n,) folds of the objects; -1 for unknown labels, which are scored but not used in training.
    held_groups : Ints
        (n,) groups that a percept table holds out: objects, or folds of many objects.
    questions : Sequence[str]
        (P,) names of attribute and behavior for error messages.
    estimator : Any
        Estimator whose clones are trained.
    fit_pool : Callable[[Floats, Bools, Ints], Stacker | KappaPool]
        Function that fits the rule that combines decisions, from out-of-fold decisions (r,M,P),
        truth (r,P) and objects (r,); r may be 0.
    threads : int
        Number of threads; more than one only if training is thread-safe.
    """

    inputs: Floats
    truth: Bools
    objects: Ints
    folds: Ints
    held_groups: Ints
    questions: Sequence[str]
    estimator: Any
    fit_pool: Callable[[Floats, Bools, Ints], Stacker | KappaPool]
    threads: int = 1

    @cached_property
    def names(self) -> list[int]:
        """The folds."""
        return list(map(int, np.unique(self.folds[self.folds >= 0])))

    def train(self, rows: Bools) -> Machines:
        """Train clones of the estimator on some rows."""
        pairwise = getattr(self.estimator, "kernel", None) == "precomputed"
        columns = rows if pairwise else slice(None)
        left_out = ", ".join(map(str, np.setdiff1d(self.names, self.folds[rows]))) or "none"
        questions = [f"{question} (folds left out: {left_out})" for question in self.questions]
        fitted = np.full((len(self.inputs), self.truth.shape[1]), None)
        for m, p in np.ndindex(fitted.shape):
            labels = self.truth[rows, p].astype(int)
            features = self.inputs[m][rows][:, columns]
            if 0 < labels.sum() < len(labels) and features.size:  # else nothing can be learned
                with blamed(self.estimator, f"learn {questions[p]}"):
                    fitted[m, p] = clone(self.estimator).fit(features, labels)
        return Machines(fitted, columns, questions)

    def decide(self, trained_on: Bools, rows: Bools) -> Floats:
        """Train on some rows and return decisions on others, (B,M,P)."""
        return self.train(trained_on).decide([values[rows] for values in self.inputs])

    def decide_without(self, most: int) -> Decisions:
        """Leave out every set of at most `most` folds; return decisions on the left-out rows."""
        sets = [frozenset(s) for k in range(1, most + 1) for s in combinations(self.names, k)]

        def decide(left_out: frozenset[int]) -> Floats:
            out = np.isin(self.folds, list(left_out))
            decisions = np.full((len(self.folds), len(self.inputs), self.truth.shape[1]), np.nan)
            decisions[out] = self.decide((self.folds >= 0) & ~out, out)
            return decisions

        with ThreadPoolExecutor(self.threads) as workers:
            return dict(zip(sets, workers.map(decide, sets), strict=True))


def _pool(
    problem: FoldProblem, decisions: Decisions, left_out: frozenset[int] = frozenset()
) -> Stacker | KappaPool:
    """Fit a pool to decisions on the remaining folds, by classifiers without the fold."""
    # Decisions on a fold come from classifiers without this fold and without `left_out`.
    remaining = [fold for fold in problem.names if fold not in left_out]
    rows = np.isin(problem.folds, remaining) & (len(remaining) > 1)  # else nothing is out of fold
    out_of_fold = np.empty((len(rows), len(problem.inputs), problem.truth.shape[1]))
    for fold in remaining:
        rows_of_fold = problem.folds == fold
        out_of_fold[rows_of_fold] = decisions[left_out | {fold}][rows_of_fold]
    return problem.fit_pool(out_of_fold[rows], problem.truth[rows], problem.objects[rows])


def _nested(
    problem: FoldProblem, decisions: Decisions, left_out: frozenset[int] = frozenset()
) -> Floats:
    """Score each fold by classifiers and pools without the fold and `left_out`, (n,P)."""
    outputs = np.full(problem.truth.shape, np.nan)
    for fold in problem.names:
        if fold not in left_out:
            rows = problem.folds == fold
            without = left_out | {fold}
            outputs[rows] = _pool(problem, decisions, without).log_odds(decisions[without][rows])
    return outputs


class AttributeMachines(NamedTuple):
    """Machines and pool of attributes (a,) whose labels are known for the same recordings."""

    attributes: Ints
    machines: Machines
    pool: Stacker | KappaPool


class ClassifierFit(NamedTuple):
    """Fitted scikit-learn classifiers of a behavior, or the paper's; same use as `KernelFit`."""

    parts: tuple[AttributeMachines, ...]
    paper: bool
    n_attributes: int

    def scored(self, spaces: Sequence[FeatureSpace], rows: Rows) -> Floats:
        """Return log-odds of "true", (B,P); mean features replace those of a missing modality."""
        n = next(len(values) for values in rows if values is not None)
        pairs = zip(spaces, rows, strict=True)
        inputs: list[Floats | None]
        if self.paper:
            inputs = [None if v is None else space.similarity(v) for space, v in pairs]
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
    """Fit the classifiers of one behavior, like `kernel_ridge.fit` with folds left out."""
    nested = np.full(recordings.labels.shape, np.nan)
    parts = []
    for attributes, subset in recordings.by_known_labels():
        problem = _problem(subset, settings)
        decisions = problem.decide_without(2)
        nested[:, attributes] = _nested(problem, decisions)
        pool = _pool(problem, decisions)
        machines = problem.train(problem.folds >= 0)
        parts.append(AttributeMachines(attributes, machines, pool))
    return ClassifierFit(tuple(parts), settings.method == "paper", len(nested.T)), nested


def outputs(
    recordings: BehaviorRecordings, held: Ints, settings: PerceptionSettings
) -> tuple[Floats, Floats]:
    """Score one behavior for percept tables, like `kernel_ridge.outputs` with folds left out.

    For a held-out object o, the whole fold of o is left out. There is one exception: with few
    objects, the paper's machine that scores o itself is trained again on all other objects.
    """
    problem = _problem(recordings, settings)
    labeled = problem.folds >= 0
    decisions = problem.decide_without(3)
    held_outputs = _nested(problem, decisions)
    training = np.tile(held_outputs, (len(held), 1, 1))
    for fold in problem.names:
        outputs_without = _nested(problem, decisions, frozenset([fold]))
        # The other objects of the fold are scored by classifiers without the fold, too.
        of_fold = problem.folds == fold
        outputs_without[of_fold] = held_outputs[of_fold]
        training[np.isin(held, problem.held_groups[of_fold])] = outputs_without
    if settings.method == "paper" and not recordings.large:
        pools = {fold: _pool(problem, decisions, frozenset([fold])) for fold in problem.names}

        def decide_anew(o: int) -> None:
            single = problem.objects == o
            fresh = problem.decide(labeled & ~single, single)
            held_outputs[single] = pools[int(problem.folds[single][0])].log_odds(fresh)

        with ThreadPoolExecutor(problem.threads) as workers:
            list(workers.map(decide_anew, np.intersect1d(held, problem.objects[labeled])))
    if not labeled.all():
        decided = problem.decide(labeled, ~labeled)
        held_outputs[~labeled] = _pool(problem, decisions).log_odds(decided)
    return held_outputs, training


def _problem(recordings: BehaviorRecordings, settings: PerceptionSettings) -> FoldProblem:
    """Build the fold problem of recordings for which all labels are known, or none.

    Neighboring objects are in different folds. With many objects, folds are the same for every
    behavior.
    """
    objects = recordings.objects
    labeled = recordings.labels[:, 0] >= 0
    held_groups = assign_folds(objects, settings.folds) if recordings.large else objects
    folds = np.where(labeled, held_groups, -1)
    if not recordings.large:
        _, object_of = np.unique(objects[labeled], return_inverse=True)
        folds[labeled] = object_of.ravel() % settings.folds
    truth = recordings.labels == 1
    fit_pool: Callable[[Floats, Bools, Ints], Stacker | KappaPool]
    if settings.method == "paper":
        inputs = recordings.kernels()
        estimator = SVC(C=_BOX, kernel="precomputed", tol=_LOOSE)
        fit_pool = KappaPool.fitted
        # Support vector machines release the interpreter's lock while training.
        threads = os.cpu_count() or 1
    else:
        inputs = np.hstack([space.rows for space in recordings.spaces])[None]
        with blamed(settings.classifier, "be copied"):
            estimator = repeatable(settings.classifier)
        fit_pool = partial(_fit_stacker, settings=settings)
        threads = 1  # forests change the warning filters of the process
    return FoldProblem(
        inputs=inputs,
        truth=truth,
        objects=objects,
        folds=folds,
        held_groups=held_groups,
        questions=recordings.questions,
        estimator=estimator,
        fit_pool=fit_pool,
        threads=threads,
    )


def _fit_stacker(
    decisions: Floats, truth: Bools, objects: Ints, settings: PerceptionSettings
) -> Stacker:
    """Calibrate decisions (r,1,P) in units of their standard deviation, so all share a ridge."""
    weights = np.zeros((truth.shape[1], 2))
    if len(truth):
        scale = decisions.std(axis=0)[0]
        scale = np.where(scale > 0, scale, 1.0)
        features = np.ascontiguousarray((decisions / scale).transpose(2, 1, 0))
        targets = np.where(truth, 1.0, -1.0).T.copy()
        fit_stackers(
            object_weights(objects),
            features,
            targets,
            ridge=RIDGE,
            nonnegative=settings.nonnegative,
            balanced=settings.balanced,
            weights=weights,  # written
            losses=np.zeros(len(weights)),
        )
        weights[:, 1] /= scale
    return Stacker(weights)

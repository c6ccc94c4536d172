"""The paper's recipe: a support vector machine a modality, calibrated, pooled by Cohen's kappa.

Each modality's decision becomes a probability by a sigmoid fitted on out-of-fold decisions; its
weight is the Cohen's kappa of these probabilities, negative ones 0; the behavior says the
weighted mean, or 1/2 where all weights are 0. Folds are groups of objects, an object is never
split, and what is said of a fold (decision, sigmoid, weights) is learned from other folds only.
Its percepts keep the base rate inside; they are no likelihood ratios.
"""

import os
from collections.abc import Iterable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from sklearn.svm import SVC

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets.percepts import THRESHOLD
from meal_bayes.perception.ensemble import BehaviorFit
from meal_bayes.perception.leave_out import known_patterns
from meal_bayes.perception.recordings import BehaviorRecordings
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacking import fit_stacker

Floats = NDArray[np.float64]

_LOOSE = 1e-2  # decisions are calibrated, and a tighter fit takes up to forty times longer
_SOFT = 1e-4  # ridge of the sigmoid's slope, for decisions that separate the classes


@dataclass(frozen=True, slots=True)
class KappaPool:
    """Sigmoid a modality, and their mean weighted by Cohen's kappa."""

    sigmoid: Floats  # (M,P,2) offset and slope on the decision
    weights: Floats  # (M,P) kappa, 0 where it is negative

    def __post_init__(self) -> None:
        set_frozen(self, sigmoid=freeze(self.sigmoid), weights=freeze(self.weights))

    def log_odds(self, decisions: Floats) -> Floats:
        """Log-odds of the pooled probability, (B,P), from decisions (B,M,P)."""
        probability = _expit(self.sigmoid[..., 0] + self.sigmoid[..., 1] * decisions)
        total = self.weights.sum(axis=0)
        pooled = np.einsum("bmp,mp->bp", probability, self.weights)
        pooled = np.where(total > 0, pooled / np.where(total > 0, total, 1.0), 0.5)
        pooled = np.clip(pooled, 1e-9, 1 - 1e-9)
        return np.asarray(np.log(pooled / (1 - pooled)))


@dataclass(frozen=True, slots=True)
class _Machines:
    """Recordings of one behavior with known labels, and the folds of their objects."""

    grams: Floats  # (M,n,n)
    truth: NDArray[np.bool_]  # (n,P)
    objects: NDArray[np.int64]  # (n,)
    folds: NDArray[np.int64]  # (n,) fold of each recording's object
    box: float

    @property
    def fold_names(self) -> tuple[int, ...]:
        return tuple(np.unique(self.folds).tolist())

    def train(self, rows: NDArray[np.bool_]) -> tuple[Floats, Floats]:
        """Machines of these rows: dual (M,P,n) and bias (M,P); zero where a class is missing."""
        n_modalities, n, n_attributes = len(self.grams), len(self.truth), self.truth.shape[1]
        dual, bias = (
            np.zeros((n_modalities, n_attributes, n)),
            np.zeros((n_modalities, n_attributes)),
        )
        chosen = np.flatnonzero(rows)
        for m in range(n_modalities):
            gram = self.grams[m][np.ix_(chosen, chosen)]
            for p in range(n_attributes):
                truth = self.truth[chosen, p]
                if truth.all() or not truth.any():
                    continue
                machine = SVC(C=self.box, kernel="precomputed", tol=_LOOSE).fit(gram, truth)
                dual[m, p, chosen[machine.support_]] = machine.dual_coef_[0]
                bias[m, p] = machine.intercept_[0]
        return dual, bias

    def decide(self, dual: Floats, bias: Floats, rows: NDArray[np.bool_]) -> Floats:
        """Decisions on these rows, (B,M,P)."""
        return np.asarray(np.einsum("mbn,mpn->bmp", self.grams[:, rows], dual) + bias)

    def without(self, left_out: Iterable[int]) -> Floats:
        """Decisions on the rows of these folds by machines that never saw them, (n,M,P)."""
        out = np.isin(self.folds, list(left_out))
        decisions = np.full((len(self.folds), len(self.grams), self.truth.shape[1]), np.nan)
        if not out.all():
            decisions[out] = self.decide(*self.train(~out), out)
        else:
            decisions[out] = 0.0
        return decisions


Decisions = Mapping[frozenset[int], Floats]


def _machines(
    grams: Floats,
    truth: NDArray[np.bool_],
    objects: NDArray[np.int64],
    settings: PerceptionSettings,
) -> _Machines:
    """Deal the objects to folds one by one, as neighbors in name are alike."""
    rank = np.unique(objects, return_inverse=True)[1].ravel()
    return _Machines(grams, truth, objects, rank % settings.folds, settings.box)


def _all_decisions(machines: _Machines, sets: Iterable[frozenset[int]]) -> Decisions:
    """Train for every set of left-out folds; scikit-learn trains without the interpreter's lock."""
    wanted = sorted(set(sets), key=sorted)
    with ThreadPoolExecutor(os.cpu_count() or 1) as pool:
        return dict(zip(wanted, pool.map(machines.without, wanted), strict=True))


def _fit_pool(machines: _Machines, decisions: Decisions, left_out: frozenset[int]) -> KappaPool:
    """Sigmoids and weights from out-of-fold decisions inside the folds that remain."""
    remaining = [fold for fold in machines.fold_names if fold not in left_out]
    rows = np.isin(machines.folds, remaining)
    n_modalities, n_attributes = len(machines.grams), machines.truth.shape[1]
    sigmoid, weights = (
        np.zeros((n_modalities, n_attributes, 2)),
        np.zeros((n_modalities, n_attributes)),
    )
    if len(remaining) < 2:  # noqa: PLR2004  nothing is out of fold
        return KappaPool(sigmoid, weights)
    inside = np.empty((len(rows), n_modalities, n_attributes))
    for fold in remaining:
        own = machines.folds == fold
        inside[own] = decisions[left_out | {fold}][own]
    truth = machines.truth[rows]
    for p in range(n_attributes):
        if truth[:, p].all() or not truth[:, p].any():
            continue
        for m in range(n_modalities):
            sigmoid[m, p] = fit_sigmoid(inside[rows, m, p], truth[:, p])
            log_odds = sigmoid[m, p, 0] + sigmoid[m, p, 1] * inside[rows, m, p]
            weights[m, p] = max(_kappa(log_odds > THRESHOLD, truth[:, p]), 0.0)
    return KappaPool(sigmoid, weights)


def fit_sigmoid(decisions: Floats, truth: NDArray[np.bool_]) -> Floats:
    """Offset and slope of Pr(true | decision), with Platt's softened targets [Platt1999]."""
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


def _expit(log_odds: Floats) -> Floats:
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50, 50))))


def _sets_of(folds: Iterable[int], size: int) -> set[frozenset[int]]:
    """All sets of at most `size` folds, but the empty one."""
    sets = {frozenset([fold]) for fold in folds}
    single = set(sets)
    for _ in range(size - 1):
        sets |= {a | b for a in sets for b in single}
    return sets


def fit_paper(recordings: BehaviorRecordings, settings: PerceptionSettings) -> BehaviorFit:
    """Fit one behavior by the paper's recipe; as `fit_stacked`, nested outputs by folds."""
    grams, labels = recordings.grams, recordings.labels
    n_modalities, (n, n_attributes) = len(grams), labels.shape
    dual, bias = np.zeros((n_modalities, n_attributes, n)), np.zeros((n_modalities, n_attributes))
    sigmoid, weights = np.zeros((n_modalities, n_attributes, 2)), np.zeros_like(bias)
    nested = np.full((n, n_attributes), np.nan)
    for known, attributes in known_patterns(labels >= 0):
        truth = labels[np.ix_(known, attributes)] == 1
        part = grams[:, known][:, :, known]
        machines = _machines(part, truth, recordings.objects[known], settings)
        decisions = _all_decisions(machines, _sets_of(machines.fold_names, 2))
        pool = _fit_pool(machines, decisions, frozenset())
        sigmoid[:, attributes], weights[:, attributes] = pool.sigmoid, pool.weights
        nested[np.ix_(known, attributes)] = _nested(machines, decisions)
        duals, bias[:, attributes] = machines.train(np.ones(len(truth), np.bool_))
        dual[np.ix_(np.arange(n_modalities), attributes, known)] = duals
    return BehaviorFit(dual, bias, KappaPool(sigmoid, weights), nested)


def _nested(
    machines: _Machines, decisions: Decisions, left_out: frozenset[int] = frozenset()
) -> Floats:
    """Score each fold by machines and pools that saw neither it nor `left_out`, (n,P)."""
    outputs = np.full(machines.truth.shape, np.nan)
    for fold in machines.fold_names:
        if fold not in left_out:
            own, without = machines.folds == fold, left_out | {fold}
            pool = _fit_pool(machines, decisions, without)
            outputs[own] = pool.log_odds(decisions[without][own])
    return outputs


def paper_outputs(
    grams: Floats,
    labels: NDArray[np.int8],
    known: NDArray[np.bool_],
    held: NDArray[np.int64],
    settings: PerceptionSettings,
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; as `stacked_outputs`, by folds.

    The machine that scores held-out o has seen all other objects; everything else for o (its
    sigmoids and weights, the training side) leaves o's whole fold out.
    """
    n_objects, n_attributes = labels.shape
    n_recordings = grams.shape[1] // n_objects
    rows, names = np.repeat(known, n_recordings), np.flatnonzero(known)
    truth = np.repeat(labels[known] == 1, n_recordings, axis=0)
    machines = _machines(
        grams[:, rows][:, :, rows], truth, np.repeat(names, n_recordings), settings
    )
    fold_of = dict(zip(machines.objects.tolist(), machines.folds.tolist(), strict=True))
    scored = [o for o in held.tolist() if o in fold_of]
    decisions = _all_decisions(machines, _sets_of(machines.fold_names, 3))
    own = np.full((n_objects, n_recordings, n_attributes), np.nan)
    training = np.full((n_objects, *own.shape), np.nan)
    per_object = (len(names), n_recordings, n_attributes)
    pools = {h: _fit_pool(machines, decisions, frozenset([h])) for h in machines.fold_names}
    sides = {}
    for h in {fold_of[o] for o in scored}:
        side = _nested(machines, decisions, frozenset([h]))
        inside = machines.folds == h  # o's fellows are scored without the fold, as is all else
        side[inside] = pools[h].log_odds(decisions[frozenset([h])][inside])
        sides[h] = side.reshape(per_object)

    def score(o: int) -> Floats:
        single = machines.objects == o
        return pools[fold_of[o]].log_odds(machines.decide(*machines.train(~single), single))

    with ThreadPoolExecutor(os.cpu_count() or 1) as workers:
        for o, outputs in zip(scored, workers.map(score, scored), strict=True):
            own[o] = outputs
            training[o, names] = sides[fold_of[o]]
            training[o, o] = np.nan
    unknown = np.flatnonzero(~known)
    if len(unknown):
        dual, bias = machines.train(np.ones(len(truth), np.bool_))
        across = np.einsum("mbn,mpn->bmp", grams[:, ~rows][:, :, rows], dual) + bias
        everyone = _fit_pool(machines, decisions, frozenset())
        own[unknown] = everyone.log_odds(across).reshape(-1, n_recordings, n_attributes)
        training[np.ix_(unknown, names)] = _nested(machines, decisions).reshape(per_object)
    return own, training

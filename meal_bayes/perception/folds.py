"""Leaving out grouped folds of objects, for classifiers that must be trained anew for every fold.

An object is never split. A decision on a fold comes from classifiers that never saw it, and what
pools and calibrates decisions for a fold is fitted to decisions on other folds by classifiers that
saw neither. So each set of at most three folds is left out once: with five, 25 trainings serve
every object's percept table.
"""

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from scipy.special import logit
from sklearn.base import clone

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.errors import DataError
from meal_bayes.perception.perceiver import Pool

Decisions = Mapping[frozenset[int], Floats]  # folds left out -> (n,M,P) of their rows

_SURE = 1e-3  # probabilities stay this far from 0 and 1: 50 trees that agree are not certain
UNKNOWN = -1  # fold of recordings whose labels are unknown: they are scored, never trained on


class Machines(NamedTuple):
    """Estimators (M,P) of inputs and attributes, None where a class was missing, and their columns.

    An input is what an estimator learns from: the features of all modalities, or the kernel of one
    modality between recordings, whose columns are the recordings trained on.
    """

    estimators: tuple[tuple[Any, ...], ...]
    columns: Bools | slice

    def decide(self, inputs: Sequence[Floats | None]) -> Floats:
        """Return decisions (B,M,P) on inputs (B,d): 0 where a class was missing, NaN of None."""
        n = next(len(values) for values in inputs if values is not None)
        decisions = np.zeros((n, len(inputs), len(self.estimators[0])))
        for m, values in enumerate(inputs):
            for p, estimator in enumerate(self.estimators[m]):
                if values is None:
                    decisions[:, m, p] = np.nan
                elif estimator is not None:
                    decisions[:, m, p] = _decisions(estimator, values[:, self.columns])
        return decisions


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


@dataclass(frozen=True)
class FoldProblem:
    """Recordings of one behavior, the folds of their objects, and how classifiers are trained.

    Inputs (M,n,d) are those of `Machines`; objects (n,) rise; folds (n,) are those of the
    recordings' objects, units (n,) what a percept table holds out: objects, or folds where there
    are many. `fit_pool` takes decisions (r,M,P), truth (r,P) and objects (r,) of some rows, decided
    by those who never saw them; r may be 0. More than one thread trains only where training is
    thread-safe.
    """

    inputs: Floats
    truth: Bools
    objects: Ints
    folds: Ints
    units: Ints
    estimator: Any
    fit_pool: Callable[[Floats, Bools, Ints], Pool]
    threads: int = 1

    @cached_property
    def known(self) -> Bools:
        """Bools that may be trained on."""
        return np.asarray(self.folds != UNKNOWN)

    @cached_property
    def names(self) -> list[int]:
        """The folds."""
        return list(map(int, np.unique(self.folds[self.known])))

    def train(self, rows: Bools) -> Machines:
        """Train clones of the estimator on some rows, by their labels alone."""
        pairwise = getattr(self.estimator, "kernel", None) == "precomputed"
        columns = rows if pairwise else slice(None)
        fitted = tuple(
            tuple(
                clone(self.estimator).fit(values[rows][:, columns], labels)
                if 0 < labels.sum() < len(labels)
                else None
                for labels in self.truth[rows].T.astype(int)
            )
            for values in self.inputs
        )
        return Machines(fitted, columns)

    def decide(self, trained_on: Bools, rows: Bools) -> Floats:
        """Train on some rows, and decide on others, (B,M,P)."""
        return self.train(trained_on).decide([values[rows] for values in self.inputs])

    def decide_without(self, most: int) -> Decisions:
        """Train without every set of at most so many folds, and decide on their rows."""
        sets = [frozenset(s) for k in range(1, most + 1) for s in combinations(self.names, k)]

        def decide(left_out: frozenset[int]) -> Floats:
            out = np.isin(self.folds, list(left_out))
            decisions = np.full((len(self.folds), len(self.inputs), self.truth.shape[1]), np.nan)
            rest = self.known & ~out
            decisions[out] = self.decide(rest, out) if rest.any() else 0.0
            return decisions

        with ThreadPoolExecutor(self.threads) as workers:
            return dict(zip(sets, workers.map(decide, sets), strict=True))


def nested_outputs(problem: FoldProblem) -> tuple[Floats, Pool]:
    """Score each row by classifiers and pools that never saw its fold, (n,P); and fit the pool.

    Log-odds are NaN where a label is unknown.
    """
    decisions = problem.decide_without(2)
    return _nested(problem, decisions), _pool(problem, decisions)


def table_outputs(
    problem: FoldProblem, held: Ints, *, by_object: bool = False
) -> tuple[Floats, Floats]:
    """Score one behavior for the percept tables; returns as `stacked.outputs` does.

    All that is done for held-out o leaves o's whole fold out. With `by_object` the classifier that
    decides on o itself is trained anew, and leaves o alone out.
    """
    decisions = problem.decide_without(3)
    held_outputs = _nested(problem, decisions)
    training = np.tile(held_outputs, (len(held), 1, 1))
    for h in problem.names:
        side = _nested(problem, decisions, frozenset([h]))
        inside = problem.folds == h  # o's fellows are scored without the fold, as is all else
        side[inside] = held_outputs[inside]
        training[np.isin(held, problem.units[inside])] = side
    if by_object:
        scored = np.intersect1d(held, problem.objects[problem.known])
        pools = {h: _pool(problem, decisions, frozenset([h])) for h in problem.names}

        def decide_anew(o: int) -> Floats:
            single = problem.objects == o
            fresh = problem.decide(problem.known & ~single, single)
            return pools[int(problem.folds[single][0])].log_odds(fresh)

        with ThreadPoolExecutor(problem.threads) as workers:
            for o, log_odds in zip(scored, workers.map(decide_anew, scored), strict=True):
                held_outputs[problem.objects == o] = log_odds
    unknown = ~problem.known
    if unknown.any():
        decided = problem.decide(problem.known, unknown)
        held_outputs[unknown] = _pool(problem, decisions).log_odds(decided)
    return held_outputs, training


def _pool(
    problem: FoldProblem, decisions: Decisions, left_out: frozenset[int] = frozenset()
) -> Pool:
    """Fit a pool to decisions inside the folds that remain, each by who saw the others only."""
    remaining = [fold for fold in problem.names if fold not in left_out]
    rows = np.isin(problem.folds, remaining) & (len(remaining) > 1)  # else nothing is out of fold
    inside = np.empty((len(rows), len(problem.inputs), problem.truth.shape[1]))
    for fold in remaining:
        rows_of_fold = problem.folds == fold
        inside[rows_of_fold] = decisions[left_out | {fold}][rows_of_fold]
    return problem.fit_pool(inside[rows], problem.truth[rows], problem.objects[rows])


def _nested(
    problem: FoldProblem, decisions: Decisions, left_out: frozenset[int] = frozenset()
) -> Floats:
    """Score each fold by classifiers and pools that saw neither it nor `left_out`, (n,P)."""
    outputs = np.full(problem.truth.shape, np.nan)
    for fold in problem.names:
        if fold not in left_out:
            rows, without = problem.folds == fold, left_out | {fold}
            outputs[rows] = _pool(problem, decisions, without).log_odds(decisions[without][rows])
    return outputs

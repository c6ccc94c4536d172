"""Outputs on groups of recordings by classifiers and stackers that never saw them.

Groups are objects, or folds of objects where there are many. With C = gram + noise and targets y of
+-1, the kernel-ridge classifier trained without the recordings G decides
y_G - inv(C^-1[G,G]) (C^-1 y)_G on them [Cawley2006]: one inverse a modality serves every attribute,
object and pair of objects.

Many recordings are compared with m landmarks, of kernel L L'. A recording x has m features
phi(x) = L^-1 k(x), whose products are nearly its kernels (Nyström's approximation [Williams2001]).
A ridge on them is a kernel ridge; its normal equations are sums over folds of objects, so leaving
folds out subtracts theirs. All costs are linear in the recordings.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from meal_bayes.arrays import Bools, Floats, Ints
from meal_bayes.perception.settings import PerceptionSettings
from meal_bayes.perception.stacking import fit_stackers, score_without

RIDGE = 0.5  # on the stackers' slopes
NOBODY = np.empty((1, 0), np.int64)  # one set, of no groups
_JITTER = 1e-9  # on the landmarks' kernel, where two of them are alike


@dataclass(frozen=True, slots=True)
class Problem:
    """Recordings of one behavior whose labels are known, group by group.

    Groups (k,) rise; the recordings of each begin at `starts` (k+1,). Weights (n,) are of each
    recording in a stacker's loss, 2 an object; targets (P,n) are +-1; duals (M,P,m) the weights of
    what recordings are compared with, trained on all groups.

    `score` takes groups left out (s,), their `rows` (q,), and whether those who decide on the
    others did not see them either. It returns decisions on the recordings left out, (M,P,q), and on
    every other group by itself left out too, (M,P,n), 0 where they are left out.
    """

    groups: Ints
    starts: Ints
    weights: Floats
    targets: Floats
    duals: Floats
    score: Callable[[Ints, Ints, bool], tuple[Floats, Floats]]

    def rows(self, groups: Ints) -> Ints:
        """Return the rows of some groups (s,), one group after the other."""
        ranges = [np.arange(self.starts[g], self.starts[g + 1]) for g in groups]
        return np.concatenate([NOBODY[0], *ranges])


def kernel_problem(grams: Floats, truth: Bools, groups: Ints, noise: float) -> Problem:
    """Invert C of each modality: grams (M,n,n), truth (n,P), groups (n,) rising."""
    names, starts, sizes = np.unique(groups, return_index=True, return_counts=True)
    starts = np.append(starts, len(groups))
    targets = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T)
    inverses = np.linalg.inv(grams + noise * np.eye(len(groups)))
    inverses = (inverses + inverses.transpose(0, 2, 1)) / 2
    duals = targets @ inverses

    def score(left_out: Ints, rows: Ints, nested: bool) -> tuple[Floats, Floats]:
        held, others = score_without(left_out, rows, inverses, duals, targets, starts, nested)
        return held, others

    return Problem(names, starts, np.repeat(2.0 / sizes, sizes), targets, duals, score)


def landmark_problem(
    kernels: Floats, landmarks: Floats, truth: Bools, groups: tuple[Ints, Ints],
    noise: float,
) -> Problem:  # fmt: skip
    """Build the normal equations of recordings that are compared with landmarks; groups are folds.

    Kernels (M,n,m) are of recordings with landmarks, `landmarks` (M,m,m) those of landmarks with
    each other, truth (n,P), groups the folds (n,), rising, and the objects (n,).
    """
    folds, objects = groups
    names, starts = np.unique(folds, return_index=True)
    starts = np.append(starts, len(folds))
    _, place, sizes = np.unique(objects, return_inverse=True, return_counts=True)
    targets = np.ascontiguousarray(np.where(truth, 1.0, -1.0).T)
    (n_modalities, _, m), k = kernels.shape, len(names)
    features = np.empty(kernels.shape)
    grams = np.zeros((n_modalities, 1 + k, m, m))  # of all features + noise, and of each fold
    products = np.zeros((n_modalities, 1 + k, m, len(targets)))  # with the targets, the same
    duals = np.empty((n_modalities, len(targets), m))
    for i in range(n_modalities):
        factor = np.linalg.cholesky(landmarks[i] + _JITTER * np.trace(landmarks[i]) * np.eye(m))
        features[i] = solve_triangular(factor, kernels[i].T, lower=True, check_finite=False).T
        for fold, (start, end) in enumerate(pairwise(starts), start=1):
            part = features[i, start:end]
            grams[i, fold], products[i, fold] = part.T @ part, part.T @ targets[:, start:end].T
        grams[i, 0] = grams[i].sum(axis=0) + noise * np.eye(m)
        products[i, 0] = products[i].sum(axis=0)
        (weights,) = _ridge_weights(grams[i : i + 1], products[i : i + 1], names[:0])
        duals[i] = solve_triangular(factor.T, weights, check_finite=False).T

    def score(left_out: Ints, rows: Ints, nested: bool) -> tuple[Floats, Floats]:
        decisions = np.zeros((n_modalities, *targets.shape))
        for fold in np.setdiff1d(np.arange(k), left_out):
            others = slice(starts[fold], starts[fold + 1])
            out = np.append(left_out if nested else [], fold).astype(np.int64)
            decisions[:, :, others] = decide(out, features[:, others])
        return decide(left_out, features[:, rows]), decisions

    def decide(left_out: Ints, some: Floats) -> Floats:
        return np.asarray((some @ _ridge_weights(grams, products, left_out)).transpose(0, 2, 1))

    return Problem(names, starts, 2.0 / sizes[place.ravel()], targets, duals, score)


def _ridge_weights(grams: Floats, products: Floats, left_out: Ints) -> Floats:
    """Solve the normal equations of each modality without some folds, (M,m,P)."""
    weights = np.empty((len(grams), *products.shape[2:]))
    for i, (gram, product) in enumerate(zip(grams, products, strict=True)):
        matrix = gram[0].copy()
        for fold in left_out:
            matrix -= gram[1 + fold]
        factor = cho_factor(matrix.T, lower=True, overwrite_a=True, check_finite=False)
        rest = product[0] - product[1 + left_out].sum(axis=0)
        weights[i] = cho_solve(factor, rest, check_finite=False)
    return weights


class LeftOut(NamedTuple):
    """Stackers that never saw some sets S of groups, and their log-odds on these groups.

    Weights (S,P,1+M) are intercept and slopes, log-odds (P,q) of each set's recordings in the order
    of `Problem.rows`, losses (S,P) those on the decisions it learned from, ridge included.
    """

    weights: Floats
    log_odds: list[Floats]
    losses: Floats


def stacker_options(settings: PerceptionSettings) -> tuple[float, bool, bool]:
    """Return ridge, nonnegative and balanced, as the kernels take them."""
    return RIDGE, settings.nonnegative, settings.balanced


def leave_out(
    problem: Problem, sets: Ints, settings: PerceptionSettings, warm: Floats | None = None
) -> LeftOut:
    """Fit stackers without each of the sets (S,s) of groups, numbered as in the problem.

    `warm` (P,1+M) is where the search starts; the optimum is unique.
    """
    n_modalities, n_targets, _ = problem.duals.shape
    weights = np.zeros((len(sets), n_targets, 1 + n_modalities))
    losses = np.zeros((len(sets), n_targets))
    log_odds = []
    for index, left_out in enumerate(np.asarray(sets, dtype=np.int64)):
        rows, remaining = problem.rows(left_out), problem.weights.copy()
        held, decisions = problem.score(left_out, rows, settings.nested)
        remaining[rows] = 0.0
        if warm is not None:
            weights[index] = warm
        features, options = (
            np.ascontiguousarray(decisions.swapaxes(0, 1)),
            stacker_options(settings),
        )
        fit_stackers(remaining, features, problem.targets, *options, weights[index], losses[index])
        slopes = np.einsum("mpq,pm->pq", held, weights[index, :, 1:])
        log_odds.append(weights[index, :, :1] + slopes)
    return LeftOut(weights, log_odds, losses)


def each_group(
    problem: Problem, settings: PerceptionSettings, warm: Floats | None = None
) -> Floats:
    """Score every recording by classifiers and stackers that never saw its group, (n,P)."""
    sets = np.arange(len(problem.groups))[:, None]
    return np.concatenate(leave_out(problem, sets, settings, warm).log_odds, axis=1).T


def known_patterns(known: Bools) -> Iterator[tuple[Bools, Ints]]:
    """Group attributes by the rows whose label is known: (rows (n,), attributes) of `known` (n,P).

    Attributes of one group share their classifiers; where all labels are known there is one group.
    """
    patterns, group = np.unique(known, axis=1, return_inverse=True)
    for index in range(patterns.shape[1]):
        if patterns[:, index].any():
            yield patterns[:, index], np.flatnonzero(group.ravel() == index)

"""Kernel classifiers of many recordings: compared with landmarks, left out by folds of objects.

With m landmarks of kernel L L', a recording x has m features phi(x) = L^-1 k(x), whose products are
nearly its kernels (Nyström's approximation [Williams2001]). A ridge on them is a kernel ridge; its
normal equations are sums over folds, so leaving folds out subtracts theirs. All costs are linear in
the recordings, and as no more than three folds are ever left out together, those of refits depend
on their number alone.
"""

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from meal_bayes.perception.leave_out import Floats, Ints, Problem

_JITTER = 1e-9  # on the landmarks' kernel, where two of them are alike


def landmark_problem(
    kernels: Floats,
    landmarks: Floats,
    truth: NDArray[np.bool_],
    groups: tuple[Ints, Ints],
    noise: float,
) -> Problem:
    """Build the normal equations; groups are folds.

    Parameters
    ----------
    kernels : (M,n,m) of recordings with landmarks.
    landmarks : (M,m,m) of landmarks with each other.
    truth : (n,P).
    groups : (n,) folds, rising, and (n,) objects.
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
            own = features[i, start:end]
            grams[i, fold], products[i, fold] = own.T @ own, own.T @ targets[:, start:end].T
        grams[i, 0] = grams[i].sum(axis=0) + noise * np.eye(m)
        products[i, 0] = products[i].sum(axis=0)
        (weights,) = _ridge_weights(grams[i : i + 1], products[i : i + 1], names[:0])
        duals[i] = solve_triangular(factor.T, weights, check_finite=False).T

    def score(left_out: Ints, nested: bool) -> tuple[Floats, Floats]:
        decisions = np.zeros((n_modalities, *targets.shape))
        for fold in np.setdiff1d(np.arange(k), left_out):
            rows = slice(starts[fold], starts[fold + 1])
            out = np.append(left_out if nested else [], fold).astype(np.int64)
            decisions[:, :, rows] = decide(out, features[:, rows])
        return decide(left_out, features[:, problem.rows(left_out)]), decisions

    def decide(left_out: Ints, some: Floats) -> Floats:
        return np.asarray((some @ _ridge_weights(grams, products, left_out)).transpose(0, 2, 1))

    problem = Problem(names, starts, 2.0 / sizes[place.ravel()], targets, duals, score)
    return problem


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

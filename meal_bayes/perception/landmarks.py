"""Kernel classifiers of many recordings: compared with landmarks, left out by folds of objects.

With m landmarks of kernel L L', a recording x has m features phi(x) = L^-1 k(x), whose products are
nearly its kernels (Nyström's approximation [Williams2001]). A ridge on them is a kernel ridge; its
normal equations are sums over folds, so leaving folds out subtracts theirs. All costs are linear in
the recordings, and as no more than three folds are ever left out together, those of refits depend
on their number alone.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from meal_bayes.perception.leave_out import Floats, Ints, Problem

_JITTER = 1e-9  # on the landmarks' kernel, where two of them are alike


@dataclass(frozen=True, slots=True)
class LandmarkProblem(Problem):
    """The recordings are compared with landmarks; groups are folds.

    Attributes
    ----------
    features : (M,n,m).
    grams : (M,1+k,m,m) C = products of all features + noise, and the products of each fold.
    products : (M,1+k,m,P) products with the targets, of all and of each fold.
    """

    features: Floats
    grams: Floats
    products: Floats

    def score_without(self, left_out: Ints, *, nested: bool) -> tuple[Floats, Floats]:
        """Decide on groups; see `Problem`."""
        decisions = np.zeros((len(self.features), *self.targets.shape))
        for k in range(len(self.groups)):
            if k not in left_out:
                rows = slice(self.starts[k], self.starts[k + 1])
                out = np.append(left_out if nested else [], k).astype(np.int64)
                decisions[:, :, rows] = self._decide(out, rows)
        return self._decide(left_out, self.rows(left_out)), decisions

    def _decide(self, left_out: Ints, rows: Ints | slice) -> Floats:
        """Decide on rows (q,) by classifiers without some folds, (M,P,q)."""
        weights = _ridge_weights(self.grams, self.products, left_out)
        return np.asarray((self.features[:, rows] @ weights).transpose(0, 2, 1))


def landmark_problem(
    kernels: Floats,
    landmarks: Floats,
    truth: NDArray[np.bool_],
    groups: tuple[Ints, Ints],
    noise: float,
) -> LandmarkProblem:
    """Build the normal equations.

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
    grams = np.zeros((n_modalities, 1 + k, m, m))
    products = np.zeros((n_modalities, 1 + k, m, len(targets)))
    duals = np.empty((n_modalities, len(targets), m))
    for i in range(n_modalities):
        factor = np.linalg.cholesky(landmarks[i] + _JITTER * np.trace(landmarks[i]) * np.eye(m))
        features[i] = solve_triangular(factor, kernels[i].T, lower=True, check_finite=False).T
        for fold, (start, end) in enumerate(pairwise(starts)):
            own = features[i, start:end]
            grams[i, 1 + fold], products[i, 1 + fold] = own.T @ own, own.T @ targets[:, start:end].T
        grams[i, 0], products[i, 0] = (
            grams[i].sum(axis=0) + noise * np.eye(m),
            products[i].sum(axis=0),
        )
        (weights,) = _ridge_weights(grams[i : i + 1], products[i : i + 1], names[:0])
        duals[i] = solve_triangular(factor.T, weights, check_finite=False).T
    weights = 2.0 / sizes[place.ravel()]
    return LandmarkProblem(names, starts, weights, targets, duals, features, grams, products)


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

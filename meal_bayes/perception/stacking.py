"""The compiled core: leave-objects-out decisions and the stackers trained on them.

For a set S of left-out objects, every other object k is scored by kernel classifiers trained
without S and without k; a logistic regression (the stacker) learns from those decisions how to
pool the modalities, and is applied to the objects of S, scored by classifiers trained without S.
One kernel, three depths: S empty gives the stacker of a robot that has seen all objects, S = {o}
the held-out outputs on o, S = {o, o'} the training-side outputs of the tables for o and for o'.
"""

import numba
import numpy as np
from numpy.typing import NDArray

_TOLERANCE = 1e-9  # of the projected gradient, in units of total weight
_MAX_ITERATIONS = 60

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


@numba.njit(cache=True, nogil=True)
def cholesky_in_place(matrix: Floats) -> None:
    """Overwrite the lower triangle of a positive definite matrix by its Cholesky factor."""
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@numba.njit(cache=True, nogil=True)
def solve_in_place(factor: Floats, vector: Floats) -> None:
    """Overwrite a vector by the solution of L L' x = vector, L lower triangular."""
    size = factor.shape[0]
    for i in range(size):
        total = vector[i]
        for j in range(i):
            total -= factor[i, j] * vector[j]
        vector[i] = total / factor[i, i]
    for i in range(size - 1, -1, -1):
        total = vector[i]
        for j in range(i + 1, size):
            total -= factor[j, i] * vector[j]
        vector[i] = total / factor[i, i]


@numba.njit(cache=True, nogil=True, fastmath=True)
def _loss(z: Floats, target: Floats, weight: Floats, rate: Floats) -> float:
    """Weighted logistic loss; writes P(true) of each sample into `rate`."""
    total = 0.0
    for i in range(len(z)):
        small = np.exp(-abs(z[i]))
        likely = 1.0 / (1.0 + small)
        rate[i] = likely if z[i] > 0 else 1.0 - likely
        wrong = z[i] * target[i] < 0
        total += weight[i] * (np.log1p(small) + (abs(z[i]) if wrong else 0.0))
    return total


@numba.njit(cache=True, nogil=True, fastmath=True)
def _scores(theta: Floats, features: Floats, z: Floats) -> None:
    z[:] = theta[0]
    for m in range(features.shape[0]):
        if theta[m + 1] != 0.0:
            for i in range(len(z)):
                z[i] += theta[m + 1] * features[m, i]


@numba.njit(cache=True, nogil=True, fastmath=True)
def _derivatives(
    theta: Floats,
    features: Floats,
    target: Floats,
    weight: Floats,
    rate: Floats,
    ridge: float,
    gradient: Floats,
    hessian: Floats,
    scratch: Floats,
) -> None:
    """Gradient and Hessian (lower triangle); `scratch` (2,n) holds residuals and curvatures."""
    n_features, n = features.shape
    residual, curvature = scratch[0], scratch[1]
    first, second = 0.0, 0.0
    for i in range(n):
        residual[i] = weight[i] * (rate[i] - (1.0 if target[i] > 0 else 0.0))
        curvature[i] = weight[i] * rate[i] * (1.0 - rate[i])
        first += residual[i]
        second += curvature[i]
    gradient[0], hessian[0, 0] = first, second
    for m in range(n_features):
        first, second = 0.0, 0.0
        for i in range(n):
            first += residual[i] * features[m, i]
            second += curvature[i] * features[m, i]
        gradient[m + 1] = first + ridge * theta[m + 1]
        hessian[m + 1, 0] = second
        for other in range(m + 1):
            second = 0.0
            for i in range(n):
                second += curvature[i] * features[m, i] * features[other, i]
            hessian[m + 1, other + 1] = second
        hessian[m + 1, m + 1] += ridge


@numba.njit(cache=True, nogil=True)
def _newton_step(
    theta: Floats, gradient: Floats, hessian: Floats, nonnegative: bool, step: Floats
) -> float:
    """Newton step of the free coordinates; the largest free gradient is returned.

    A slope at zero whose gradient would push it below stays there (Bertsekas' active set).
    """
    free = np.empty(len(theta), np.int64)
    size, largest = 0, 0.0
    for j in range(len(theta)):
        if not (nonnegative and j > 0 and theta[j] <= 0.0 and gradient[j] > 0.0):
            free[size] = j
            size += 1
            largest = max(largest, abs(gradient[j]))
    part, vector = np.empty((size, size)), np.empty(size)
    for i in range(size):
        vector[i] = -gradient[free[i]]
        for j in range(i + 1):
            part[i, j] = hessian[free[i], free[j]]
        part[i, i] += 1e-12
    cholesky_in_place(part)
    solve_in_place(part, vector)
    step[:] = 0.0
    for i in range(size):
        step[free[i]] = vector[i]
    return largest


@numba.njit(cache=True, nogil=True)
def _penalty(theta: Floats, ridge: float) -> float:
    total = 0.0
    for j in range(1, len(theta)):
        total += theta[j] * theta[j]
    return 0.5 * ridge * total


@numba.njit(cache=True, nogil=True)
def fit_stacker(
    features: Floats,
    target: Floats,
    weight: Floats,
    ridge: float,
    nonnegative: bool,
    theta: Floats,
) -> None:
    """Logistic regression with ridge on the slopes, by projected Newton from `theta`, in place.

    `features` (M,n), `target` (n,) of +-1, `weight` (n,), `theta` (1+M,) intercept first. With
    `nonnegative` no slope falls below zero.
    """
    n = features.shape[1]
    size = len(theta)
    z, rate, scratch = np.empty(n), np.empty(n), np.empty((2, n))
    gradient, hessian = np.empty(size), np.empty((size, size))
    step, trial = np.empty(size), np.empty(size)
    tolerance = _TOLERANCE * weight.sum()
    _scores(theta, features, z)
    value = _loss(z, target, weight, rate) + _penalty(theta, ridge)
    for _ in range(_MAX_ITERATIONS):
        _derivatives(theta, features, target, weight, rate, ridge, gradient, hessian, scratch)
        if _newton_step(theta, gradient, hessian, nonnegative, step) < tolerance:
            return
        length = 1.0
        for _ in range(_MAX_ITERATIONS):
            for j in range(size):
                trial[j] = theta[j] + length * step[j]
                if nonnegative and j > 0:
                    trial[j] = max(trial[j], 0.0)
            _scores(trial, features, z)
            new = _loss(z, target, weight, rate) + _penalty(trial, ridge)
            if new <= value + 1e-13 * abs(value):
                break
            length *= 0.5
        theta[:] = trial
        value = new


@numba.njit(cache=True, nogil=True)
def _weigh(
    target: Floats, starts: Ints, left_out: Ints, balanced: bool, weight: Floats
) -> bool:
    """Weigh recordings 2/R and classes n/(2 n_c), left-out and unknown ones 0.

    Returns whether both classes are there.
    """
    mass = np.zeros(2)
    for k in range(len(starts) - 1):
        rows = starts[k + 1] - starts[k]
        out = (left_out == k).any()
        for i in range(starts[k], starts[k + 1]):
            weight[i] = 0.0 if out or target[i] == 0 else 2.0 / rows
            mass[1 if target[i] > 0 else 0] += weight[i]
    if mass[0] == 0 or mass[1] == 0:
        return False
    if balanced:
        for i in range(len(target)):
            weight[i] *= (mass[0] + mass[1]) / (2.0 * mass[1 if target[i] > 0 else 0])
    return True


@numba.njit(cache=True, nogil=True, fastmath=True)
def _forget_objects(
    inverse: Floats,
    dual: Floats,
    target: Floats,
    starts: Ints,
    left_out: Ints,
    rows: Ints,
    nested: bool,
    own: Floats,
    decisions: Floats,
) -> None:
    """Score S (`own` (P,q)) without S, and every other object k (`decisions` (P,n)) without S, k.

    `inverse` (n,n) is C^-1, C = gram + noise; `dual` (P,n) is C^-1 y. Leaving G out, the decision
    on G is y_G - inv(C^-1[G,G]) (C^-1 y)_G. Here G = S + {k}, solved for k's part by a Schur
    complement, as S is shared by all k. Without `nested`, k is scored by classifiers that saw S.
    """
    q, n, n_targets = len(rows), inverse.shape[0], dual.shape[0]
    factor = np.empty((q, q))
    for i in range(q):
        for j in range(i + 1):
            factor[i, j] = inverse[rows[i], rows[j]]
    cholesky_in_place(factor)
    across, known = np.empty((q, n)), np.empty((n_targets, q))  # L^-1 C^-1[S,:],  L^-1 (C^-1 y)_S
    for i in range(q):
        across[i] = inverse[rows[i]]
        for j in range(i):
            for c in range(n):
                across[i, c] -= factor[i, j] * across[j, c]
        for c in range(n):
            across[i, c] /= factor[i, i]
    for p in range(n_targets):
        for i in range(q):
            total = dual[p, rows[i]]
            for j in range(i):
                total -= factor[i, j] * known[p, j]
            known[p, i] = total / factor[i, i]
        for i in range(q - 1, -1, -1):
            total = known[p, i]
            for j in range(i + 1, q):
                total -= factor[j, i] * (target[p, rows[j]] - own[p, j])
            own[p, i] = target[p, rows[i]] - total / factor[i, i]
    if not nested:
        across[:] = 0.0
    for p in range(n_targets):
        decisions[p] = dual[p]
        for i in range(q):
            for c in range(n):
                decisions[p, c] -= known[p, i] * across[i, c]
    for k in range(len(starts) - 1):
        begin, end = starts[k], starts[k + 1]
        size = end - begin
        if (left_out == k).any():
            decisions[:, begin:end] = 0.0
            continue
        block, vector = np.empty((size, size)), np.empty(size)
        for i in range(size):
            for j in range(i + 1):
                total = inverse[begin + i, begin + j]
                for s in range(q):
                    total -= across[s, begin + i] * across[s, begin + j]
                block[i, j] = total
        cholesky_in_place(block)
        for p in range(n_targets):
            for i in range(size):
                vector[i] = decisions[p, begin + i]
            solve_in_place(block, vector)
            for i in range(size):
                decisions[p, begin + i] = target[p, begin + i] - vector[i]


@numba.njit(cache=True, nogil=True)
def stack_without(
    sets: Ints,
    inverses: Floats,
    duals: Floats,
    targets: Floats,
    starts: Ints,
    ridge: float,
    nonnegative: bool,
    balanced: bool,
    nested: bool,
    warm: Floats,
    weights: Floats,
    outputs: Floats,
) -> None:
    """Fit the stackers of each set S of left-out objects and apply them to S.

    Parameters
    ----------
    sets : (S,s) the left-out objects of each set.
    inverses, duals : (M,n,n), (M,P,n) C^-1 and C^-1 y of each modality.
    targets : (P,n) +-1, or 0 where the label is unknown.
    starts : (O+1,) where each object's rows start.
    ridge, nonnegative, balanced, nested : see `PerceptionSettings`.
    warm : (P,1+M) where Newton's method starts.
    weights : (S,P,1+M), written: intercept and slopes; zero where a class is missing.
    outputs : (S,P,s,R), written: log-odds of the recordings of S, R the most an object has.
    """
    n_modalities, n_targets, n = duals.shape
    width = sets.shape[1]
    features, chosen = np.empty((n_modalities, n_targets, n)), np.empty((n_modalities, n))
    weight = np.empty(n)
    for index in range(len(sets)):
        rows = np.empty(0, np.int64)
        for k in sets[index]:
            rows = np.concatenate((rows, np.arange(starts[k], starts[k + 1])))
        own = np.empty((n_modalities, n_targets, len(rows)))
        for m in range(n_modalities):
            _forget_objects(
                inverses[m], duals[m], targets, starts, sets[index], rows, nested, own[m], features[m]
            )
        for p in range(n_targets):
            theta = weights[index, p]
            outputs[index, p] = 0.0
            if not _weigh(targets[p], starts, sets[index], balanced, weight):
                theta[:] = 0.0
                continue
            theta[:] = warm[p]
            for m in range(n_modalities):
                chosen[m] = features[m, p]
            fit_stacker(chosen, targets[p], weight, ridge, nonnegative, theta)
            row = 0
            for j in range(width):
                k = sets[index, j]
                for r in range(starts[k + 1] - starts[k]):
                    total = theta[0]
                    for m in range(n_modalities):
                        total += theta[m + 1] * own[m, p, row]
                    outputs[index, p, j, r] = total
                    row += 1

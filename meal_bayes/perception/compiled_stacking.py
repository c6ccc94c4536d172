"""Compiled kernels: decisions with groups left out, and the stackers that are trained on them.

For a set S of left-out groups, every other group k is scored by kernel classifiers without S and k.
A logistic regression (the stacker) learns from these decisions how to combine the modalities. It is
applied to the groups of S, which are scored by classifiers without S. An empty S gives the stacker
of all groups, S = {o} the held-out outputs on o, and S = {o, o'} the training-side outputs of
percept tables for o and for o'.
"""

from functools import partial

import numpy as np

from meal_bayes.arrays import Floats, Ints
from meal_bayes.cache import compile_kernel

_TOLERANCE = 1e-9  # tolerance of the projected gradient, in units of the total weight
_MAX_ITERATIONS = 60
_JITTER = 1e-12  # keeps the Hessian invertible if all decisions agree

_kernel = partial(compile_kernel, nogil=True, error_model="numpy")


@_kernel
def _factorize(matrix):
    """Overwrite the lower triangle of a positive definite matrix by its Cholesky factor."""
    for i in range(matrix.shape[0]):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]


@_kernel
def _solve_lower(factor, vector):
    """Overwrite a vector by the solution of L x = vector."""
    for i in range(factor.shape[0]):
        total = vector[i]
        for j in range(i):
            total -= factor[i, j] * vector[j]
        vector[i] = total / factor[i, i]


@_kernel
def _solve_upper(factor, vector):
    """Overwrite a vector by the solution of L' x = vector."""
    for i in range(factor.shape[0] - 1, -1, -1):
        total = vector[i]
        for j in range(i + 1, factor.shape[0]):
            total -= factor[j, i] * vector[j]
        vector[i] = total / factor[i, i]


@partial(_kernel, fastmath=True)
def _objective(theta, features, target, weight, ridge, rate):
    """Return weighted logistic loss and ridge; write P(true) of each sample into `rate`."""
    # sum_i w_i log(1 + exp(-y_i z_i)) + ridge / 2 sum_{m>0} theta_m^2
    total = 0.0
    # z = theta_0 + sum_m theta_m x_m, in `rate` until it is P(true)
    for i in range(len(rate)):
        rate[i] = theta[0]
    for m in range(features.shape[0]):
        total += 0.5 * ridge * theta[m + 1] * theta[m + 1]
        if theta[m + 1] != 0.0:
            for i in range(len(rate)):
                rate[i] += theta[m + 1] * features[m, i]
    for i in range(len(rate)):
        z = rate[i]
        # log(1 + exp(-y z)) = log(1 + exp(-|z|)) + (|z| if y z < 0), which never overflows
        small = np.exp(-abs(z))
        rate[i] = 1.0 / (1.0 + small) if z > 0 else small / (1.0 + small)
        total += weight[i] * (np.log1p(small) + (abs(z) if z * target[i] < 0 else 0.0))
    return total


@partial(_kernel, fastmath=True)
def _derivatives(theta, features, target, weight, ridge, rate, gradient, hessian):
    """Compute gradient and Hessian (lower triangle) of the objective, in place."""
    n_features, n = features.shape
    scratch = np.empty((2, n))  # residuals w (p - y) and curvatures w p (1 - p)
    first = 0.0
    second = 0.0
    # g_0 = sum_i w (p - y), H_00 = sum_i w p (1 - p); the slopes' below weigh these by x_m.
    for i in range(n):
        scratch[0, i] = weight[i] * (rate[i] - (1.0 if target[i] > 0 else 0.0))
        scratch[1, i] = weight[i] * rate[i] * (1.0 - rate[i])
        first += scratch[0, i]
        second += scratch[1, i]
    gradient[0] = first
    hessian[0, 0] = second
    for m in range(n_features):
        first = 0.0
        second = 0.0
        for i in range(n):
            first += scratch[0, i] * features[m, i]
            second += scratch[1, i] * features[m, i]
        gradient[m + 1] = first + ridge * theta[m + 1]
        hessian[m + 1, 0] = second
        # H_mk = sum_i w p (1 - p) x_m x_k, and the ridge on the diagonal
        for other in range(m + 1):
            second = 0.0
            for i in range(n):
                second += scratch[1, i] * features[m, i] * features[other, i]
            hessian[m + 1, other + 1] = second
        hessian[m + 1, m + 1] += ridge


@_kernel
def _newton_step(theta, gradient, hessian, nonnegative, step):
    """Solve the Newton step H d = -g, overwriting the Hessian; return the largest free gradient.

    A slope at zero whose gradient would make it negative stays at zero (Bertsekas' active set): its
    row and column become those of the identity. The Cholesky factorization above is used, because
    LAPACK took two to four times as long for so few coordinates.
    """
    largest = 0.0
    # The quadratic model H d = -g, without the slopes that are held at zero.
    for j in range(len(theta)):
        step[j] = -gradient[j]
        if nonnegative and j > 0 and theta[j] <= 0.0 and gradient[j] > 0.0:
            for k in range(len(theta)):
                hessian[j, k] = hessian[k, j] = 0.0
            step[j] = 0.0
            hessian[j, j] = 1.0
        else:
            largest = max(largest, abs(gradient[j]))
        hessian[j, j] += _JITTER
    _factorize(hessian)
    _solve_lower(hessian, step)
    _solve_upper(hessian, step)
    return largest


@_kernel
def fit_stacker(
    features: Floats, target: Floats, weight: Floats, ridge: float, nonnegative: bool, theta: Floats
) -> float:
    """Fit a logistic regression with ridge on the slopes, by projected Newton from `theta`.

    `features` is (M,n), `target` (n,) with +-1, `weight` (n,), and `theta` (1+M,), the intercept
    first, which is overwritten. If `nonnegative`, slopes are at least 0. Returns the loss with the
    ridge.
    """
    size = len(theta)
    rate = np.empty(len(target))
    gradient = np.empty(size)
    hessian = np.empty((size, size))
    step = np.empty(size)
    trial = np.empty(size)
    value = _objective(theta, features, target, weight, ridge, rate=rate)
    # Far from the optimum, a whole Newton step may overshoot and is then halved.
    for _ in range(_MAX_ITERATIONS):
        _derivatives(
            theta, features, target, weight, ridge, rate=rate, gradient=gradient, hessian=hessian
        )
        if _newton_step(theta, gradient, hessian, nonnegative, step) < _TOLERANCE * weight.sum():
            break
        length = 1.0
        for _ in range(_MAX_ITERATIONS):  # halve until the loss does not increase
            for j in range(size):
                trial[j] = theta[j] + length * step[j]
                # The projection: a slope that would become negative is set to 0.
                if nonnegative and j > 0 and trial[j] < 0.0:
                    trial[j] = 0.0
            trial_value = _objective(trial, features, target, weight, ridge, rate=rate)
            if trial_value <= value + 1e-13 * abs(value):
                break
            length *= 0.5
        value = trial_value
        for j in range(size):
            theta[j] = trial[j]
    return float(value)


@_kernel
def _weigh(target, base, balanced, weight):
    """Write `base` times n/(2 n_c) for class c to `weight`; return whether both classes occur."""
    # n_c, the weight of each class
    positive = 0.0
    negative = 0.0
    for i in range(len(target)):
        positive += base[i] if target[i] > 0 else 0.0
        negative += base[i] if target[i] < 0 else 0.0
    # Both classes then have the weight n/2, so the intercept does not contain the base rate.
    for i in range(len(target)):
        class_weight = positive if target[i] > 0 else negative
        balance = (positive + negative) / (2.0 * class_weight) if balanced else 1.0
        weight[i] = base[i] * balance
    return positive > 0.0 and negative > 0.0


@partial(_kernel, fastmath=True)
def _leave_set(inverse, dual, target, rows, held, across, whitened):
    """Score the rows of S by classifiers without S, and prepare `_score_others`.

    If G is left out, the decision on G is y_G - inv(C^-1[G,G]) (C^-1 y)_G. Writes these decisions
    for S to `held` (P,q). With L L' = C^-1[S,S], it also writes `across` (q,n) = L^-1 C^-1[S,:] and
    `whitened` (P,q) = L^-1 (C^-1 y)_S.
    """
    q, n = across.shape
    # L L' = C^-1[S,S]
    factor = np.empty((q, q))
    for i in range(q):
        for j in range(i + 1):
            factor[i, j] = inverse[rows[i], rows[j]]
    _factorize(factor)
    for i in range(q):  # forward substitution, all columns at once
        # across = L^-1 C^-1[S,:]
        for c in range(n):
            across[i, c] = inverse[rows[i], c]
        for j in range(i):
            for c in range(n):
                across[i, c] -= factor[i, j] * across[j, c]
        for c in range(n):
            across[i, c] /= factor[i, i]
    # whitened = L^-1 (C^-1 y)_S; then the decision y_S - C^-1[S,S]^-1 (C^-1 y)_S by back
    # substitution.
    for p in range(len(dual)):
        for i in range(q):
            whitened[p, i] = dual[p, rows[i]]
        _solve_lower(factor, whitened[p])
        for i in range(q):
            held[p, i] = whitened[p, i]
        _solve_upper(factor, held[p])
        for i in range(q):
            held[p, i] = target[p, rows[i]] - held[p, i]


@partial(_kernel, fastmath=True)
def _score_others(inverse, dual, target, starts, out, across, whitened, decisions):
    """Score every other object k without S and k; write `decisions` (P,n), which are 0 on S.

    This is the formula of `_leave_set` for G = S + {k}. The part of k is solved by a Schur
    complement, because all k share S.
    """
    q = len(across)
    # (C^-1 y)_k - C^-1[k,S] C^-1[S,S]^-1 (C^-1 y)_S: the right side of k's part
    for p in range(len(dual)):
        for c in range(dual.shape[1]):
            decisions[p, c] = dual[p, c]
        for i in range(q):
            for c in range(dual.shape[1]):
                decisions[p, c] -= whitened[p, i] * across[i, c]
    # k's matrix, the Schur complement: C^-1[k,k] - C^-1[k,S] C^-1[S,S]^-1 C^-1[S,k]
    for k in range(len(out)):
        begin = starts[k]
        size = starts[k + 1] - starts[k]
        block = np.empty((size, size))
        vector = np.empty(size)
        for i in range(size):
            for j in range(i + 1):
                total = inverse[begin + i, begin + j]
                for s in range(q):
                    total -= across[s, begin + i] * across[s, begin + j]
                # For an object of S itself there is nothing to solve, so use the identity.
                block[i, j] = 1.0 * (i == j) if out[k] else total
        _factorize(block)
        for p in range(len(dual)):
            for i in range(size):
                vector[i] = decisions[p, begin + i]
            _solve_lower(block, vector)
            _solve_upper(block, vector)
            for i in range(size):
                decisions[p, begin + i] = 0.0 if out[k] else target[p, begin + i] - vector[i]


@_kernel
def score_without(
    left_out: Ints,
    rows: Ints,
    inverses: Floats,
    duals: Floats,
    targets: Floats,
    starts: Ints,
    nested: bool,
) -> tuple[Floats, Floats]:
    """Compute decisions of classifiers without S on S, and on each other object k without k.

    S are the objects `left_out` (s,), with the rows `rows` (q,). `inverses` (M,n,n) and `duals`
    (M,P,n) are C^-1 and C^-1 y for each kernel, where C = gram + noise. `targets` (P,n) are +-1.
    The rows of each object begin at `starts` (O+1,). If `nested`, object k is scored without S and
    k, and otherwise only without k. Returns the decisions on the rows of S, (M,P,q), and on the
    other rows, (M,P,n), which are 0 on S.
    """
    n_kernels, n_targets, n = duals.shape
    held = np.empty((n_kernels, n_targets, len(rows)))
    decisions = np.empty(duals.shape)
    out = np.zeros(len(starts) - 1, np.int64)
    for k in left_out:
        out[k] = 1
    across = np.empty((len(rows), n))
    whitened = np.empty((n_targets, len(rows)))
    shared = len(rows) if nested else 0
    for m in range(n_kernels):
        _leave_set(
            inverses[m], duals[m], targets, rows, held=held[m], across=across, whitened=whitened
        )
        _score_others(
            inverses[m],
            duals[m],
            targets,
            starts,
            out,
            across=across[:shared],
            whitened=whitened,
            decisions=decisions[m],
        )
    return held, decisions


@_kernel
def fit_stackers(
    base: Floats,
    decisions: Floats,
    targets: Floats,
    ridge: float,
    nonnegative: bool,
    balanced: bool,
    weights: Floats,
    losses: Floats,
) -> None:
    """Fit a stacker for each attribute on decisions (P,M,n); `base` (n,) weights recordings.

    Recordings that are left out have the weight 0. Newton's method starts from `weights` (P,1+M),
    intercepts and slopes, and overwrites them with the result; it also writes the losses (P,). Both
    are zero if only one class occurs.
    """
    weight = np.empty(len(base))
    for p in range(len(targets)):
        if _weigh(targets[p], base, balanced, weight):
            losses[p] = fit_stacker(
                decisions[p], targets[p], weight, ridge, nonnegative, theta=weights[p]
            )
        else:
            losses[p] = 0.0
            for j in range(weights.shape[1]):
                weights[p, j] = 0.0

"""How much objects differ: object-level Dirichlet-multinomial, exact hierarchical Bayes on a grid.

Repeated percepts of one object are not independent given the attribute, as Eq. 8 takes them to be:
each object has its own row theta ~ Dirichlet(s m), m the mean row and s the dispersion of one
(attribute, behavior, truth). With c_ok percepts of object o at level k and n_o in all, the rising
factorials of the Dirichlet-multinomial make its log-likelihood

    sum_k sum_i #{o: c_ok > i} ln(s m_k + i)  -  sum_i #{o: n_o > i} ln(s + i),

which is linear in the tail counts. So one matrix product scores a whole grid of (m, s), whatever
the numbers of recordings, for all rows of all held-out folds at once.

The attributes of a behavior share what they say, for each truth alone: of s by ln s ~
Normal(mu, tau) over them, mu and tau integrated out on a grid; of m, for yes/no, by a common
Dirichlet prior w mu, learned by its marginal likelihood. Pairs that say nothing (TPR <= FPR) have
no vote.

Graded percepts (K > 2) share more than that: a level is a range of class-balanced log-odds, so it
speaks about equally strongly whatever the behavior and attribute. The prior of their rows is the
pair's own use of the levels, tilted to either truth by what each level is worth over all pairs, at
the weight of 32 percepts: of the powers of two, the one by which the rows learned without an object
predict its percepts best (ROC36 and ISPY32 32, CY101 128, flat around).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln, logsumexp

from meal_bayes.errors import SettingsError

Array = NDArray[np.float64]

PRIOR_WEIGHT = 2.0  # of a row before any percept: 1 a cell for yes/no
_GRID = np.geomspace(0.05, 1000.0, 29)  # of s; at 1000 ten percepts are as good as independent
_TAU = np.array([0.25, 0.5, 1.0, 2.0])  # spread of ln s over attributes, half-normal(1) a priori
_GRADED = 32.0  # weight of the prior of m where percepts are graded
_WEIGHTS = np.geomspace(0.125, 64.0, 19)  # of the prior of m; ln w ~ Normal(ln 2, 1) a priori
_CENTER = 1.5  # log-odds about which the points of m spread out
_BLOCK = 4_000_000  # grid points scored at a time, 32 MB
_TINY = 1e-300


class DispersionFit(NamedTuple):
    """The posterior of the rows' hyperparameters, summed up."""

    prior: Array  # (...,P,E,2,K) Dirichlet parameters of m before any percept
    mean: Array  # (...,P,E,2,K) posterior mean of m
    dispersion: Array  # (...,P,E,2) s, the number that keeps the posterior mean of 1 / (s + 1)
    weight: Array  # (...,P,E,2) A: prior weight + independent percepts that the data are worth


class _Rows(NamedTuple):
    """The sufficient statistics of S rows."""

    tails: Array  # (S,K,I) #{o: c_ok > i}
    sums: Array  # (S,J) #{o: n_o > j}
    sizes: Array  # (U,) distinct n_o
    totals: Array  # (S,U,K) counts of the objects of each size


class _Profile(NamedTuple):
    """What the rows say at each s of the grid, m integrated out."""

    log_evidence: Array  # (S,G)
    mean: Array  # (S,G,K) E m
    spread: Array  # (S,G) E[1 - sum_k m_k^2]


def fit_dispersion(counts: ArrayLike, prior: ArrayLike | None = None) -> DispersionFit:
    """Fit every row of every fold.

    `dispersion` keeps the predictive of a second percept equal to the first, E[theta^2] / E[theta],
    which depends on s by 1 / (s + 1). Two levels are integrated exactly; with more, m given s is
    Dirichlet about the effective counts.

    Parameters
    ----------
    counts : (...,O,P,E,2,K) percepts of each object; objects without any in a row tell nothing.
    prior : (P,E,2,K) Dirichlet parameters of m, or what broadcasts to it; learned by default.
    """
    per_object = np.moveaxis(np.asarray(counts), -5, -2)  # (...,P,E,2,O,K)
    if per_object.size == 0 or (per_object < 0).any() or (per_object % 1).any():
        raise SettingsError(
            "Object-level counts must be whole numbers >= 0 of at least one object."
        )
    shape, levels = per_object.shape[:-2], per_object.shape[-1]  # (...,P,E,2)
    rows = _statistics(per_object.reshape(-1, *per_object.shape[-2:]))
    votes = youden(rows.totals.sum(axis=1).reshape(*shape, levels)) > 0  # (...,P,E)
    if prior is None:
        flat = np.full((len(rows.sums), levels), PRIOR_WEIGHT / levels)
        _, s = _posterior(_approximate(rows, flat), votes)
        learn = _learn_prior if levels == 2 else _graded_prior
        alpha = learn(_effective(rows, s).reshape(*shape, levels), votes)
    else:
        alpha = np.asarray(prior, dtype=float)
    alpha = np.broadcast_to(alpha, (*shape, levels)).reshape(-1, levels)
    profile = _integrate(rows, alpha) if levels == 2 else _approximate(rows, alpha)
    mean, dispersion = _posterior(profile, votes)
    weight = (alpha + _effective(rows, dispersion)).sum(axis=-1)
    return DispersionFit(
        alpha.reshape(*shape, levels),
        mean.reshape(*shape, levels),
        dispersion.reshape(shape),
        weight.reshape(shape),
    )


def youden(counts: Array) -> Array:
    """Give TPR - FPR (...,P,E) of counts (...,P,E,2,K); the upper half of the levels says "true".

    It is 0 where a truth has no percept.
    """
    total = counts.sum(axis=-1)
    positive = counts[..., counts.shape[-1] // 2 :].sum(axis=-1)
    rates = positive / np.where(total > 0, total, 1.0)
    return np.where((total > 0).all(axis=-1), rates[..., 1] - rates[..., 0], 0.0)


def _statistics(counts: NDArray[np.int64]) -> _Rows:
    n = counts.sum(axis=-1)  # (S,O)
    sizes = np.unique(n[n > 0])
    totals = np.zeros((len(counts), len(sizes), counts.shape[-1]))
    for u, size in enumerate(sizes):
        totals[:, u] = (counts * (n == size)[..., None]).sum(axis=1)
    return _Rows(_tails(counts), _tails(n[..., None])[:, 0], sizes.astype(float), totals)


def _tails(counts: NDArray[np.int64]) -> Array:
    top = max(int(counts.max()), 1)
    return np.stack([(counts > i).sum(axis=1) for i in range(top)], axis=-1).astype(float)


def _effective(rows: _Rows, s: Array) -> Array:
    """Weigh the counts by s (S,...) to (S,...,K), as n of one object are worth n(s+1)/(n+s)."""
    worth = (s[..., None] + 1) / (rows.sizes + s[..., None])  # (S,...,U)
    return np.asarray(np.einsum("s...u,suk->s...k", worth, rows.totals))


def _integrate(rows: _Rows, alpha: Array) -> _Profile:
    """Two levels: a sum over m at every s, one matrix product for all grid points."""
    m, log_width = _nodes(float(rows.totals.sum(axis=(1, 2)).max()))
    nodes = m.shape[1]
    i, j = np.arange(rows.tails.shape[-1]), np.arange(rows.sums.shape[-1])
    each = np.log(_GRID[:, None] * m[:, None, None] + i[:, None, None])  # (2,I,G,M)
    total = np.broadcast_to(-np.log(_GRID + j[:, None])[..., None], (len(j), len(_GRID), nodes))
    ends = np.broadcast_to(np.log(m)[:, None], (2, len(_GRID), nodes))
    # Single precision takes half the time and changes the fit by less than the grid does.
    widths = np.broadcast_to(log_width, (1, len(_GRID), nodes))
    basis = np.concatenate([*each, total, ends, widths], dtype=np.float32)
    basis = basis.reshape(-1, len(_GRID) * nodes)
    parts = [rows.tails[:, 0], rows.tails[:, 1], rows.sums, alpha, np.ones((len(alpha), 1))]
    features = np.concatenate(parts, axis=1, dtype=np.float32)
    moments = np.stack([np.ones(nodes), m[0], m[1], 2 * m[0] * m[1]], axis=1, dtype=np.float32)
    peak = np.empty((len(features), len(_GRID)))
    integrals = np.empty((*peak.shape, moments.shape[1]))
    step = max(1, _BLOCK // basis.shape[1])
    for start in range(0, len(features), step):
        block = slice(start, start + step)
        score = (features[block] @ basis).reshape(-1, len(_GRID), nodes)
        peak[block] = score.max(axis=-1)
        score -= peak[block, :, None]
        integrals[block] = np.exp(score, out=score) @ moments
    norm = integrals[..., 0]
    return _Profile(
        peak + np.log(norm), integrals[..., 1:3] / norm[..., None], integrals[..., 3] / norm
    )


def _nodes(largest: float) -> tuple[Array, Array]:
    """Points (m, 1 - m) (2,M) for a sum over m, and the logarithms of their widths in its log-odds.

    Log-odds spaced as a sinh: close in the middle, where rows of `largest` percepts are narrow;
    wide at the ends, which reach so far because learned priors may be nearly singular there.
    """
    step = np.clip(3.0 / (_CENTER * np.sqrt(max(largest, 1.0))), 0.01, 0.2)
    reach = np.arcsinh(80.0 / _CENTER)
    t = np.linspace(-reach, reach, 2 * int(np.ceil(reach / step)) + 1)
    log_odds = _CENTER * np.sinh(t)
    return expit(np.stack([-log_odds, log_odds])), np.log(np.cosh(t))


def _approximate(rows: _Rows, alpha: Array) -> _Profile:
    """More levels: m given s is Dirichlet about the effective counts.

    The evidence of s is likelihood x prior / posterior of m, taken at the posterior's mean.
    """
    grid = np.broadcast_to(_GRID, (len(alpha), len(_GRID)))
    after = alpha[:, None] + _effective(rows, grid)  # (S,G,K)
    weight = after.sum(axis=-1)
    mean = after / weight[..., None]
    score = -rows.sums @ np.log(_GRID + np.arange(rows.sums.shape[-1])[:, None])
    for i in range(rows.tails.shape[-1]):
        likelihood = np.log(_GRID[:, None] * mean + i)
        score += np.einsum("sk,sgk->sg", rows.tails[:, :, i], likelihood)
    score += _log_dirichlet(mean, alpha[:, None]) - _log_dirichlet(mean, after)
    return _Profile(score, mean, (1 - (mean**2).sum(axis=-1)) * weight / (weight + 1))


def _log_dirichlet(m: Array, alpha: Array) -> Array:
    kernel = ((alpha - 1) * np.log(m)).sum(axis=-1)
    return np.asarray(kernel + gammaln(alpha.sum(axis=-1)) - gammaln(alpha).sum(axis=-1))


def _posterior(profile: _Profile, votes: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Give mean (S,K) and s (S,), the attributes of a behavior pooled; votes (...,P,E)."""
    log_evidence = profile.log_evidence.reshape(*votes.shape, 2, -1)
    weight = _pool(log_evidence, votes).reshape(profile.log_evidence.shape)  # (S,G)
    mean = np.einsum("sg,sgk->sk", weight, profile.mean)
    spread = weight * profile.spread
    s = spread.sum(axis=1) / (spread @ (1 / (_GRID + 1))) - 1
    return mean / mean.sum(axis=1, keepdims=True), s


def _pool(log_evidence: Array, votes: NDArray[np.bool_]) -> Array:
    """Give the posterior over the s grid, (...,P,E,2,G)."""
    log_s = np.log(_GRID)
    centers, spreads = (a.ravel() for a in np.meshgrid(log_s, _TAU, indexing="ij"))
    share = np.exp(-0.5 * ((log_s - centers[:, None]) / spreads[:, None]) ** 2)  # (Q,G)
    share /= share.sum(axis=1, keepdims=True)
    own = np.exp(log_evidence - log_evidence.max(axis=-1, keepdims=True))  # (...,P,E,2,G)
    # A row without a vote still draws its own s, but tells nothing of mu and tau.
    by_hyper = np.where(votes[..., None, None], np.maximum(own @ share.T, _TINY), 1.0)  # (...,Q)
    hyper = np.log(by_hyper).sum(axis=-4, keepdims=True) - 0.5 * spreads**2
    hyper = np.exp(hyper - logsumexp(hyper, axis=-1, keepdims=True))
    weight = own * ((hyper / by_hyper) @ share)
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))


def _learn_prior(effective: Array, votes: NDArray[np.bool_]) -> Array:
    """Learn the Dirichlet prior of a behavior's mean rows, (...,1,E,2,K), from effective counts.

    Its mean is that of the attributes' rows and of one flat row; its weight maximizes the
    Dirichlet-multinomial likelihood of the effective counts (...,P,E,2,K).
    """
    levels, asked = effective.shape[-1], votes[..., None, None]
    n = effective.sum(axis=-1, keepdims=True)
    rows = (PRIOR_WEIGHT / levels + effective) / (PRIOR_WEIGHT + n)
    mean = (rows * asked).sum(axis=-4, keepdims=True) + 1 / levels
    mean /= asked.sum(axis=-4, keepdims=True) + 1
    alpha, counts = mean[..., None] * _WEIGHTS, effective[..., None]  # (...,1,E,2,K,W)
    score = (gammaln(alpha + counts) - gammaln(alpha)).sum(axis=-2)
    score += gammaln(_WEIGHTS) - gammaln(_WEIGHTS + n)
    score = (score * asked).sum(axis=-4, keepdims=True)  # (...,1,E,2,W)
    score -= 0.5 * np.log(_WEIGHTS / PRIOR_WEIGHT) ** 2
    return np.asarray(_WEIGHTS[score.argmax(axis=-1)][..., None] * mean)


def _graded_prior(effective: Array, votes: NDArray[np.bool_]) -> Array:
    """Make the Dirichlet prior of graded rows, (...,P,E,2,K), from effective counts.

    With q the balanced mean of a pair's two rows and r_k the ratio in which true and false objects
    show level k, over all pairs that say something: 2 q_k r_k / (1 + r_k) and 2 q_k / (1 + r_k).
    Pairs have the weight of their rarer truth.
    """
    levels, n = effective.shape[-1], effective.sum(axis=-1, keepdims=True)
    rows = (1 / levels + effective) / (1 + n)
    vote = n.min(axis=-2, keepdims=True) * votes[..., None, None]
    pooled = (rows * vote).sum(axis=(-4, -3), keepdims=True) + 1 / levels  # (...,1,1,2,K)
    worth = np.log(pooled[..., 1:, :]) - np.log(pooled[..., :1, :])
    used = rows.mean(axis=-2, keepdims=True)
    prior = np.concatenate([used * expit(-worth), used * expit(worth)], axis=-2)
    return np.asarray(_GRADED * prior / prior.sum(axis=-1, keepdims=True))

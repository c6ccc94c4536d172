"""The object-level Dirichlet-multinomial, scored on a grid of dispersions.

With c_ok percepts of object o at level k and n_o in all, the rising factorials of the
Dirichlet-multinomial make the log-likelihood of a row, of mean m and dispersion s,

    sum_k sum_i #{o: c_ok > i} ln(s m_k + i)  -  sum_i #{o: n_o > i} ln(s + i),

which is linear in the tail counts. So one matrix product scores a whole grid of (m, s), whatever
the numbers of recordings, for all rows of all held-out folds at once.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit, gammaln

Array = NDArray[np.float64]

DISPERSIONS = np.geomspace(0.05, 1000.0, 29)  # s; at 1000 ten percepts are as good as independent
TAUS = np.array([0.25, 0.5, 1.0, 2.0])  # of ln s over attributes, half-normal(1) a priori
_CENTER = 1.5  # log-odds about which the points of m spread out
_BLOCK = 4_000_000  # grid points scored at a time, 32 MB
_TINY = np.float32(1e-30)


class RowStatistics(NamedTuple):
    """The sufficient statistics of S rows.

    Tails (S,K,I) are #{o: c_ok > i}, sums (S,J) #{o: n_o > j}; sizes (U,) the distinct n_o, totals
    (S,U,K) the counts of the objects of each size.
    """

    tails: Array
    sums: Array
    sizes: Array
    totals: Array

    @classmethod
    def of(cls, counts: NDArray[np.int64]) -> "RowStatistics":
        """Summarize the percepts of objects in each row, (S,O,K)."""
        n = counts.sum(axis=-1)  # (S,O)
        sizes = np.unique(n[n > 0])
        of_size = (n[:, None] == sizes[:, None]).astype(float)  # (S,U,O)
        return cls(
            _tails(counts), _tails(n[..., None])[:, 0], sizes.astype(float), of_size @ counts
        )

    @property
    def largest(self) -> float:
        """The most percepts of a row."""
        return float(self.totals.sum(axis=(1, 2)).max())

    def effective(self, s: Array) -> Array:
        """Weight the counts by s (S,...), (S,...,K): n of one object are worth n(s+1)/(n+s)."""
        each = (s[..., None] + 1) / (self.sizes + s[..., None])  # (S,...,U)
        return np.asarray(np.einsum("s...u,suk->s...k", each, self.totals))


class Profile(NamedTuple):
    """What S rows say at each of G dispersions: evidence, E m, and E[1 - sum_k m_k^2]."""

    log_evidence: Array
    mean: Array
    diversity: Array


def integrate(rows: RowStatistics, alpha: Array) -> Profile:
    """Integrate m of two levels out at every s, under Dirichlet priors (S,2)."""
    m, log_width = quadrature(rows.largest)
    shape = len(DISPERSIONS), m.shape[1]
    i, j = np.arange(rows.tails.shape[-1]), np.arange(rows.sums.shape[-1])
    each = np.log(DISPERSIONS[:, None] * m[:, None, None] + i[:, None, None])  # (2,I,G,M)
    total = np.broadcast_to(-np.log(DISPERSIONS + j[:, None])[..., None], (len(j), *shape))
    ends = np.broadcast_to(np.log(m)[:, None], (2, *shape))
    widths = np.broadcast_to(log_width, (1, *shape))
    # Single precision takes half the time and changes the fit by less than the grid does.
    basis = np.concatenate([*each, total, ends, widths], dtype=np.float32)
    basis = basis.reshape(len(basis), -1)
    parts = [rows.tails[:, 0], rows.tails[:, 1], rows.sums, alpha, np.ones((len(alpha), 1))]
    features = np.concatenate(parts, axis=1, dtype=np.float32)
    factors = np.stack([np.ones(shape[1]), *m, 2 * m[0] * m[1]], axis=1, dtype=np.float32)
    peak = np.empty((len(features), shape[0]))
    integrals = np.empty((*peak.shape, factors.shape[1]))
    step = max(1, _BLOCK // basis.shape[1])
    for start in range(0, len(features), step):
        block = slice(start, start + step)
        score = (features[block] @ basis).reshape(-1, *shape)
        peak[block] = score.max(axis=-1)
        score -= peak[block, :, None]
        integrals[block] = np.exp(score, out=score) @ factors
    norm = integrals[..., 0]
    mean, diversity = integrals[..., 1:3] / norm[..., None], integrals[..., 3] / norm
    return Profile(peak + np.log(norm), mean, diversity)


def approximate(rows: RowStatistics, alpha: Array) -> Profile:
    """Replace m given s by a Dirichlet about the effective counts, under priors (S,K).

    The evidence of s is likelihood x prior / posterior of m, at the posterior's mean. Levels come
    first meanwhile, as sums over a short last axis are slow.
    """
    worth = (DISPERSIONS + 1) / (rows.sizes[:, None] + DISPERSIONS)  # (U,G), see `effective`
    counts = rows.totals.transpose(2, 0, 1) @ worth  # (K,S,G)
    after = alpha.T[..., None] + counts
    weight = after.sum(axis=0)
    mean = after / weight
    log_mean = np.log(mean)
    score = -rows.sums @ np.log(DISPERSIONS + np.arange(rows.sums.shape[-1])[:, None])
    score += rows.tails[:, :, 0].sum(axis=1)[:, None] * np.log(DISPERSIONS)
    tails = rows.tails.transpose(2, 1, 0)[..., None]  # (I,K,S,1)
    score += (tails[0] * log_mean).sum(axis=0)
    for i in range(1, len(tails)):
        score += (tails[i] * np.log(DISPERSIONS * mean + i)).sum(axis=0)
    score += (gammaln(alpha.sum(axis=1)) - gammaln(alpha).sum(axis=1))[:, None]
    score += gammaln(after).sum(axis=0) - gammaln(weight) - (counts * log_mean).sum(axis=0)
    diversity = (1 - (mean**2).sum(axis=0)) * weight / (weight + 1)
    return Profile(score, mean.transpose(1, 2, 0), diversity)


def quadrature(largest: float) -> tuple[Array, Array]:
    """Return points (m, 1 - m) (2,M) for a sum over m, and the logarithms (M,) of their widths.

    Widths are in log-odds, which are spaced as a sinh: close in the middle, where rows of `largest`
    percepts are narrow; wide at the ends, which reach so far because learned priors may be nearly
    singular there.
    """
    step = np.clip(3.0 / (_CENTER * np.sqrt(max(largest, 1.0))), 0.01, 0.2)
    reach = np.arcsinh(80.0 / _CENTER)
    t = np.linspace(-reach, reach, 2 * int(np.ceil(reach / step)) + 1)
    log_odds = _CENTER * np.sinh(t)
    return expit(np.stack([-log_odds, log_odds])), np.log(np.cosh(t))


def pool(log_evidence: Array, votes: NDArray[np.bool_]) -> Array:
    """Return the posterior over dispersions, (...,P,E,2,G), the attributes of a behavior pooled.

    Votes (...,P,E) tell whether a pair's rows inform about mu and tau.
    """
    prior, log_weight = hyperparameters()
    prior = prior.astype(np.float32)
    peak = log_evidence.max(axis=-1, keepdims=True)
    evidence = np.exp(log_evidence - peak, dtype=np.float32)  # in half the time of double
    by_hyper = np.maximum(evidence @ prior.T, _TINY)  # (...,P,E,2,Q)
    by_hyper = np.where(votes[..., None, None], by_hyper, 1.0)
    hyper = np.log(by_hyper).sum(axis=-4, keepdims=True) + log_weight
    hyper = np.exp(hyper - hyper.max(axis=-1, keepdims=True))
    weight = evidence * ((hyper / by_hyper) @ prior)
    return np.asarray(weight / weight.sum(axis=-1, keepdims=True))


def hyperparameters() -> tuple[Array, Array]:
    """Return Pr(s | mu, tau) (Q,G) of every mu and tau, and ln of their prior (Q,) + a constant."""
    log_s = np.log(DISPERSIONS)
    mus, taus = (a.ravel() for a in np.meshgrid(log_s, TAUS, indexing="ij"))
    density = np.exp(-0.5 * ((log_s - mus[:, None]) / taus[:, None]) ** 2)
    return density / density.sum(axis=1, keepdims=True), -0.5 * taus**2


def _tails(counts: NDArray[np.int64]) -> Array:
    top = max(int(counts.max()), 1)
    return np.stack([(counts > i).sum(axis=1) for i in range(top)], axis=-1).astype(float)

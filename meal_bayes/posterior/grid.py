"""Hierarchical model of the differences between objects, integrated numerically on a grid.

Repeated percepts of one object are not independent given the attribute, as Eq. 8 assumes. Each
object has its own row theta ~ Dirichlet(s m), where m is the mean row and s the dispersion of one
(attribute, behavior, truth). The dispersion is a Dirichlet precision: if s is large, objects are
alike.

With c_ok percepts of object o at level k and n_o in all, the rising factorials of the
Dirichlet-multinomial make the log-likelihood of a row, of mean m and dispersion s,

    sum_k sum_i #{o: c_ok > i} ln(s m_k + i)  -  sum_i #{o: n_o > i} ln(s + i),

which is linear in the tail counts. So one matrix product computes the log-likelihoods of all rows
on a grid of (m, s), for any numbers of recordings.

The attributes of a behavior share two priors for each truth. For s, ln s ~ Normal(mu, tau), with mu
and tau integrated out on a grid. For m with two levels, a Dirichlet prior that is learned by its
marginal likelihood; with more levels, the prior of `posterior.graded_prior`. Uninformative pairs
are not used to learn these priors: they have no "vote".
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import expit, gammaln

from meal_bayes.arrays import Bools, Floats, Ints, tiny_is_zero
from meal_bayes.errors import SettingsError
from meal_bayes.perception.confusion import informative
from meal_bayes.posterior.graded_prior import GradedPrior

DISPERSIONS = np.geomspace(0.05, 1000.0, 29)  # s; at 1000, ten percepts are nearly independent
TAUS = np.array([0.25, 0.5, 1.0, 2.0])  # standard deviation of ln s over attributes
LOG_TAU_PRIOR = -0.5 * TAUS**2  # half-normal(1) up to a constant, as in `hierarchical`
_CENTER = 1.5  # log-odds about which the points of m spread out
_BLOCK = 4_000_000  # grid points scored at a time, 32 MB
_TINY = np.float32(1e-30)
AS_INFINITE = 1e9  # number that replaces an infinite precision
PRIOR_WEIGHT = 2.0  # sum of the Dirichlet parameters of a uniform prior row
_BINARY = 2  # levels: yes and no
_WEIGHTS = np.geomspace(0.125, 64.0, 19)  # of the prior of m; log-normal about PRIOR_WEIGHT


def worth_of_percept(n: Floats, s: Floats) -> Floats:
    """Return the weight of each of n percepts of one object, in independent percepts.

    At dispersion s, all n together count as n(s+1)/(n+s) percepts of different objects.
    `ConfusionPosterior.update` counts new percepts by the same rule, in a form that allows s = inf.
    """
    return np.asarray((s + 1) / (n + s))


class RowStatistics(NamedTuple):
    """The sufficient statistics of S rows.

    Tails (S,K,I) are #{o: c_ok > i}, sums (S,J) #{o: n_o > j}; sizes (U,) the distinct n_o, totals
    (S,U,K) the counts of the objects of each size.
    """

    tails: Floats
    sums: Floats
    sizes: Floats
    totals: Floats

    @classmethod
    def of(cls, counts: Ints) -> "RowStatistics":
        """Summarize the percepts of objects in each row, (S,O,K)."""
        n = counts.sum(axis=-1)  # (S,O)
        sizes = np.unique(n[n > 0])
        of_size = (n[:, None] == sizes[:, None]).astype(float)  # (S,U,O)
        return cls(
            _tails(counts), _tails(n[..., None])[:, 0], sizes.astype(float), of_size @ counts
        )

    def effective(self, s: Floats) -> Floats:
        """Return the counts with the weights of `worth_of_percept` at s (S,...), (S,...,K)."""
        weight = worth_of_percept(self.sizes, s[..., None])  # (S,...,U)
        return np.asarray(np.einsum("s...u,suk->s...k", weight, self.totals))


class Profile(NamedTuple):
    """Posterior of S rows at each of G dispersions: evidence, E m, and E[1 - sum_k m_k^2]."""

    log_evidence: Floats
    mean: Floats
    diversity: Floats


@tiny_is_zero
def integrate(rows: RowStatistics, alpha: Floats) -> Profile:
    """Integrate m of two levels out at every s, under Dirichlet priors (S,2)."""
    m, log_width = quadrature(rows)
    shape = len(DISPERSIONS), m.shape[1]
    i = np.arange(rows.tails.shape[-1])
    j = np.arange(rows.sums.shape[-1])
    log_factors = np.log(DISPERSIONS[:, None] * m[:, None, None] + i[:, None, None])  # (2,I,G,M)
    total = np.broadcast_to(-np.log(DISPERSIONS + j[:, None])[..., None], (len(j), *shape))
    ends = np.broadcast_to(np.log(m)[:, None], (2, *shape))
    widths = np.broadcast_to(log_width, (1, *shape))
    # Single precision takes half the time and changes the fit by less than the grid does.
    basis = np.concatenate([*log_factors, total, ends, widths], dtype=np.float32)
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
    mean = integrals[..., 1:3] / norm[..., None]
    diversity = integrals[..., 3] / norm
    return Profile(peak + np.log(norm), mean, diversity)


@tiny_is_zero
def approximate(rows: RowStatistics, alpha: Floats) -> Profile:
    """Approximate the posterior of m given s by a Dirichlet with the effective counts.

    The Dirichlet parameters are `alpha` (S,K) plus the effective counts. The evidence of s is
    likelihood x prior / posterior of m, at the posterior's mean. Internally, levels are the first
    axis, because sums over a short last axis are slow.
    """
    worth = worth_of_percept(rows.sizes[:, None], DISPERSIONS)  # (U,G)
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


@tiny_is_zero
def quadrature(rows: RowStatistics) -> tuple[Floats, Floats]:
    """Return points (1 - m, m) (2,M) for numerical integration over m, and log widths (M,).

    Points are spaced in log-odds as a sinh: close in the middle, because rows with many percepts
    have a narrow posterior, and wide at the ends, because learned priors may be nearly singular
    there.
    """
    most = max(float(rows.totals.sum(axis=(1, 2)).max()), 1.0)
    step = np.clip(3.0 / (_CENTER * np.sqrt(most)), 0.01, 0.2)
    last = np.arcsinh(80.0 / _CENTER)
    t = np.linspace(-last, last, 2 * int(np.ceil(last / step)) + 1)
    log_odds = _CENTER * np.sinh(t)
    return expit(np.stack([-log_odds, log_odds])), np.log(np.cosh(t))


@tiny_is_zero
def pool(log_evidence: Floats, votes: Bools) -> Floats:
    """Return the posterior of dispersions, (...,P,E,2,G), pooled over a behavior's attributes.

    Only the pairs `votes` (...,P,E) are used to learn mu and tau.
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


def hyperparameters() -> tuple[Floats, Floats]:
    """Return Pr(s | mu, tau) (Q,G) for each mu and tau, and their log prior (Q,) + a constant."""
    log_s = np.log(DISPERSIONS)
    # Every mu with every tau, tau varying fastest: mu is any step of the grid.
    mu = np.repeat(log_s, len(TAUS))
    tau = np.tile(TAUS, len(log_s))
    density = np.exp(-0.5 * ((log_s - mu[:, None]) / tau[:, None]) ** 2)
    return density / density.sum(axis=1, keepdims=True), np.tile(LOG_TAU_PRIOR, len(log_s))


def dispersion_prior() -> Floats:
    """Return Pr(s), (G,), before any percept."""
    prior, log_weight = hyperparameters()
    weight = np.exp(log_weight)
    return np.asarray(weight @ prior / weight.sum())


def _tails(counts: Ints) -> Floats:
    top = max(int(counts.max()), 1)
    return np.stack([(counts > i).sum(axis=1) for i in range(top)], axis=-1).astype(float)


class GridPosterior(NamedTuple):
    """The posterior of S rows on the grid: prior `alpha` (S,K), Pr(s) (S,G), E m (S,K), s (S,).

    `dispersion` is the value of s that gives the right probability that a second percept equals the
    first one, E[theta^2] / E[theta]. This probability depends on s by 1 / (s + 1), whose mean is
    preserved.
    """

    rows: RowStatistics
    alpha: Floats
    prob: Floats
    mean: Floats
    dispersion: Floats


@tiny_is_zero
def grid_posterior(counts: ArrayLike, prior: ArrayLike | None = None) -> GridPosterior:
    """Compute the posterior of each row from counts (O,P,E,2,K), in the order (P,E,2).

    For two levels, m is integrated numerically; for more, its posterior given s is approximated by
    a Dirichlet. The prior of m, (P,E,2,K) or an array that broadcasts to it, is learned by default.
    """
    rows, votes = row_statistics(counts)
    alpha = _prior(rows, votes, prior).reshape(-1, rows.totals.shape[-1])
    return _posterior(rows, alpha, profile(rows, alpha), votes)


def profile(rows: RowStatistics, alpha: Floats) -> Profile:
    """Integrate m out at every s, under Dirichlet priors (S,K); exactly for two levels."""
    return integrate(rows, alpha) if alpha.shape[-1] == _BINARY else approximate(rows, alpha)


@tiny_is_zero
def prior_of(counts: ArrayLike, prior: ArrayLike | None = None) -> Floats:
    """Return the Dirichlet parameters of m, (P,E,2,K), given or learned."""
    return _prior(*row_statistics(counts), prior)


def row_statistics(counts: ArrayLike) -> tuple[RowStatistics, Bools]:
    """Return statistics of the rows of counts (O,P,E,2,K), and the informative pairs (P,E)."""
    table = np.asarray(counts)
    if table.ndim != 5 or not table.size or (table < 0).any() or (table % 1).any():
        raise SettingsError(
            f"Counts have shape {table.shape}; expected whole numbers >= 0 of shape (objects, "
            "attributes, behaviors, 2, levels)."
        )
    per_object = np.moveaxis(table, 0, -2)  # (P,E,2,O,K)
    rows = RowStatistics.of(per_object.reshape(-1, *per_object.shape[-2:]))
    totals = rows.totals.sum(axis=1).reshape(*per_object.shape[:-2], -1)
    return rows, informative(totals)


def _prior(rows: RowStatistics, votes: Bools, prior: ArrayLike | None) -> Floats:
    """Return the prior of m; learned from the rows by default.

    The dispersions that the learned prior needs are found under a uniform prior of m.
    """
    levels = rows.totals.shape[-1]
    if prior is None:
        effective = effective_counts(rows, votes)
        if levels == _BINARY:
            prior = _common_prior(effective, votes)
        else:
            prior = GradedPrior.learn(effective, votes).rows
    return np.broadcast_to(np.asarray(prior, float), (*votes.shape, 2, levels))


def effective_counts(rows: RowStatistics, votes: Bools) -> Floats:
    """Return effective counts (P,E,2,K), with dispersions that are found under a uniform prior."""
    levels = rows.totals.shape[-1]
    flat = np.full((len(rows.sums), levels), PRIOR_WEIGHT / levels)
    s = _posterior(rows, flat, approximate(rows, flat), votes).dispersion
    return np.asarray(rows.effective(s).reshape(*votes.shape, 2, levels))


def _posterior(rows: RowStatistics, alpha: Floats, profile: Profile, votes: Bools) -> GridPosterior:
    """Compute the posterior with dispersions pooled over attributes; `votes` is (...,P,E)."""
    log_evidence = profile.log_evidence.reshape(*votes.shape, 2, -1)
    prob = pool(log_evidence, votes).reshape(profile.log_evidence.shape)  # (S,G)
    mean = np.einsum("sg,sgk->sk", prob, profile.mean)
    mean /= mean.sum(axis=1, keepdims=True)
    diversity = prob * profile.diversity
    s = diversity.sum(axis=1) / (diversity @ (1 / (DISPERSIONS + 1))) - 1
    return GridPosterior(rows, alpha, prob, mean, s)


def _common_prior(effective: Floats, votes: Bools) -> Floats:
    """Learn the Dirichlet prior of a behavior's mean rows, (...,1,E,2,K), from effective counts.

    The prior's mean is that of the attributes' rows and one uniform row. Its weight maximizes the
    Dirichlet-multinomial likelihood of the effective counts (...,P,E,2,K).
    """
    levels = effective.shape[-1]
    voting = votes[..., None, None]
    n = effective.sum(axis=-1, keepdims=True)
    rows = (PRIOR_WEIGHT / levels + effective) / (PRIOR_WEIGHT + n)
    mean = (rows * voting).sum(axis=-4, keepdims=True) + 1 / levels
    mean /= voting.sum(axis=-4, keepdims=True) + 1
    alpha = mean[..., None] * _WEIGHTS  # (...,1,E,2,K,W)
    counts = effective[..., None]
    score = (gammaln(alpha + counts) - gammaln(alpha)).sum(axis=-2)
    score += gammaln(_WEIGHTS) - gammaln(_WEIGHTS + n)
    score = (score * voting).sum(axis=-4, keepdims=True)  # (...,1,E,2,W)
    score -= 0.5 * np.log(_WEIGHTS / PRIOR_WEIGHT) ** 2
    return np.asarray(_WEIGHTS[score.argmax(axis=-1)][..., None] * mean)

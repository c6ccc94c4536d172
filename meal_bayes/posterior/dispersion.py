"""How much objects differ: exact hierarchical Bayes on a grid.

Repeated percepts of one object are not independent given the attribute, as Eq. 8 takes them to be:
each object has its own row theta ~ Dirichlet(s m), m the mean row and s the dispersion of one
(attribute, behavior, truth). `grid` has their likelihood.

The attributes of a behavior share, for each truth alone: of s, ln s ~ Normal(mu, tau) over them, mu
and tau integrated out on a grid; of m, for yes/no, a common Dirichlet prior w mu, learned by its
marginal likelihood. Pairs with TPR <= FPR have no vote.

Graded percepts (K > 2) share more than that: a level is a range of class-balanced log-odds, so its
likelihood ratio is about the same whatever the behavior and attribute. The prior of their rows is
the pair's own use of the levels, tilted to either truth by each level's likelihood ratio over all
pairs, at the weight of 32 percepts: of the powers of two, the one by which the rows learned without
an object predict its percepts best (ROC36 and ISPY32 32, CY101 128, flat around).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln

from meal_bayes.errors import SettingsError
from meal_bayes.perception.confusion import youden
from meal_bayes.posterior.grid import (
    DISPERSIONS,
    Profile,
    RowStatistics,
    approximate,
    integrate,
    pool,
)

Array = NDArray[np.float64]

PRIOR_WEIGHT = 2.0  # of a row before any percept: 1 a cell for yes/no
_BINARY = 2  # levels: yes and no
_GRADED = 32.0  # weight of the prior of m where percepts are graded
_WEIGHTS = np.geomspace(0.125, 64.0, 19)  # of the prior of m; ln w ~ Normal(ln 2, 1) a priori


class GridPosterior(NamedTuple):
    """The posterior of S rows on the grid: prior `alpha` (S,K), Pr(s) (S,G), E m (S,K), s (S,).

    `dispersion` keeps the predictive of a second percept equal to the first, E[theta^2] / E[theta],
    which depends on s by 1 / (s + 1): it keeps the mean of that.
    """

    rows: RowStatistics
    alpha: Array
    prob: Array
    mean: Array
    dispersion: Array


def grid_posterior(counts: ArrayLike, prior: ArrayLike | None = None) -> GridPosterior:
    """Compute the posterior of each row, counts (...,O,P,E,2,K), in the order (...,P,E,2).

    Two levels are integrated exactly; with more, m given s is Dirichlet about the effective counts.
    The prior of m, (P,E,2,K) or what broadcasts to it, is learned by default.
    """
    rows, votes = _rows(counts)
    levels = rows.totals.shape[-1]
    alpha = _prior(rows, votes, prior).reshape(-1, levels)
    profile = integrate(rows, alpha) if levels == _BINARY else approximate(rows, alpha)
    return _posterior(rows, alpha, profile, votes)


def prior_of(counts: ArrayLike, prior: ArrayLike | None = None) -> Array:
    """Return the Dirichlet parameters of m, (...,P,E,2,K), given or learned."""
    return _prior(*_rows(counts), prior)


def _rows(counts: ArrayLike) -> tuple[RowStatistics, NDArray[np.bool_]]:
    """Summarize the rows of counts (...,O,P,E,2,K), and which pairs inform of others (...,P,E)."""
    per_object = np.moveaxis(np.asarray(counts), -5, -2)  # (...,P,E,2,O,K)
    if per_object.size == 0 or (per_object < 0).any() or (per_object % 1).any():
        raise SettingsError(
            "Object-level counts must be whole numbers >= 0 of at least one object."
        )
    rows = RowStatistics.of(per_object.reshape(-1, *per_object.shape[-2:]))
    totals = rows.totals.sum(axis=1).reshape(*per_object.shape[:-2], -1)
    return rows, youden(totals) > 0


def _prior(rows: RowStatistics, votes: NDArray[np.bool_], prior: ArrayLike | None) -> Array:
    """Learn the prior of m from the rows, their dispersions found under a flat one, or take it."""
    levels = rows.totals.shape[-1]
    if prior is None:
        flat = np.full((len(rows.sums), levels), PRIOR_WEIGHT / levels)
        s = _posterior(rows, flat, approximate(rows, flat), votes).dispersion
        learn = _common_prior if levels == _BINARY else _graded_prior
        prior = learn(rows.effective(s).reshape(*votes.shape, 2, levels), votes)
    return np.broadcast_to(np.asarray(prior, float), (*votes.shape, 2, levels))


def _posterior(
    rows: RowStatistics, alpha: Array, profile: Profile, votes: NDArray[np.bool_]
) -> GridPosterior:
    """Pool the attributes of each behavior; votes (...,P,E)."""
    log_evidence = profile.log_evidence.reshape(*votes.shape, 2, -1)
    prob = pool(log_evidence, votes).reshape(profile.log_evidence.shape)  # (S,G)
    mean = np.einsum("sg,sgk->sk", prob, profile.mean)
    mean /= mean.sum(axis=1, keepdims=True)
    diversity = prob * profile.diversity
    s = diversity.sum(axis=1) / (diversity @ (1 / (DISPERSIONS + 1))) - 1
    return GridPosterior(rows, alpha, prob, mean, s)


def _common_prior(effective: Array, votes: NDArray[np.bool_]) -> Array:
    """Learn the Dirichlet prior of a behavior's mean rows, (...,1,E,2,K), from effective counts.

    Its mean is that of the attributes' rows and of one flat row; its weight maximizes the
    Dirichlet-multinomial likelihood of the effective counts (...,P,E,2,K).
    """
    levels, voting = effective.shape[-1], votes[..., None, None]
    n = effective.sum(axis=-1, keepdims=True)
    rows = (PRIOR_WEIGHT / levels + effective) / (PRIOR_WEIGHT + n)
    mean = (rows * voting).sum(axis=-4, keepdims=True) + 1 / levels
    mean /= voting.sum(axis=-4, keepdims=True) + 1
    alpha, counts = mean[..., None] * _WEIGHTS, effective[..., None]  # (...,1,E,2,K,W)
    score = (gammaln(alpha + counts) - gammaln(alpha)).sum(axis=-2)
    score += gammaln(_WEIGHTS) - gammaln(_WEIGHTS + n)
    score = (score * voting).sum(axis=-4, keepdims=True)  # (...,1,E,2,W)
    score -= 0.5 * np.log(_WEIGHTS / PRIOR_WEIGHT) ** 2
    return np.asarray(_WEIGHTS[score.argmax(axis=-1)][..., None] * mean)


def _graded_prior(effective: Array, votes: NDArray[np.bool_]) -> Array:
    """Compute the Dirichlet prior of graded rows, (...,P,E,2,K), from effective counts.

    With q the balanced mean of a pair's two rows and r_k the ratio in which true and false objects
    show level k, over all pairs with a vote: 2 q_k r_k / (1 + r_k) and 2 q_k / (1 + r_k). Pairs
    have the weight of their rarer truth.
    """
    levels, n = effective.shape[-1], effective.sum(axis=-1, keepdims=True)
    rows = (1 / levels + effective) / (1 + n)
    vote = n.min(axis=-2, keepdims=True) * votes[..., None, None]
    pooled = (rows * vote).sum(axis=(-4, -3), keepdims=True) + 1 / levels  # (...,1,1,2,K)
    log_ratio = np.log(pooled[..., 1:, :]) - np.log(pooled[..., :1, :])
    used = rows.mean(axis=-2, keepdims=True)
    prior = np.concatenate([used * expit(-log_ratio), used * expit(log_ratio)], axis=-2)
    return np.asarray(_GRADED * prior / prior.sum(axis=-1, keepdims=True))

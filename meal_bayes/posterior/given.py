"""Prior of percepts from the robot's own detector: they are informative before any label.

A classifier that was trained on few objects may be uninformative, which only its percepts of other
objects can show. A detector was built to be right, so it is believed to some extent before there
are labels. Pairs (attribute, behavior) with percepts of a detector, and with few labels (see
`learner.views.trusted_pairs`), are called "given". The prior of their rows, for truth y and level
k, is

    alpha_yk = A q_k sigma(+-l_k) / sum_j q_j sigma(+-l_j),   l_k = (1 - w) l_own,k + w l*_k.

Here q_k is the frequency of level k for the pair, l_own is the log ratio of the frequencies of a
level for true and for false objects, over all pairs with labels (as in `graded_prior`), and l* are
typical ratios. (Classifiers of three data sets with many labels have l from (0, -.3, .1, .6) to
(-2.1, -.8, .7, 3.1) for four levels.) The weight w of the typical ratios and the weight A of the
prior are integrated out, weighted by the evidence of all given rows.

A detector that sees one object twice mostly gives the same output. Therefore the dispersion s of
the objects' rows, which determines how informative repeats are, is expected to be smaller than for
classifiers, until repeats on labeled objects show otherwise: Pr(s) is weighted by 1 / sqrt(1 + s).
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import betaln, expit, logsumexp

from meal_bayes.arrays import Bools, Floats
from meal_bayes.posterior import grid
from meal_bayes.posterior.graded_prior import pooled_log_ratio, use_of_levels

# l*, log ratios by level, from surely no to surely yes
_GENERIC = {2: np.array([-0.9, 0.9]), 4: np.array([-1.6, -0.5, 0.5, 1.6])}
_STEEP = 1.6  # l* of the last level, for other numbers of levels
# (w, A) and Pr(w): large w are more probable; the three values of A are equally probable.
_SHARES = np.repeat([0.0, 0.25, 0.5, 0.75, 1.0], 3)
_WEIGHTS = np.tile([8.0, 32.0, 128.0], 5)
_LOG_PRIOR = np.log(np.repeat([0.1, 0.1, 0.2, 0.3, 0.3], 3) / 3)
_REPEATS = 0.5  # Pr(s) of classifiers is divided by (s + 1) to this power
_ALIKE = (1 + grid.DISPERSIONS) ** -_REPEATS


def first_dispersion() -> float:
    """Return the dispersion s of a given pair without percepts; it is small.

    >>> round(first_dispersion(), 2)
    0.73
    """
    prob = grid.dispersion_prior() * _ALIKE
    return float(prob.sum() / (prob / (grid.DISPERSIONS + 1)).sum() - 1)


class GivenRows(NamedTuple):
    """Rows of R given pairs: prior and posterior of their mean, and their dispersion.

    Attributes
    ----------
    prior : Floats
        (R,2,K) Dirichlet parameters of the mean row before any percept.
    concentration : Floats
        (R,2,K) Dirichlet parameters of the mean row given the counts.
    dispersion : Floats
        (R,2) dispersion s of the objects' rows.
    """

    prior: Floats
    concentration: Floats
    dispersion: Floats


def generic_log_ratio(levels: int) -> Floats:
    """Return the typical log ratios l*, (K,), for a number of levels."""
    if levels in _GENERIC:
        return _GENERIC[levels]
    return np.linspace(-_STEEP, _STEEP, levels)


def generic_prior(levels: int) -> Floats:
    """Return the Dirichlet parameters (2,K) of a given pair without percepts."""
    used = np.full((1, 1, levels), 1.0 / levels)
    alpha = _alphas(used, np.zeros(levels))
    return np.asarray(_collapsed(alpha, np.exp(_LOG_PRIOR))[0])


def given_rows(counts: ArrayLike, given: Bools) -> GivenRows:
    """Learn the rows of the R pairs that are `given` (P,E), from counts (O,P,E,2,K).

    Dispersions are pooled over all attributes, as by `grid.pool`.
    """
    rows, votes = grid.row_statistics(counts)
    levels = rows.totals.shape[-1]
    shape = (*votes.shape, 2, levels)
    learned = grid.prior_of(counts)  # (P,E,2,K) of all pairs that are not given
    effective = grid.effective_counts(rows, votes).reshape(shape)
    used = use_of_levels(effective)[given]  # (R,1,K)
    # All given pairs are used, also those that seem uninformative. If they were selected by their
    # percepts, a detector that only guesses would look informative.
    own = pooled_log_ratio(effective, votes | given)
    alphas = _alphas(used, own)  # (C,R,2,K)
    # The posterior for each (w, A); the evidence is its weight.
    pick = np.repeat(given.ravel(), 2)
    scores = []
    prob = []
    means = []
    diversities = []
    every = grid.profile(rows, np.asarray(learned).reshape(-1, levels))
    part = grid.RowStatistics(rows.tails[pick], rows.sums[pick], rows.sizes, rows.totals[pick])
    prior_of_s = grid.dispersion_prior()
    for alpha in alphas.reshape(len(alphas), -1, levels):
        of_given = grid.profile(part, alpha)
        every.log_evidence[pick] = of_given.log_evidence
        pooled = grid.pool(every.log_evidence.reshape(*votes.shape, 2, -1), votes)
        tilted = pooled.reshape(len(pick), -1)[pick] * _ALIKE  # (2R,G)
        prob.append(tilted / tilted.sum(axis=1, keepdims=True))
        log_norm = betaln(*alpha.T) if levels == 2 else 0.0
        scores.append((logsumexp(of_given.log_evidence, b=prior_of_s, axis=1) - log_norm).sum())
        means.append(of_given.mean)
        diversities.append(of_given.diversity)
    score = np.array(scores) + _LOG_PRIOR
    weight = np.exp(score - logsumexp(score))  # (C,)
    of_s = np.stack(prob)  # (C,2R,G)
    mean = np.einsum("c,csg,csgk->sk", weight, of_s, np.stack(means))
    mean /= mean.sum(axis=1, keepdims=True)
    diversity = np.einsum("c,csg->sg", weight, of_s * np.stack(diversities))
    s = diversity.sum(axis=1) / (diversity @ (1 / (grid.DISPERSIONS + 1))) - 1
    concentration = _of_diversity(mean, diversity.sum(axis=1))
    return GivenRows(
        _collapsed(alphas, weight),
        concentration.reshape(-1, 2, levels),
        s.reshape(-1, 2),
    )


def _alphas(used: Floats, own: Floats) -> Floats:
    """Return Dirichlet parameters (C,R,2,K) for frequencies of levels (R,1,K) and l_own (K,)."""
    share = _SHARES[:, None]
    log_ratio = (1 - share) * own + share * generic_log_ratio(len(own))  # (C,K)
    tilt = np.stack([expit(-log_ratio), expit(log_ratio)], axis=1)  # (C,2,K)
    alpha = used * tilt[:, None]
    return np.asarray(_WEIGHTS[:, None, None, None] * alpha / alpha.sum(axis=-1, keepdims=True))


def _collapsed(alphas: Floats, weight: Floats) -> Floats:
    """Return Dirichlet parameters (...,K) with mean and diversity of a mixture (C,...,K)."""
    total = alphas.sum(axis=-1)
    mean = alphas / total[..., None]
    diversity = (1 - (mean**2).sum(axis=-1)) * total / (total + 1)
    mixed = np.tensordot(weight, mean, axes=1)
    return _of_diversity(mixed, np.tensordot(weight, diversity, axes=1))


def _of_diversity(mean: Floats, diversity: Floats) -> Floats:
    """Return the Dirichlet parameters (...,K) with a mean and E[1 - sum_k m_k^2] = diversity."""
    variance = np.maximum(1 - (mean**2).sum(axis=-1) - diversity, 1e-12)
    return np.asarray((diversity / variance)[..., None] * mean)

"""Draws of the rows of Theta and of their dispersions, from the grid or from NUTS.

Draws are an xarray data set, which ArviZ calls the group `posterior`. It has the variables `mean`
(chain, draw, attribute, behavior, truth, level), `dispersion` (the same without the level) and, in
some models, `misperception` (chain, draw). Only behaviors that sense have rows. The same functions
summarize draws of all methods as a `ConfusionPosterior` and predict new percepts from them.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike
from scipy.interpolate import CubicSpline
from scipy.special import expit, gammaln, log_softmax, logsumexp, softmax

from meal_bayes.arrays import Bools, Floats, Ints, plain_fields
from meal_bayes.look import level_names
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.grid import (
    AS_INFINITE,
    DISPERSIONS,
    RowStatistics,
    grid_posterior,
    hyperparameters,
    quadrature,
)

TRUTHS = ("false", "true")
ROW = ("attribute", "behavior", "truth")
_FLOOR = 1e-100  # of probabilities, whose gamma functions would overflow
_RAREST = 1e-12  # smallest probability of a level; a user's own model may give 0
# Smallest and largest sum of a row's Dirichlet parameters: draws that differ most, or are equal.
_WEIGHTS = 1e-3, AS_INFINITE
_FINER = 8  # points for each of the grid's, where m is drawn


DRAWS = 1000  # of each chain, by default
CHAINS = 4


@dataclass(frozen=True, slots=True)
class Sampling:
    """Settings of drawing. The options of `meal-bayes posterior` have the same defaults.

    Attributes
    ----------
    draws : int
        Number of draws of each chain.
    tune : int
        Number of steps of NUTS before the draws.
    chains : int
        Number of chains.
    jobs : int | None
        Number of chains that run at the same time; by default, that of the processors.
    seed : int
        Seed of the draws.
    """

    draws: int = DRAWS
    tune: int = 1000
    chains: int = CHAINS
    jobs: int | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        plain_fields(self)


def draws_of(
    attributes: Sequence[str],
    behaviors: Sequence[str],
    mean: ArrayLike,
    dispersion: ArrayLike,
    misperception: ArrayLike | None = None,
) -> xr.Dataset:
    """Build a data set of C chains of S draws: m (C,S,P,E,2,K), s (C,S,P,E,2), epsilon (C,S)."""
    chains, size, *_, levels = np.shape(mean)
    dims = ("chain", "draw", *ROW)
    variables = {"mean": ((*dims, "level"), mean), "dispersion": (dims, dispersion)}
    if misperception is not None:
        variables["misperception"] = (dims[:2], misperception)
    names = (range(chains), range(size), attributes, behaviors, TRUTHS, level_names(levels))
    coords = {dim: list(along) for dim, along in zip((*dims, "level"), names, strict=True)}
    return xr.Dataset(variables, coords)


def rows_of(draws: xr.Dataset) -> tuple[Floats, Floats, Floats]:
    """Return m (C*S,P,E,2,K), s (C*S,P,E,2) and epsilon (C*S,), chain by chain.

    epsilon is 0 if the draws have no misperception.
    """
    mean = np.maximum(draws["mean"].values, _FLOOR)
    s = draws["dispersion"].values
    epsilon = draws["misperception"].values if "misperception" in draws else np.zeros(s.shape[:2])
    return mean.reshape(-1, *mean.shape[2:]), s.reshape(-1, *s.shape[2:]), epsilon.ravel()


def summarize_draws(
    draws: xr.Dataset, counts: ArrayLike, telling: Floats | None = None
) -> ConfusionPosterior:
    """Summarize draws for agents, given the counts (O,P,E',2,K) from which they were drawn.

    Three quantities of a row are preserved: its mean; the variance of its mean, which determines
    A by sum_k m_k (1 - m_k) / (A + 1); and the probability that a second percept equals the first,
    which determines s. If a fraction epsilon of the objects shows the row of the other truth, this
    row is mixed in.

    Parameters
    ----------
    draws : xr.Dataset
        Draws of means and dispersions.
    counts : ArrayLike
        (O,P,E',2,K) percepts of each object.
    telling : Floats, optional
        (P,E') probability that each pair is informative, if the draws are for informative pairs
        (see `posterior.spike`). By default, the draws are used as they are.
    """
    whole = ConfusionPosterior.from_objects(counts)
    m, s, misperceived = rows_of(draws)
    m = np.maximum(m, _RAREST)  # a row of a user's model may be exactly 0 and 1
    m = m / m.sum(axis=-1, keepdims=True)
    alike = np.isinf(s)  # objects: their percepts differ as those of two objects do
    finite = np.where(alike, 1.0, s)
    # Pr(a second percept differs from the first) = (1 - sum_k m_k^2) s / (s + 1)
    unlike = (1 - (m**2).sum(axis=-1)) * np.where(alike, 1.0, finite / (finite + 1))
    # A fraction epsilon of the objects shows the row of the other truth.
    epsilon = misperceived[:, None, None, None]
    mean = (1 - epsilon[..., None]) * m + epsilon[..., None] * m[..., ::-1, :]
    unlike = (1 - epsilon) * unlike + epsilon * unlike[..., ::-1]
    # Var(m) = sum_k m_k (1 - m_k) / (A + 1) of a Dirichlet distribution of concentration A
    center = mean.mean(axis=0)
    variance = mean.var(axis=0).sum(axis=-1)
    with np.errstate(divide="ignore"):  # draws that are equal: the row is known
        weight = (1 - (center**2).sum(axis=-1)) / variance - 1
    weight = np.clip(weight, *_WEIGHTS)
    ratio = unlike.sum(axis=0) / (1 - (mean**2).sum(axis=-1)).sum(axis=0)  # s / (s + 1)
    columns = sensing(counts)
    concentration = whole.concentration.copy()
    dispersion = whole.dispersion.copy()
    concentration[:, columns] = weight[..., None] * center
    with np.errstate(divide="ignore"):  # to infinity
        dispersion[:, columns] = ratio / (1 - ratio)
    if telling is not None:
        told = np.zeros(concentration.shape[:2])  # a behavior without percepts tells nothing
        told[:, columns] = telling
        telling = told
    return replace(whole, concentration=concentration, dispersion=dispersion, telling=telling)


def sensing(counts: ArrayLike) -> Bools:
    """Return which behaviors (E',) of counts (O,P,E',2,K) have a percept."""
    return np.asarray(np.asarray(counts).any(axis=(0, 1, 3, 4)))


def draw_grid(
    counts: ArrayLike,
    rng: np.random.Generator,
    *,
    attributes: Sequence[str],
    behaviors: Sequence[str],
    prior: ArrayLike | None = None,
    draws: int = DRAWS,
    chains: int = CHAINS,
) -> xr.Dataset:
    """Draw independently from the posterior that `ConfusionPosterior.from_objects` summarizes.

    For two levels, the draws are exact up to the steps of the grid (see `grid.grid_posterior`).

    Parameters
    ----------
    counts : ArrayLike
        (O,P,E,2,K) percepts of each object by the behaviors that sense.
    rng : np.random.Generator
        Source of the draws.
    attributes, behaviors : Sequence[str]
        (P,) and (E,) names.
    prior : ArrayLike, optional
        (P,E,2,K) prior as in `ConfusionPosterior.from_objects`.
    draws, chains : int
        Number of draws of each chain, and number of chains.
    """
    *row, levels = np.shape(counts)[1:]
    size = draws * chains
    rows, alpha, prob, *_ = grid_posterior(counts, prior)
    mean = np.empty((size, *alpha.shape))
    dispersion = np.empty((size, len(alpha)))
    for r, weights in enumerate(prob):
        steps = rng.choice(len(DISPERSIONS), size=size, p=weights)
        dispersion[:, r] = DISPERSIONS[steps]
        if levels == 2:
            mean[:, r] = _two_levels(rows, alpha, r, steps, rng)
        else:
            row_r = rows._replace(totals=rows.totals[r : r + 1])
            mean[:, r] = draw_dirichlet(rng, alpha[r] + row_r.effective(dispersion[None, :, r])[0])
    shape = (chains, draws, *row)
    mean = mean.reshape(*shape, levels)
    return draws_of(attributes, behaviors, mean, dispersion.reshape(shape))


def _two_levels(
    rows: RowStatistics, alpha: Floats, r: int, steps: Ints, rng: np.random.Generator
) -> Floats:
    """Draw m (S,2) of row r given the steps (S,) of s on the grid, by the inverse of its CDF."""
    nodes, log_width = quadrature(rows)
    i = np.arange(rows.tails.shape[-1])
    t = np.linspace(-1.0, 1.0, nodes.shape[1])
    # Between the grid's points ln p(m | s) is interpolated, and drawn from by its cumulative sum.
    fine = np.linspace(-1.0, 1.0, _FINER * (len(t) - 1) + 1)
    log_odds = CubicSpline(t, np.log(nodes[1]) - np.log(nodes[0]))(fine)
    mean = np.empty((len(steps), 2))
    for g in np.unique(steps):
        rising = np.log(DISPERSIONS[g] * nodes[:, None] + i[:, None])  # (2,I,M)
        # ln p(m | s, percepts), in log-odds of m: Dirichlet prior, Polya likelihood
        score = log_width + alpha[r] @ np.log(nodes)
        score += np.einsum("ki,kim->m", rows.tails[r], rising)
        score = CubicSpline(t, score)(fine)
        density = np.exp(score - score.max())
        cdf = np.cumsum(density) - density / 2  # a point stands in the middle of its width
        draws = steps == g
        m = np.interp(rng.random(draws.sum()), cdf / density.sum(), log_odds)
        mean[draws] = expit(np.stack([-m, m], axis=-1))
    return mean


def draw_prior(
    draws: xr.Dataset, prior: ArrayLike, rng: np.random.Generator, *, size: int = 500
) -> xr.Dataset:
    """Draw m and s of the same rows from their prior, as one chain.

    ln s ~ Normal(mu, tau) on the grid, with the prior of `grid.hyperparameters`; mu and tau are
    shared by the attributes of a behavior and truth. m ~ Dirichlet(prior), with `prior` (P,E,2,K).
    """
    attributes = draws["attribute"].values.tolist()
    behaviors = draws["behavior"].values.tolist()
    alpha = np.broadcast_to(prior, draws["mean"].shape[2:])
    prob, log_weight = hyperparameters()
    # One (mu, tau) for all attributes of a behavior and truth, then ln s of each row given it.
    shape = size, 1, *alpha.shape[1:3]  # (S,1,E,2)
    hyper = rng.choice(len(prob), size=shape, p=softmax(log_weight))
    quantile = rng.random((size, *alpha.shape[:3], 1))
    steps = (quantile > prob.cumsum(axis=1)[hyper]).sum(axis=-1)
    dispersion = DISPERSIONS[np.minimum(steps, len(DISPERSIONS) - 1)]
    mean = draw_dirichlet(rng, np.broadcast_to(alpha, (size, *alpha.shape)))
    return draws_of(attributes, behaviors, mean[None], dispersion[None])


def log_prior(draws: xr.Dataset, prior: ArrayLike) -> xr.Dataset:
    """Compute the log prior density of the rows and the dispersions of each draw.

    `prior` contains the Dirichlet parameters (P,E,2,K) of m. The log density of `dispersion` is
    summed over mu and tau and is that of all attributes together: (chain, draw, behavior, truth).
    """
    alpha = np.broadcast_to(prior, draws["mean"].shape[2:])
    mean = np.maximum(draws["mean"].values, _FLOOR)
    rows = ((alpha - 1) * np.log(mean)).sum(axis=-1)
    rows += gammaln(alpha.sum(axis=-1)) - gammaln(alpha).sum(axis=-1)
    # ln sum over (mu, tau) of Pr(mu, tau) prod over attributes of Pr(s | mu, tau)
    prob, log_weight = hyperparameters()
    steps = np.abs(np.log(draws["dispersion"].values)[..., None] - np.log(DISPERSIONS)).argmin(-1)
    by_hyper = np.log(prob.T + _FLOOR)[steps].sum(axis=2) + log_softmax(log_weight)  # (C,S,E,2,Q)
    dims = ("chain", "draw", *ROW)
    return xr.Dataset(
        {"mean": (dims, rows), "dispersion": ((*dims[:2], *ROW[1:]), logsumexp(by_hyper, axis=-1))},
        {dim: draws[dim] for dim in dims},
    )


def replicate(
    draws: xr.Dataset, counts: ArrayLike, rng: np.random.Generator, *, size: int = 200
) -> Ints:
    """Draw percepts of new objects, as many as were observed, (size,O,P,E,2,K).

    Each replicate uses one of the draws (evenly spaced), draws a row theta ~ Dirichlet(s m) for
    each object, and then as many percepts for each truth as in counts (O,P,E,2,K). If the draws
    have a misperception, an object shows the other truth's rows with this probability, by all
    behaviors.
    """
    percepts = np.asarray(counts)
    number = percepts.sum(axis=-1)  # (O,P,E,2)
    mean, s, epsilon = rows_of(draws)
    replicates = np.empty((size, *percepts.shape), dtype=np.int64)
    for n, index in enumerate(np.linspace(0, len(mean) - 1, size).astype(int)):
        alpha = np.broadcast_to(s[index, ..., None] * mean[index], percepts.shape)
        swap = rng.random(percepts.shape[:2]) < epsilon[index]
        alpha = np.where(swap[:, :, None, None, None], alpha[..., ::-1, :], alpha)
        replicates[n] = rng.multinomial(number, draw_dirichlet(rng, alpha))
    return replicates


def draw_dirichlet(rng: np.random.Generator, alpha: Floats) -> Floats:
    """Draw one point from each Dirichlet distribution of parameters (...,K)."""
    gamma = np.maximum(rng.standard_gamma(alpha), np.finfo(float).tiny)
    return np.asarray(gamma / gamma.sum(axis=-1, keepdims=True))

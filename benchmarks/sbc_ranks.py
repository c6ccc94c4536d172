"""Simulation-based calibration of a posterior [Talts2018].

Where parameters are drawn from the prior and data from the parameters, the rank of the true value
among L posterior draws is uniform on 0 .. L.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc

from meal_bayes.arrays import Floats
from meal_bayes.errors import SettingsError
from meal_bayes.posterior.draws import draw_dirichlet
from meal_bayes.posterior.grid import DISPERSIONS, TAUS


class Simulation(NamedTuple):
    """Parameters drawn from the prior, and percepts drawn from them.

    Attributes
    ----------
    mean : (P,E,2,K).
    dispersion : (P,E,2).
    counts : (O,P,E,2,K).
    """

    mean: Floats
    dispersion: Floats
    counts: NDArray[np.int64]


def simulate(
    rng: np.random.Generator,
    prior: ArrayLike,
    *,
    objects: int,
    recordings: int,
    independent: bool = False,
) -> Simulation:
    """Draw rows from the prior of `from_objects`, and percepts of objects from the rows.

    Parameters
    ----------
    prior : (P,E,2,K) Dirichlet parameters of m; each (behavior, truth) has its own mu and tau.
    objects : of each truth.
    recordings : percepts of each object and behavior.
    independent : all objects alike (s = inf), as `ConfusionPosterior.from_counts` takes them.
    """
    alpha = np.asarray(prior, dtype=float)
    mean = draw_dirichlet(rng, alpha)
    log_s = np.log(DISPERSIONS)
    shape = alpha.shape[1:3]
    tau_weight = np.exp(-0.5 * TAUS**2)
    mu = rng.choice(log_s, size=shape)[..., None]
    tau = rng.choice(TAUS, size=shape, p=tau_weight / tau_weight.sum())[..., None]
    cdf = np.exp(-0.5 * ((log_s - mu) / tau) ** 2).cumsum(axis=-1)  # (E,2,G)
    cdf /= cdf[..., -1:]
    step = (rng.random(alpha.shape[:3])[..., None] > cdf).sum(axis=-1)
    s = DISPERSIONS[step]
    rows = np.broadcast_to(mean, (objects, *mean.shape))
    if not independent:
        rows = draw_dirichlet(rng, np.broadcast_to(s[..., None] * mean, rows.shape))
    counts = np.zeros((2, *rows.shape), dtype=np.int64)  # half of the objects have each truth
    for truth in (0, 1):
        counts[truth, ..., truth, :] = rng.multinomial(recordings, rows[..., truth, :])
    if not independent:  # another row for the objects of the other truth
        other = draw_dirichlet(rng, np.broadcast_to(s[..., None] * mean, rows.shape))
        counts[1, ..., 1, :] = rng.multinomial(recordings, other[..., 1, :])
    return Simulation(mean, s, counts.reshape(-1, *mean.shape))


def rank_statistics(
    truth: ArrayLike, draws: ArrayLike, rng: np.random.Generator
) -> NDArray[np.int64]:
    """Rank each true value (...) among its posterior draws (L,...): 0 .. L, ties at random."""
    true = np.asarray(truth, float)
    drawn = np.asarray(draws, float)
    if drawn.shape[1:] != true.shape:
        raise SettingsError(f"Draws have shape {drawn.shape}; expected (L, *{true.shape}).")
    below = (drawn < true).sum(axis=0)
    equal = (drawn == true).sum(axis=0)
    return np.asarray(below + rng.integers(0, equal + 1))


def uniformity(ranks: ArrayLike, draws: int, *, bins: int = 20) -> float:
    """Return the p-value of the chi-squared test that ranks among L draws are uniform.

    >>> uniformity(range(100), 99) > 0.999, uniformity([50] * 100, 99) < 1e-6
    (True, True)
    """
    if (draws + 1) % bins:
        raise SettingsError(f"{draws} draws make {draws + 1} ranks; give a multiple of {bins}.")
    place = np.asarray(ranks).ravel() * bins // (draws + 1)
    expected = place.size / bins
    statistic = ((np.bincount(place, minlength=bins) - expected) ** 2).sum() / expected
    return float(chdtrc(bins - 1, statistic))


def coverage(
    truth: ArrayLike, draws: ArrayLike, masses: Sequence[float] = (0.5, 0.8, 0.95)
) -> Floats:
    """Return the fraction of true values (...) in the equal-tailed intervals of draws (L,...)."""
    true = np.asarray(truth, float)
    drawn = np.asarray(draws, float)
    tails = [(0.5 - mass / 2, 0.5 + mass / 2) for mass in masses]
    ends = [np.quantile(drawn, tail, axis=0) for tail in tails]
    return np.array([((low <= true) & (true <= high)).mean() for low, high in ends])

"""Checks of a posterior: simulation-based calibration, coverage, prediction.

Simulation-based calibration [Talts2018]: where parameters are drawn from the prior and data from
the parameters, the rank of the true value among L posterior draws is uniform on 0 .. L.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import chdtrc, expit, logsumexp

from meal_bayes.errors import SettingsError
from meal_bayes.posterior.dispersion import youden
from meal_bayes.posterior.draws import Draws, draw_dirichlet, replicate, sensing
from meal_bayes.posterior.grid import DISPERSIONS, TAUS
from meal_bayes.posterior.pointwise import log_likelihood

Array = NDArray[np.float64]


class Simulation(NamedTuple):
    """Parameters drawn from the prior, and percepts drawn from them.

    Attributes
    ----------
    mean : (P,E,2,K).
    dispersion : (P,E,2).
    counts : (O,P,E,2,K).
    """

    mean: Array
    dispersion: Array
    counts: NDArray[np.int64]


class Prediction(NamedTuple):
    """Numbers of "yes" among the n percepts that most objects have, observed and predicted.

    Attributes
    ----------
    observed : (2,n+1) cases (object, attribute, behavior) by truth and number of yes.
    predicted : (S,2,n+1) replicates.
    p_values : (2,) fraction of replicates whose numbers of yes vary at least as much.
    """

    observed: NDArray[np.int64]
    predicted: NDArray[np.int64]
    p_values: Array


class Beliefs(NamedTuple):
    """Pr(true) of each object's attributes, learned without the object, beside their truth.

    Attributes
    ----------
    each, each_truth : (n,) after all recordings of one behavior, for every behavior.
    together, together_truth : (m,) after all recordings of all behaviors.
    """

    each: Array
    each_truth: NDArray[np.bool_]
    together: Array
    together_truth: NDArray[np.bool_]


def simulate(
    rng: np.random.Generator,
    prior: ArrayLike,
    *,
    objects: int,
    recordings: int,
    independent: bool = False,
) -> Simulation:
    """Draw rows from the prior of `fit_dispersion`, and percepts of objects from the rows.

    Parameters
    ----------
    prior : (P,E,2,K) Dirichlet parameters of m; each (behavior, truth) has its own mu and tau.
    objects : of each truth.
    recordings : percepts of each object and behavior.
    independent : all objects alike (s = inf), as `ConfusionPosterior.from_counts` takes them.
    """
    alpha = np.asarray(prior, dtype=float)
    mean = draw_dirichlet(rng, alpha)
    log_s, shape = np.log(DISPERSIONS), alpha.shape[1:3]
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
    true, drawn = np.asarray(truth, float), np.asarray(draws, float)
    if drawn.shape[1:] != true.shape:
        raise SettingsError(f"Draws have shape {drawn.shape}; expected (L, *{true.shape}).")
    below, equal = (drawn < true).sum(axis=0), (drawn == true).sum(axis=0)
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
) -> Array:
    """Return the fraction of true values (...) in the equal-tailed intervals of draws (L,...)."""
    true, drawn = np.asarray(truth, float), np.asarray(draws, float)
    tails = [(0.5 - mass / 2, 0.5 + mass / 2) for mass in masses]
    ends = [np.quantile(drawn, tail, axis=0) for tail in tails]
    return np.array([((low <= true) & (true <= high)).mean() for low, high in ends])


def predictive_check(
    draws: Draws, counts: ArrayLike, rng: np.random.Generator, *, size: int = 200
) -> Prediction:
    """Compare the numbers of "yes" of each object with those predicted of new objects.

    Pairs with Youden's J <= 0 are left out.

    Parameters
    ----------
    counts : (O,P,E',2,K), which the draws come from.
    size : replicates.
    """
    array = np.asarray(counts)
    kept = array[:, :, sensing(array)]
    number = kept.sum(axis=-1)
    n = int(np.bincount(number[number > 0]).argmax())
    positive = youden(kept.sum(axis=0).astype(float)) > 0  # (P,E)
    full = (number == n) & positive[..., None]  # (O,P,E,2)
    replicated = replicate(draws, array, rng, size=size)
    observed, variance = _yes(kept, full, n)
    predicted, variances = zip(*(_yes(one, full, n) for one in replicated), strict=True)
    p_values = (np.array(variances) >= variance).mean(axis=0)
    return Prediction(observed, np.stack(predicted), p_values)


def _yes(
    counts: NDArray[np.int64], full: NDArray[np.bool_], n: int
) -> tuple[NDArray[np.int64], Array]:
    """Count (2,n+1) objects by truth and number of yes, and their variance (2,) within rows."""
    yes = counts[..., counts.shape[-1] // 2 :].sum(axis=-1)  # (O,P,E,2)
    table = np.stack([np.bincount(yes[..., t][full[..., t]], minlength=n + 1) for t in (0, 1)])
    size = np.maximum(full.sum(axis=0), 1)
    center = (yes * full).sum(axis=0) / size
    squares = (full * (yes - center) ** 2).sum(axis=(0, 1, 2))
    return table, squares / np.maximum(full.sum(axis=(0, 1, 2)), 1)


def beliefs_without_itself(draws: Draws, counts: ArrayLike, *, size: int = 400) -> Beliefs:
    """Compute beliefs in each object's attributes as if it had not been learned from.

    Draws are weighted by 1 / Pr(the object's percepts | truth, draw), which removes the object from
    the posterior, up to the error of importance sampling: it is largest for objects that surprise a
    small data set. The prior is the base rate of the others. Pairs with Youden's J <= 0 are left
    out.

    Parameters
    ----------
    counts : (O,P,E',2,K), which the draws come from.
    size : draws used, taken evenly.
    """
    array = np.asarray(counts)
    kept = array[:, :, sensing(array)]
    by_truth = np.asarray(kept.any(axis=(2, 4)))  # (O,P,2)
    shown = kept.sum(axis=3).astype(float)  # (O,P,E,K)
    mean, s = draws.rows()
    shown[:, youden(mean.mean(axis=0)) <= 0] = 0
    picked = np.linspace(0, len(mean) - 1, min(size, len(mean))).astype(int)
    each = np.array(
        [[log_likelihood(shown, mean[i, :, :, t], s[i, :, :, t]) for t in (0, 1)] for i in picked]
    )  # (S,2,O,P,E)
    epsilon, truth, odds = draws.epsilon[picked], by_truth[..., 1], _base_log_odds(by_truth)
    known = np.asarray(by_truth.any(axis=-1))  # (O,P)
    seen = known[..., None] & (shown.sum(axis=-1) > 0)  # (O,P,E)
    own = np.broadcast_to(truth[..., None], seen.shape)
    together = odds + _log_ratio(each.sum(axis=-1), truth, epsilon)
    single = odds[..., None] + _log_ratio(each, own, epsilon)
    return Beliefs(expit(single[seen]), own[seen], expit(together[known]), truth[known])


def _log_ratio(scores: Array, truth: NDArray[np.bool_], epsilon: Array) -> Array:
    """Compute the log likelihood ratio of the truths without the object; scores (S,2,...)."""
    mixed = epsilon.reshape(-1, *(1 for _ in scores.shape[1:]))
    with np.errstate(divide="ignore"):
        scores = np.logaddexp(scores + np.log1p(-mixed), scores[:, ::-1] + np.log(mixed))
    weight = -np.where(truth, scores[:, 1], scores[:, 0])
    false, true = logsumexp(scores + weight[:, None], axis=0)
    return np.asarray(true - false)


def _base_log_odds(by_truth: NDArray[np.bool_]) -> Array:
    """Return the log-odds (O,P) of the other objects' base rate, (n+ + 1) / (n + 2)."""
    others = by_truth.sum(axis=0) - by_truth + 1.0  # (O,P,2)
    return np.asarray(np.log(others[..., 1] / others[..., 0]))

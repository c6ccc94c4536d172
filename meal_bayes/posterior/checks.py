"""Checks of a posterior by the data it comes from: predicted percepts, held-out beliefs."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logsumexp

from meal_bayes.perception.confusion import youden
from meal_bayes.posterior.draws import replicate, rows_of, sensing
from meal_bayes.posterior.pointwise import log_likelihood

Array = NDArray[np.float64]


class Prediction(NamedTuple):
    """Numbers of "yes" among the n percepts that most objects have, observed and predicted.

    Cases (object, attribute, behavior) by truth and number of yes, observed (2,n+1) and of S
    replicates (S,2,n+1); and the fraction (2,) of replicates that vary at least as much.
    """

    observed: NDArray[np.int64]
    predicted: NDArray[np.int64]
    p_values: Array


class Beliefs(NamedTuple):
    """Pr(true) of each object's attributes, learned without the object, beside their truth.

    `each` (n,) is after all recordings of one behavior, for every behavior; `together` (m,) after
    all recordings of all behaviors.
    """

    each: Array
    each_truth: NDArray[np.bool_]
    together: Array
    together_truth: NDArray[np.bool_]


def predictive_check(
    draws: xr.Dataset, counts: ArrayLike, rng: np.random.Generator, *, size: int = 200
) -> Prediction:
    """Compare the numbers of "yes" of each object with those predicted of new objects.

    The draws come from counts (O,P,E',2,K); `size` replicates are drawn. Pairs with Youden's J <= 0
    are left out.
    """
    array = np.asarray(counts)
    sensed = array[:, :, sensing(array)]
    number = sensed.sum(axis=-1)
    n = int(np.bincount(number[number > 0]).argmax())
    positive = youden(sensed.sum(axis=0).astype(float)) > 0  # (P,E)
    full = (number == n) & positive[..., None]  # (O,P,E,2)
    replicates = replicate(draws, array, rng, size=size)
    observed, variance = _yes(sensed, full, n)
    predicted, variances = zip(*(_yes(percepts, full, n) for percepts in replicates), strict=True)
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


def beliefs_without_itself(draws: xr.Dataset, counts: ArrayLike, *, size: int = 400) -> Beliefs:
    """Compute beliefs in each object's attributes as if it had not been learned from.

    Draws are weighted by 1 / Pr(the object's percepts | truth, draw), which removes the object from
    the posterior, up to the error of importance sampling: it is largest for objects that surprise a
    small data set. The prior is the base rate of the others. Pairs with Youden's J <= 0 are left
    out. Of the draws, which come from counts (O,P,E',2,K), `size` are taken evenly.
    """
    array = np.asarray(counts)
    sensed = array[:, :, sensing(array)]
    by_truth = np.asarray(sensed.any(axis=(2, 4)))  # (O,P,2)
    shown = sensed.sum(axis=3).astype(float)  # (O,P,E,K)
    mean, s, epsilon = rows_of(draws)
    shown[:, youden(mean.mean(axis=0)) <= 0] = 0
    picked = np.linspace(0, len(mean) - 1, min(size, len(mean))).astype(int)
    each = np.array(
        [[log_likelihood(shown, mean[i, :, :, t], s[i, :, :, t]) for t in (0, 1)] for i in picked]
    )  # (S,2,O,P,E)
    others = by_truth.sum(axis=0) - by_truth + 1.0  # (O,P,2), for the base rate (n+ + 1) / (n + 2)
    truth, odds = by_truth[..., 1], np.log(others[..., 1] / others[..., 0])
    known = np.asarray(by_truth.any(axis=-1))  # (O,P)
    seen = known[..., None] & (shown.sum(axis=-1) > 0)  # (O,P,E)
    truths = np.broadcast_to(truth[..., None], seen.shape)
    together = odds + _log_ratio(each.sum(axis=-1), truth, epsilon[picked])
    single = odds[..., None] + _log_ratio(each, truths, epsilon[picked])
    return Beliefs(expit(single[seen]), truths[seen], expit(together[known]), truth[known])


def _log_ratio(scores: Array, truth: NDArray[np.bool_], epsilon: Array) -> Array:
    """Compute the log likelihood ratio of the truths without the object; scores (S,2,...)."""
    mixed = epsilon.reshape(-1, *(1 for _ in scores.shape[1:]))
    with np.errstate(divide="ignore"):
        scores = np.logaddexp(scores + np.log1p(-mixed), scores[:, ::-1] + np.log(mixed))
    weight = -np.where(truth, scores[:, 1], scores[:, 0])
    false, true = logsumexp(scores + weight[:, None], axis=0)
    return np.asarray(true - false)

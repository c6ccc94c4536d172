"""Checks of a posterior with the data it comes from: predicted percepts, held-out beliefs.

ArviZ compares models by the log-likelihood of cases under each draw. A case is all percepts of one
attribute of one object, by all behaviors, so that models with and without dependent percepts can be
compared. The object's own rows theta are integrated out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, gammaln, logsumexp

from meal_bayes.arrays import Bools, Floats, Ints, yes_of
from meal_bayes.domain.domain import PRIOR_OBJECTS
from meal_bayes.perception.confusion import informative
from meal_bayes.posterior.draws import replicate, rows_of
from meal_bayes.posterior.grid import AS_INFINITE

Beliefs = dict[str, tuple[Floats, Bools]]  # Pr(true), beside the truth


class Prediction(NamedTuple):
    """How many percepts say yes, observed and predicted, for objects with the usual number n.

    Attributes
    ----------
    observed : Ints
        (2,n+1) number of (object, attribute, behavior) by truth and number of yes.
    predicted : Ints
        (S,2,n+1) the same for S replicates.
    p_values : Floats
        (2,) fraction of replicates whose variance is at least the observed one.
    """

    observed: Ints
    predicted: Ints
    p_values: Floats


def predictive_check(draws: xr.Dataset, counts: ArrayLike, rng: np.random.Generator) -> Prediction:
    """Compare how often percepts of each object say yes with predictions for new objects.

    The draws come from counts (O,P,E,2,K). Uninformative pairs are left out.
    """
    sensed = np.asarray(counts)
    number = sensed.sum(axis=-1)
    n = int(np.bincount(number[number > 0]).argmax())  # one histogram needs one number of percepts
    tells = informative(sensed.sum(axis=0).astype(float))  # (P,E)
    full = (number == n) & tells[..., None]  # (O,P,E,2)
    replicates = replicate(draws, sensed, rng)
    observed, variance = _yes(sensed, full, n)
    predicted, variances = zip(*(_yes(percepts, full, n) for percepts in replicates), strict=True)
    p_values = (np.array(variances) >= variance).mean(axis=0)
    return Prediction(observed, np.stack(predicted), p_values)


def _yes(counts: Ints, full: Bools, n: int) -> tuple[Ints, Floats]:
    """Count (2,n+1) objects by truth and number of yes, and their variance (2,) within rows."""
    yes = yes_of(counts)  # (O,P,E,2)
    table = np.stack([np.bincount(yes[..., t][full[..., t]], minlength=n + 1) for t in (0, 1)])
    size = np.maximum(full.sum(axis=0), 1)
    center = (yes * full).sum(axis=0) / size
    squares = (full * (yes - center) ** 2).sum(axis=(0, 1, 2))
    return table, squares / np.maximum(full.sum(axis=(0, 1, 2)), 1)


def beliefs_without_itself(draws: xr.Dataset, counts: ArrayLike, *, size: int = 400) -> Beliefs:
    """Compute Pr(true) for the attributes of each object, learned without the object.

    The posterior without an object is approximated by importance sampling: draws are weighted by
    1 / Pr(percepts of the object | truth, draw). The error is largest for unusual objects in small
    data sets. The prior is the base rate of the other objects. Uninformative pairs are left out.

    Parameters
    ----------
    draws : xr.Dataset
        Draws from the posterior given the counts.
    counts : ArrayLike
        (O,P,E,2,K) percepts of each object.
    size : int
        Number of draws that are used, evenly spaced.

    Returns
    -------
    dict[str, tuple[Floats, Bools]]
        Pr(true) and truth: under "each" (n,) after all recordings of one behavior, under "together"
        (m,) after all recordings of all behaviors.
    """
    sensed = np.asarray(counts)
    by_truth = np.asarray(sensed.any(axis=(2, 4)))  # (O,P,2)
    percepts = sensed.sum(axis=3).astype(float)  # (O,P,E,K)
    mean, s, epsilon = rows_of(draws)
    percepts[:, ~informative(mean.mean(axis=0))] = 0
    picked = np.linspace(0, len(mean) - 1, min(size, len(mean))).astype(int)
    scores = np.array(
        [
            [log_likelihood(percepts, mean[i, :, :, t], s[i, :, :, t]) for t in (0, 1)]
            for i in picked
        ]
    )  # (S,2,O,P,E)
    # The base rate of the others, as odds.
    smoothed = by_truth.sum(axis=0) - by_truth + PRIOR_OBJECTS  # (O,P,2)
    prior_log_odds = np.log(smoothed[..., 1] / smoothed[..., 0])
    truth = by_truth[..., 1]
    labeled = np.asarray(by_truth.any(axis=-1))  # (O,P)
    perceived = labeled[..., None] & (percepts.sum(axis=-1) > 0)  # (O,P,E)
    truths = np.broadcast_to(truth[..., None], perceived.shape)
    # Behaviors are independent given the truth and the draw, so their log-likelihoods add up.
    together = prior_log_odds + _log_ratio(scores.sum(axis=-1), truth, epsilon[picked])
    single = prior_log_odds[..., None] + _log_ratio(scores, truths, epsilon[picked])
    return {
        "each": (expit(single[perceived]), truths[perceived]),
        "together": (expit(together[labeled]), truth[labeled]),
    }


def _log_ratio(scores: Floats, truth: Bools, epsilon: Floats) -> Floats:
    """Compute the log likelihood ratio of the truths without the object; scores (S,2,...)."""
    misperceived = epsilon.reshape(-1, *(1 for _ in scores.shape[1:]))  # (S,1,...)
    by_truth = _misperceived(scores, scores[:, ::-1], misperceived)
    # Importance weights 1 / Pr(the object's percepts | its truth, draw) take the object out.
    weight = -np.where(truth, by_truth[:, 1], by_truth[:, 0])
    false, true = logsumexp(by_truth + weight[:, None], axis=0)
    return np.asarray(true - false)


def _misperceived(by_truth: Floats, by_other: Floats, epsilon: Floats) -> Floats:
    """Compute ln Pr(percepts) if a fraction epsilon of the objects has the other truth's rows.

    The result is ln((1 - eps) e^by_truth + eps e^by_other). The same model is used by
    `hierarchical.build_model`, `predict_yes`, `draws.replicate` and `draws.summarize_draws`.
    """
    with np.errstate(divide="ignore"):  # ln 0, where no object is misperceived
        return np.asarray(np.logaddexp(np.log1p(-epsilon) + by_truth, np.log(epsilon) + by_other))


class Cases(NamedTuple):
    """The U cases: all percepts of one attribute of one object with a known label.

    Attributes
    ----------
    names : list[str]
        (U,) "object: attribute".
    attribute, truth : NDArray[np.intp]
        (U,) positions of the attributes, and their truth values.
    counts : Ints
        (U,E,K) percepts by the behaviors that sense.
    """

    names: list[str]
    attribute: NDArray[np.intp]
    truth: NDArray[np.intp]
    counts: Ints

    @property
    def yes(self) -> xr.DataArray:
        """Number of percepts of each case that say yes, (U,)."""
        return xr.DataArray(yes_of(self.counts).sum(axis=1), {"case": self.names})


def cases_of(counts: ArrayLike, objects: Sequence[str], attributes: Sequence[str]) -> Cases:
    """List the cases of counts (O,P,E,2,K)."""
    sensed = np.asarray(counts)
    by_truth = np.asarray(sensed.any(axis=(2, 4)))  # (O,P,2)
    o, p = np.nonzero(by_truth.any(axis=-1))
    names = [f"{objects[i]}: {attributes[j]}" for i, j in zip(o.tolist(), p.tolist(), strict=True)]
    return Cases(names, p, by_truth[o, p, 1].astype(np.intp), sensed[o, p].sum(axis=2))


def pointwise_log_likelihood(draws: xr.Dataset, cases: Cases) -> xr.Dataset:
    """Compute ln Pr(percepts of a case | draw) in nats, (chain, draw, case), rows integrated out.

    The variable has the name `yes`, like the observed and the predicted data, because ArviZ matches
    the three by name.
    """
    mean, s, epsilon = rows_of(draws)
    evidence = np.zeros((len(mean), len(cases.names), 2))  # of each truth
    for attribute in np.unique(cases.attribute):
        members = np.flatnonzero(cases.attribute == attribute)
        for e in range(cases.counts.shape[1]):
            # Many objects have equal counts: each distinct vector (V,K) is scored once.
            vectors, vector_of = np.unique(cases.counts[members, e], axis=0, return_inverse=True)
            rows = mean[:, None, attribute, e]  # (C*S,1,2,K)
            weight = s[:, None, attribute, e]
            scores = log_likelihood(vectors[:, None].astype(float), rows, weight)  # (C*S,V,2)
            evidence[:, members] += scores[:, vector_of.ravel()]
    case = np.arange(len(cases.names))
    of_truth = evidence[:, case, cases.truth]
    of_other = evidence[:, case, 1 - cases.truth]
    return _by_case(_misperceived(of_truth, of_other, epsilon[:, None]), draws, cases)


def predict_yes(draws: xr.Dataset, cases: Cases, rng: np.random.Generator) -> xr.Dataset:
    """Draw how many percepts say yes for new objects like the cases, (chain, draw, case).

    Each draw makes a row theta ~ Dirichlet(s m) for each behavior; only its Pr(yes) is needed. A
    misperceived object has the rows of the other truth.
    """
    mean, s, epsilon = rows_of(draws)
    number = cases.counts.sum(axis=2)  # (U,E)
    yes = yes_of(mean)  # (C*S,P,E,2)
    drawn = np.empty((len(mean), len(number)), np.int64)
    for out, rate, weight, swap in zip(drawn, yes, s, epsilon, strict=True):
        truth = cases.truth ^ (rng.random(len(number)) < swap)
        m = rate[cases.attribute, :, truth].clip(1e-9, 1 - 1e-9)  # (U,E)
        a = np.minimum(weight[cases.attribute, :, truth], AS_INFINITE)
        out[:] = rng.binomial(number, rng.beta(a * m, a * (1 - m))).sum(axis=1)
    return _by_case(drawn, draws, cases)


def _by_case(values: ArrayLike, draws: xr.Dataset, cases: Cases) -> xr.Dataset:
    coords = {"chain": draws["chain"], "draw": draws["draw"], "case": cases.names}
    shape = [len(along) for along in coords.values()]
    return xr.Dataset({"yes": (list(coords), np.reshape(values, shape))}, coords)


def log_likelihood(counts: Floats, mean: Floats, precision: Floats) -> Floats:
    """Compute the log-probability (...,P,E) of a sequence of percepts with counts (...,P,E,K).

    The distribution is Dirichlet-multinomial with rows `mean` (P,E,K) and `precision` (P,E), or
    arrays that broadcast with the counts. With an infinite precision, percepts are independent
    (Eq. 8).
    """
    independent = np.isinf(precision)
    s = np.where(independent, 1.0, precision)
    alpha = s[..., None] * mean
    urn = gammaln(s) - gammaln(s + counts.sum(axis=-1))
    urn = urn + (gammaln(alpha + counts) - gammaln(alpha)).sum(axis=-1)
    return np.asarray(np.where(independent, (counts * np.log(mean)).sum(axis=-1), urn))

"""The log-likelihood, and the prediction, of each object's percepts under each draw.

An object's percepts of one attribute, of all behaviors together, are one unit, so that models with
dependent percepts can be compared with models without. Its rows theta are integrated out.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from meal_bayes.posterior.draws import rows_of, sensing

Array = NDArray[np.float64]


class Units(NamedTuple):
    """The percepts of one attribute of one object, whose label is known: U units.

    Names (U,) are "object: attribute"; attributes (U,) columns; counts (U,E,K) those of the
    behaviors that sense.
    """

    names: list[str]
    attribute: NDArray[np.intp]
    truth: NDArray[np.intp]
    counts: NDArray[np.int64]

    @property
    def yes(self) -> xr.DataArray:
        """How many percepts of each unit say yes, (U,)."""
        number = self.counts[..., self.counts.shape[2] // 2 :].sum(axis=(1, 2))
        return xr.DataArray(number, {"unit": self.names})


def units_of(counts: ArrayLike, objects: Sequence[str], attributes: Sequence[str]) -> Units:
    """List the units of counts (O,P,E',2,K)."""
    array = np.asarray(counts)
    sensed = array[:, :, sensing(array)]
    by_truth = np.asarray(sensed.any(axis=(2, 4)))  # (O,P,2)
    o, p = np.nonzero(by_truth.any(axis=-1))
    names = [f"{objects[i]}: {attributes[j]}" for i, j in zip(o.tolist(), p.tolist(), strict=True)]
    return Units(names, p, by_truth[o, p, 1].astype(np.intp), sensed[o, p].sum(axis=2))


def pointwise_log_likelihood(draws: xr.Dataset, units: Units) -> xr.Dataset:
    """Compute ln Pr(percepts of a unit | draw), nats, (chain, draw, unit), rows integrated out.

    It is called `yes`, as what is observed and predicted, so that ArviZ puts the three together.
    """
    mean, s, epsilon = rows_of(draws)
    evidence = np.zeros((len(mean), len(units.names), 2))  # of each truth
    for attribute in np.unique(units.attribute):
        members = np.flatnonzero(units.attribute == attribute)
        for e in range(units.counts.shape[1]):
            each, place = np.unique(units.counts[members, e], axis=0, return_inverse=True)
            rows, weight = mean[:, None, attribute, e], s[:, None, attribute, e]  # (C*S,1,2,K)
            scores = log_likelihood(each[:, None].astype(float), rows, weight)  # (C*S,V,2)
            evidence[:, members] += scores[:, place.ravel()]
    unit = np.arange(len(units.names))
    right, wrong = evidence[:, unit, units.truth], evidence[:, unit, 1 - units.truth]
    with np.errstate(divide="ignore"):
        values = np.logaddexp(np.log1p(-epsilon[:, None]) + right, np.log(epsilon[:, None]) + wrong)
    return _by_unit(values, draws, units)


def predict_yes(draws: xr.Dataset, units: Units, rng: np.random.Generator) -> xr.Dataset:
    """Draw how many percepts say yes of new objects in place of the units', (chain, draw, unit).

    Each draw makes a row theta ~ Dirichlet(s m) for each behavior, of which only Pr(yes) matters;
    a misperceived object shows the other truth's rows.
    """
    mean, s, epsilon = rows_of(draws)
    number = units.counts.sum(axis=2)  # (U,E)
    yes = mean[..., mean.shape[-1] // 2 :].sum(axis=-1)  # (C*S,P,E,2)
    drawn = np.empty((len(mean), len(number)), np.int64)
    for out, rate, weight, swap in zip(drawn, yes, s, epsilon, strict=True):
        truth = units.truth ^ (rng.random(len(number)) < swap)
        m = rate[units.attribute, :, truth].clip(1e-9, 1 - 1e-9)  # (U,E)
        a = np.minimum(weight[units.attribute, :, truth], 1e9)
        out[:] = rng.binomial(number, rng.beta(a * m, a * (1 - m))).sum(axis=1)
    return _by_unit(drawn, draws, units)


def _by_unit(values: ArrayLike, draws: xr.Dataset, units: Units) -> xr.Dataset:
    shape = (draws.sizes["chain"], draws.sizes["draw"], len(units.names))
    dims = ("chain", "draw", "unit")
    coords = {"chain": draws["chain"], "draw": draws["draw"], "unit": units.names}
    return xr.Dataset({"yes": (dims, np.reshape(values, shape))}, coords)


def log_likelihood(
    counts: NDArray[np.float64], mean: NDArray[np.float64], precision: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Compute the log-probability (...,P,E) of a sequence of percepts with counts (...,P,E,K).

    Dirichlet-multinomial with rows `mean` (P,E,K) and `precision` (P,E), or what broadcasts with
    the counts; inf takes percepts as independent (Eq. 8).
    """
    known = np.isinf(precision)
    s = np.where(known, 1.0, precision)
    alpha = s[..., None] * mean
    urn = gammaln(s) - gammaln(s + counts.sum(axis=-1))
    urn = urn + (gammaln(alpha + counts) - gammaln(alpha)).sum(axis=-1)
    return np.asarray(np.where(known, (counts * np.log(mean)).sum(axis=-1), urn))

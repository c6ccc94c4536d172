"""The log-likelihood of each object's percepts under each draw, for leave-one-out checks.

An object's percepts of one attribute, of all behaviors together, are one unit, so that models with
dependent percepts can be compared with models without. Its rows theta are integrated out.
"""

from collections.abc import Sequence

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaln

from meal_bayes.posterior.draws import rows_of, sensing

Array = NDArray[np.float64]


def pointwise_log_likelihood(
    draws: xr.Dataset, counts: ArrayLike, objects: Sequence[str]
) -> xr.DataArray:
    """Compute the log-likelihood of every object and attribute whose label is known.

    Parameters
    ----------
    draws : C chains of S draws.
    counts : (O,P,E',2,K), the percepts that they were drawn from.
    objects : (O,) names.

    Returns
    -------
    (chain, draw, unit) ln Pr(percepts of a unit | draw), nats; units are "object: attribute".
    """
    array = np.asarray(counts)
    kept = array[:, :, sensing(array)]
    by_truth, shown = np.asarray(kept.any(axis=(2, 4))), kept.sum(axis=3)  # (O,P,2), (O,P,E,K)
    o, p = np.nonzero(by_truth.any(axis=-1))
    mean, s, epsilon = rows_of(draws)
    evidence = np.zeros((len(mean), len(o), 2))  # of each truth
    for attribute in np.unique(p):
        members = np.flatnonzero(p == attribute)
        for e in range(shown.shape[2]):
            each, place = np.unique(shown[o[members], attribute, e], axis=0, return_inverse=True)
            rows, weight = mean[:, None, attribute, e], s[:, None, attribute, e]  # (C*S,1,2,K)
            scores = log_likelihood(each[:, None].astype(float), rows, weight)  # (C*S,V,2)
            evidence[:, members] += scores[:, place.ravel()]
    truth, unit = by_truth[o, p, 1].astype(int), np.arange(len(o))
    right, wrong = evidence[:, unit, truth], evidence[:, unit, 1 - truth]
    with np.errstate(divide="ignore"):
        values = np.logaddexp(np.log1p(-epsilon[:, None]) + right, np.log(epsilon[:, None]) + wrong)
    attributes = draws["attribute"].values
    names = [f"{objects[i]}: {attributes[j]}" for i, j in zip(o.tolist(), p, strict=True)]
    shape = (draws.sizes["chain"], draws.sizes["draw"], len(names))
    return xr.DataArray(values.reshape(shape), {"unit": names}, ("chain", "draw", "unit"))


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

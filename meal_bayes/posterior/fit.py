"""Fit the confusion matrices to named percept counts; groups of data for ArviZ's checks."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import compress
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from meal_bayes.arrays import Floats
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.look import level_names
from meal_bayes.posterior import checks
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.draws import (
    TRUTHS,
    Sampling,
    draw_grid,
    draw_prior,
    log_prior,
    sensing,
)
from meal_bayes.posterior.grid import prior_of
from meal_bayes.seeds import stream

METHODS = ("grid", "pymc")
MODELS = ("same", "crossed")


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorFit:
    """Draws of the confusion matrices, with the data and settings of the fit.

    Attributes
    ----------
    counts : xr.DataArray
        Percepts (object, attribute, behavior, truth, level) of the behaviors that sense.
    draws : xr.Dataset
        `mean` and `dispersion` of each row; see `posterior.draws`.
    statistics : xr.Dataset
        Statistics of the sampler; empty if the draws come from the grid.
    prior : NDArray[np.float64]
        (P,E,2,K) prior Dirichlet parameters of the means.
    model : str
        Name of the model, "same" or "crossed".
    seed : int
        Seed of the draws and of all predictions from them.
    """

    counts: xr.DataArray
    draws: xr.Dataset
    statistics: xr.Dataset
    prior: Floats
    model: str
    seed: int


def named_counts(
    counts: ArrayLike,
    *,
    objects: Sequence[str],
    attributes: Sequence[str],
    behaviors: Sequence[str],
) -> xr.DataArray:
    """Name the axes of percept counts (O,P,E,2,K), and drop behaviors without percepts."""
    numbers = np.asarray(counts)
    senses = sensing(numbers)
    coords: dict[str, Any] = {
        "object": list(objects),
        "attribute": list(attributes),
        "behavior": list(compress(behaviors, senses)),
        "truth": list(TRUTHS),
        "level": list(level_names(numbers.shape[-1])),
    }
    return xr.DataArray(numbers[:, :, senses], coords)


def fit_posterior(
    counts: xr.DataArray,
    *,
    method: str = "grid",
    model: str = "same",
    prior_scale: float = 1.0,
    sampling: Sampling | None = None,
    progress: Callable[[int, int], None] | None = None,
) -> PosteriorFit:
    """Draw from the posterior of the confusion matrices given named percept counts.

    Parameters
    ----------
    counts : xr.DataArray
        Counts as returned by `named_counts`.
    method : str
        "grid" for numerical integration on a grid, or "pymc" for MCMC sampling (NUTS).
    model : str
        "same" or "crossed"; the grid method can only fit "same" (see `posterior.hierarchical`).
    prior_scale : float
        Factor by which the weight of the learned prior of the rows is multiplied.
    sampling : Sampling, optional
        Draws, chains and seed.
    progress : Callable[[int, int], None], optional
        Function that is called with the number of finished steps of the sampler and of all steps.

    Raises
    ------
    SettingsError
        If the method or the model is unknown, or the model is "crossed" and the method is "grid".
    """
    check_method(method, model)
    sampling = sampling or Sampling()
    percepts = counts.values
    prior = prior_scale * prior_of(percepts)
    named: dict[str, Any] = {
        "attributes": counts["attribute"].values.tolist(),
        "behaviors": counts["behavior"].values.tolist(),
        "prior": prior,
    }
    if method == "grid":
        rng = stream(sampling.seed, "posterior")
        draws = draw_grid(percepts, rng, **named, draws=sampling.draws, chains=sampling.chains)
        statistics = xr.Dataset()
    else:
        from meal_bayes.posterior.hierarchical import fit_hierarchical  # noqa: PLC0415  PyMC

        draws, statistics = fit_hierarchical(
            percepts, **named, model=model, sampling=sampling, progress=progress
        )
    return PosteriorFit(counts, draws, statistics, prior, model=model, seed=sampling.seed)


def check_method(method: str, model: str) -> None:
    """Raise `SettingsError` for an unknown method or model, or a model the method cannot fit."""
    for kind, name, choices in (("method", method, METHODS), ("model", model, MODELS)):
        if name not in choices:
            raise SettingsError(unknown(kind, name, choices))
    if method == "grid" and model != "same":
        raise SettingsError(
            "--model crossed needs --method pymc, because the grid method cannot fit this model."
        )


def arviz_groups(fit: PosteriorFit) -> dict[str, xr.Dataset]:
    """Return the groups of an InferenceData other than the draws: data, predictions, likelihoods.

    Only the model "same" has groups of the prior, and only NUTS has statistics of the sampler.
    """
    draws = fit.draws
    attributes = counted_names(fit.counts, "attribute")
    objects = counted_names(fit.counts, "object")
    cases = checks.cases_of(fit.counts.values, objects, attributes)
    predictive_rng = stream(fit.seed, "units")
    groups = {
        "observed_data": xr.Dataset({"yes": cases.yes}),
        "constant_data": xr.Dataset({"counts": fit.counts, "telling": telling_of(fit.counts)}),
        "posterior_predictive": checks.predict_yes(draws, cases, predictive_rng),
        "log_likelihood": checks.pointwise_log_likelihood(draws, cases),
    }
    if fit.model == "same":
        prior_draws = draw_prior(draws, fit.prior, stream(fit.seed, "prior"))
        prior_rng = stream(fit.seed, "unseen")
        groups["prior"] = prior_draws
        groups["prior_predictive"] = checks.predict_yes(prior_draws, cases, prior_rng)
        groups["log_prior"] = log_prior(draws, fit.prior)
    if fit.statistics:
        groups["sample_stats"] = fit.statistics
    return groups


def telling_of(counts: xr.DataArray) -> xr.DataArray:
    """Return the probability that each pair is informative (P,E'), with names."""
    posterior = ConfusionPosterior.from_objects(counts.values)
    names = {name: counts[name] for name in ("attribute", "behavior")}
    return xr.DataArray(posterior.telling, names, tuple(names))


def counted_names(counts: xr.DataArray, axis: str) -> list[str]:
    """Return the names along an axis of named counts."""
    return [str(name) for name in counts[axis].values]

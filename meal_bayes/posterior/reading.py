"""Reading a posterior that is given as draws: our own file, or a model of somebody's own."""

import os
from itertools import compress
from typing import Any

import numpy as np
import xarray as xr

from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError
from meal_bayes.files import path_text
from meal_bayes.look import level_names
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.draws import ROW, TRUTHS, sensing, summarize_draws


def posterior_from(idata: Any, domain: Domain) -> ConfusionPosterior:
    """Summarize a posterior of NUTS or of the grid for agents, in the order of a domain.

    Parameters
    ----------
    idata : str, Path, InferenceData or DataTree
        The file posterior.nc of `meal-bayes posterior`, what ArviZ reads from it, or a model of
        one's own: its group posterior has the variables named in `draws`, its observed data the
        percept counts (object, attribute, behavior, truth, level). Truths are named "false" and
        "true", levels as `level_names` has them; the order of dimensions and names is free.
    domain : Domain
        Every attribute of it must have been fitted.

    Raises
    ------
    DataError
        Draws or counts that are not there, mean nothing, or lack an attribute of the domain.
    DomainError
        A behavior that the domain does not have.
    """
    if isinstance(idata, str | os.PathLike):
        from meal_bayes.posterior.idata import load_netcdf  # noqa: PLC0415  imports ArviZ

        idata = load_netcdf(path_text(idata))
    draws = _named_draws(idata)
    _check_draws(draws)
    names = {dim: list(map(str, draws[dim].values)) for dim in (*ROW, "level")}
    for name in domain.attributes:
        if name not in names["attribute"]:
            raise DataError(f"The posterior: {unknown('attribute', name, names['attribute'])}")
    names["attribute"] = list(domain.attributes)
    names["behavior"] = sorted(names["behavior"], key=domain.behavior_index)
    percepts = _percept_counts(idata, names)
    # Behaviors that sense nothing have no rows in the draws, and no percepts in the counts.
    counts = percepts.reindex(behavior=list(domain.behavior_names), fill_value=0).values.astype(int)
    behaviors = list(compress(domain.behavior_names, sensing(counts)))
    return summarize_draws(draws.sel(attribute=names["attribute"], behavior=behaviors), counts)


def _named_draws(idata: Any) -> xr.Dataset:
    """Read the draws, with dimensions, truths and levels in our order."""
    try:
        group = idata["posterior"]
        dims = ("chain", "draw", *ROW)
        names = {"truth": list(TRUTHS), "level": list(level_names(group["mean"].sizes["level"]))}
        mean = group["mean"].transpose(*dims, "level").sel(names)
        along = {dim: mean[dim].values for dim in ROW}
        dispersion = group["dispersion"].transpose(*dims).sel(along)
        draws = xr.Dataset({"mean": mean, "dispersion": dispersion})
        if "misperception" in group:
            draws["misperception"] = group["misperception"].transpose("chain", "draw")
    except Exception as fault:  # whatever xarray or pandas raise, such as of doubled names
        raise DataError(
            f"This holds no posterior of confusion matrices ({fault}); expected `mean` "
            "(chain, draw, attribute, behavior, truth, level) and `dispersion` with truths "
            "'false', 'true' and our names of levels; make one with `meal-bayes posterior`, or "
            "fit_hierarchical and to_idata."
        ) from None
    return draws


def _check_draws(draws: xr.Dataset) -> None:
    mean = draws["mean"]
    misperception = draws.get("misperception", np.zeros(1))
    if not mean.size:
        raise DataError("The posterior has no draws.")
    if not ((mean >= 0).all() and np.allclose(mean.sum("level"), 1.0, atol=1e-6)):
        raise DataError("Rows of `mean` must be probabilities that sum to 1 over the levels.")
    if not (draws["dispersion"] > 0).all():  # nor NaN
        raise DataError("`dispersion` must be above 0 everywhere; inf: objects are alike.")
    if not ((misperception >= 0) & (misperception <= 1)).all():
        raise DataError("`misperception` must be a probability.")


def _percept_counts(idata: Any, names: dict[str, list[str]]) -> xr.DataArray:
    """Read the percepts that draws come from, (object, attribute, behavior, truth, level)."""
    percepts: xr.DataArray | None = None
    missing: Exception | None = None
    # PyMC keeps what a model observed in one group, and what it was merely given in the other.
    for group in ("observed_data", "constant_data"):
        try:
            percepts = idata[group]["counts"].transpose("object", *ROW, "level").sel(names)
            break
        except Exception as fault:  # whatever xarray or pandas raise
            missing = fault
    if percepts is None:
        raise DataError(
            f"The posterior comes without the percepts it was drawn from ({missing}); give "
            "to_idata the counts (object, attribute, behavior, truth, level) as observed_data."
        )
    if not percepts.any():
        raise DataError("The percept counts are all 0; give those that the draws come from.")
    if not ((percepts >= 0) & (percepts % 1 == 0)).all():
        raise DataError("Percept counts must be whole numbers >= 0.")
    return percepts

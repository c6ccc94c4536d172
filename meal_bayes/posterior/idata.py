"""Draws for ArviZ: named dimensions, convergence, netCDF. Only this module imports ArviZ.

It works with ArviZ 0.x (InferenceData) and 1.x (xarray's DataTree). They build groups in different
ways, but groups have the same names: `found["posterior"]["mean"].sel(attribute="heavy")`.

`posterior_from` reads a posterior from draws: a file of this package, or draws of a user's model.
"""

import os
import warnings
from collections.abc import Mapping
from functools import partial
from itertools import compress
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from meal_bayes.arrays import Floats
from meal_bayes.cache import writable_caches
from meal_bayes.digests import package_version
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError
from meal_bayes.files import checked_path, draft_of, path_text, regular_file
from meal_bayes.look import level_names
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.posterior.draws import ROW, TRUTHS, sensing, summarize_draws

with writable_caches(), warnings.catch_warnings():  # ArviZ 0.x announces 1.0 on import
    warnings.filterwarnings("ignore", r"\s*ArviZ is undergoing", FutureWarning)
    from meal_bayes import canvas  # noqa: F401, I001  before ArviZ, which imports matplotlib
    import arviz
az: Any = arviz  # not typed

_PARETO = 0.7
_CLASSIC = az.__version__.startswith("0.")


def to_idata(posterior: xr.Dataset, **groups: xr.Dataset) -> Any:
    """Build an InferenceData (ArviZ 0.x) or DataTree (1.x) of draws and further groups.

    It has the attributes of the posterior, which name settings and versions.
    """
    of_group = {"posterior": posterior, **groups}
    if _CLASSIC:
        return az.InferenceData(attrs=dict(posterior.attrs), **of_group)
    tree = xr.DataTree.from_dict(of_group)
    tree.attrs.update(posterior.attrs)
    return tree


def summary_of(idata: Any) -> Any:
    """Return ArviZ's summary of all entries of all variables as a data frame, not rounded."""
    return az.summary(idata, round_to="none")


def convergence(summary: Any) -> Any:
    """Return the largest R-hat and the smallest effective sample sizes of each variable."""
    variable = summary.index.str.partition("[").get_level_values(0).rename("variable")
    entries = summary.assign(entries=1).groupby(variable, sort=False)
    r_hat = partial(pd.Series.max, skipna=False)  # R-hat is NaN if a chain does not move
    worst = {"entries": "sum", "r_hat": r_hat, "ess_bulk": "min", "ess_tail": "min"}
    return entries.agg(worst).reset_index()


def attributes_of(config: Mapping[str, object]) -> dict[str, str]:
    """Return settings and versions as attributes of a file with draws."""
    library = {"inference_library": "meal_bayes", "inference_library_version": package_version()}
    attributes = {**library, "arviz_version": az.__version__, **config}
    return {name: str(value) for name, value in attributes.items() if value is not None}


def unreliable(idata: Any) -> dict[str, float]:
    """Return the Pareto k of cases whose leave-one-out prediction is unreliable.

    Cases are those of `checks`. Their Pareto k is above min(1 - 1 / log10(draws), 0.7)
    [Vehtari2024]: without such a case, the posterior would be very different.
    """
    with warnings.catch_warnings():  # ArviZ warns without naming the cases
        warnings.simplefilter("ignore")
        loo = az.loo(idata, pointwise=True)
    k = loo.pareto_k
    draws = idata["posterior"].sizes["chain"] * idata["posterior"].sizes["draw"]
    bad = k[k.values > min(1 - 1 / np.log10(draws), _PARETO)]
    return dict(zip(bad["case"].values.tolist(), bad.values.tolist(), strict=True))


def save_netcdf(idata: Any, path: str | Path) -> Path:
    """Write a netCDF file and return its path; raise `OutputError` if it cannot be written.

    The file appears under its name only when it is complete.
    """
    target = checked_path("The posterior", path)
    with draft_of(target) as draft:
        idata.to_netcdf(str(draft), engine="h5netcdf")
    return target


def load_netcdf(path: str | Path) -> Any:
    """Read a file of `save_netcdf`; raise `DataError` if it is missing or has another format."""
    file = regular_file("The posterior", path)
    try:
        return az.from_netcdf(str(file))
    except (OSError, ValueError) as fault:
        raise DataError(f"{path} is not a netCDF file of a posterior: {fault}.") from None


# --- Files of posteriors


def posterior_from(idata: Any, domain: Domain) -> ConfusionPosterior:
    """Summarize draws of a posterior for agents, in the order of a domain.

    Parameters
    ----------
    idata : str, Path, InferenceData or DataTree
        The file posterior.nc of `meal-bayes posterior`, the object that ArviZ reads from it, or
        draws of your own model. The group `posterior` has the variables named in
        `posterior.draws`; the group `observed_data` has the percept `counts` (object, attribute,
        behavior, truth, level). The group `constant_data` may have `telling` (attribute, behavior),
        the probability that a pair is informative, if the draws are for informative pairs;
        otherwise the draws are used as they are. Truths are named "false" and "true", and levels as
        by `level_names`. Dimensions and names may have any order.
    domain : Domain
        Domain whose attributes were all fitted.

    Raises
    ------
    DataError
        If draws or counts are missing or invalid, or an attribute of the domain was not fitted.
    DomainError
        If a behavior is not in the domain.
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
    fitted = {"attribute": names["attribute"], "behavior": behaviors}
    return summarize_draws(draws.sel(fitted), counts, _telling(idata, fitted))


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
            f"This is not a posterior of confusion matrices ({fault}); expected `mean` "
            "(chain, draw, attribute, behavior, truth, level) and `dispersion` with truths "
            "'false', 'true' and the names of levels of this package; make one with "
            "`meal-bayes posterior`, or with fit_hierarchical and to_idata."
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
        raise DataError(
            "`dispersion` must be above 0 everywhere; inf means that objects are alike."
        )
    if not ((misperception >= 0) & (misperception <= 1)).all():
        raise DataError("`misperception` must be a probability.")


def _telling(idata: Any, fitted: dict[str, list[str]]) -> Floats | None:
    """Read the probability that pairs are informative (P,E'); None if there is none."""
    try:
        found = idata["constant_data"]["telling"]
    except KeyError:
        return None
    try:
        telling = found.transpose("attribute", "behavior").sel(fitted).values.astype(float)
    except (KeyError, ValueError) as fault:
        raise DataError(
            f"`telling` must have the dimensions attribute and behavior: {fault}."
        ) from None
    if not ((telling >= 0) & (telling <= 1)).all():
        raise DataError("`telling` must contain probabilities.")
    return np.asarray(telling)


def _percept_counts(idata: Any, names: dict[str, list[str]]) -> xr.DataArray:
    """Read the percept counts of the draws, (object, attribute, behavior, truth, level)."""
    percepts: xr.DataArray | None = None
    missing: Exception | None = None
    # PyMC stores observed data in the first group, and constant data in the second.
    for group in ("observed_data", "constant_data"):
        try:
            percepts = idata[group]["counts"].transpose("object", *ROW, "level").sel(names)
            break
        except Exception as fault:  # whatever xarray or pandas raise
            missing = fault
    if percepts is None:
        raise DataError(
            f"The posterior does not contain the percept counts from which it was computed "
            f"({missing}); pass the counts (object, attribute, behavior, truth, level) to "
            "to_idata as observed_data."
        )
    if not percepts.any():
        raise DataError(
            "The percept counts are all 0; give the counts from which the draws were computed."
        )
    if not ((percepts >= 0) & (percepts % 1 == 0)).all():
        raise DataError("Percept counts must be whole numbers >= 0.")
    return percepts

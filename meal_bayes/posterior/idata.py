"""Draws for ArviZ: named dimensions, convergence, netCDF; the one module that imports ArviZ.

Works with ArviZ 0.x (InferenceData) and 1.x (xarray's DataTree), which differ in how groups are
built and share their names: `found["posterior"]["mean"].sel(attribute="heavy")`.
"""

import warnings
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from meal_bayes.cache import writable_caches
from meal_bayes.errors import DataError
from meal_bayes.files import checked_path, draft_of
from meal_bayes.version import package_version

with writable_caches(), warnings.catch_warnings():  # ArviZ 0.x announces 1.0 on import
    warnings.filterwarnings("ignore", r"\s*ArviZ is undergoing", FutureWarning)
    import arviz
az: Any = arviz  # not typed

_PARETO = 0.7
_CLASSIC = az.__version__.startswith("0.")


def to_idata(posterior: xr.Dataset, **groups: xr.Dataset) -> Any:
    """Build an InferenceData (0.x) or DataTree (1.x) of draws, and of groups by their names."""
    of_group = {"posterior": posterior, **groups}
    return az.InferenceData(**of_group) if _CLASSIC else xr.DataTree.from_dict(of_group)


def summary_of(idata: Any) -> Any:
    """Return ArviZ's summary of every entry of every variable, a data frame, unrounded."""
    return az.summary(idata, round_to="none")


def convergence(summary: Any) -> Any:
    """Return the largest R-hat and the smallest effective sample sizes of each variable."""
    variable = summary.index.str.partition("[").get_level_values(0).rename("variable")
    entries = summary.assign(entries=1).groupby(variable, sort=False)
    r_hat = partial(pd.Series.max, skipna=False)  # a chain that stands still has none
    worst = {"entries": "sum", "r_hat": r_hat, "ess_bulk": "min", "ess_tail": "min"}
    return entries.agg(worst).reset_index()


def attributes_of(config: Mapping[str, object]) -> dict[str, str]:
    """Return what made the draws, as attributes of a file: settings and versions."""
    library = {"inference_library": "meal_bayes", "inference_library_version": package_version()}
    attributes = {**library, "arviz_version": az.__version__, **config}
    return {name: str(value) for name, value in attributes.items() if value is not None}


def unreliable(idata: Any) -> dict[str, float]:
    """Return the Pareto k of the cases whose leave-one-out prediction cannot be trusted.

    Cases are those of `checks`. They are above min(1 - 1 / log10(draws), 0.7) [Vehtari2024]:
    without such an object the posterior would be another.
    """
    with warnings.catch_warnings():  # it says so, and names none
        warnings.simplefilter("ignore")
        loo = az.loo(idata, pointwise=True)
    k = loo.pareto_k
    draws = idata["posterior"].sizes["chain"] * idata["posterior"].sizes["draw"]
    bad = k[k.values > min(1 - 1 / np.log10(draws), _PARETO)]
    return dict(zip(bad["case"].values.tolist(), bad.values.tolist(), strict=True))


def save_netcdf(idata: Any, path: str | Path) -> Path:
    """Write netCDF; the file is there when it is whole, or an `OutputError` says why not."""
    target = checked_path("The posterior", path)
    with draft_of(target) as draft:
        idata.to_netcdf(str(draft), engine="h5netcdf")
    return target


def load_netcdf(path: str | Path) -> Any:
    """Read what `save_netcdf` wrote; a `DataError` where there is none."""
    try:
        return az.from_netcdf(str(checked_path("The posterior", path)))
    except (OSError, ValueError) as fault:
        raise DataError(f"{path} is no posterior in netCDF: {fault}.") from None

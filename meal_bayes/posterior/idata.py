"""Draws for ArviZ: named dimensions, convergence, netCDF; the one module that imports ArviZ.

Works with ArviZ 0.x (InferenceData) and 1.x (xarray's DataTree), which differ in how groups are
built and share their names: `found["posterior"]["mean"].sel(attribute="heavy")`.
"""

import warnings
from collections.abc import Mapping
from importlib import util
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.cache import writable_caches
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.files import draft_of
from meal_bayes.posterior.draws import Draws

with writable_caches(), warnings.catch_warnings():  # ArviZ 0.x announces 1.0 on import
    warnings.filterwarnings("ignore", r"\s*ArviZ is undergoing", FutureWarning)
    import arviz
az: Any = arviz  # not typed

_ENGINES = {"h5netcdf": ("h5netcdf", "h5py"), "netcdf4": ("netCDF4",)}
_CLASSIC = az.__version__.startswith("0.")


class Convergence(NamedTuple):
    """The worst of one variable's entries."""

    variable: str
    entries: int
    r_hat: float
    ess_bulk: float
    ess_tail: float


def to_idata(
    draws: Draws,
    *,
    observed: Mapping[str, tuple[tuple[str, ...], ArrayLike]] | None = None,
    predicted: Mapping[str, tuple[tuple[str, ...], ArrayLike]] | None = None,
    log_likelihood: Mapping[str, tuple[tuple[str, ...], ArrayLike]] | None = None,
    coords: Mapping[str, ArrayLike] | None = None,
) -> Any:
    """Build an InferenceData (0.x) or DataTree (1.x) of draws.

    Parameters
    ----------
    draws : become the groups posterior and sample_stats.
    observed, predicted, log_likelihood : name -> (dims, values), for the groups observed_data,
        posterior_predictive and log_likelihood; the values of the last two have chain and draw
        before their dims. `az.loo` needs the last.
    coords : names along dims that the draws do not have.
    """
    groups: dict[str, dict[str, Any]] = {"posterior": {}, "sample_stats": dict(draws.statistics)}
    dims: dict[str, list[str]] = {}
    parts = (("posterior", draws.variables), ("observed_data", observed or {}),
             ("posterior_predictive", predicted or {}),
             ("log_likelihood", log_likelihood or {}))  # fmt: skip
    for group, variables in parts:
        for name, (along, values) in variables.items():
            groups.setdefault(group, {})[name] = np.asarray(values)
            dims[name] = list(along)
    names = {
        key: list(np.asarray(value)) for key, value in {**draws.coords, **(coords or {})}.items()
    }
    full = {group: variables for group, variables in groups.items() if variables}
    if _CLASSIC:
        return az.from_dict(**full, coords=names, dims=dims)
    return az.from_dict(full, coords=names, dims=dims)


def convergence(idata: Any) -> list[Convergence]:
    """Return the largest R-hat and the smallest effective sample sizes of each variable."""
    posterior = idata["posterior"]
    found = []
    for name in posterior.data_vars:
        values = {str(name): np.asarray(posterior[name].values)}
        one = az.from_dict(values) if _CLASSIC else az.from_dict({"posterior": values})
        worst = (
            float(np.max(az.rhat(one)[name])),
            float(np.min(az.ess(one, method="bulk")[name])),
            float(np.min(az.ess(one, method="tail")[name])),
        )
        chains, draws = values[str(name)].shape[:2]
        found.append(Convergence(str(name), values[str(name)].size // (chains * draws), *worst))
    return found


def summary_csv(idata: Any) -> str:
    """Return ArviZ's summary of every entry of every variable, as CSV, unrounded."""
    return str(az.summary(idata, round_to="none").to_csv())


def save_netcdf(idata: Any, path: str | Path) -> Path:
    """Write netCDF; the file is there when it is whole.

    Raises
    ------
    OutputError : the file cannot be written.
    SettingsError : no library that writes groups of netCDF is installed.
    """
    target, engine = Path(path), _engine()
    with draft_of(target) as draft:
        idata.to_netcdf(str(draft), engine=engine)
    return target


def load_netcdf(path: str | Path) -> Any:
    """Read what `save_netcdf` wrote.

    Raises
    ------
    DataError
        No such file, or none that holds groups of netCDF.
    """
    try:
        return az.from_netcdf(str(path))
    except (OSError, ValueError) as fault:
        raise DataError(f"{path} is no posterior in netCDF: {fault}.") from None


def _engine() -> str:
    """Choose the library that writes netCDF with groups."""
    for name, modules in _ENGINES.items():
        if all(util.find_spec(module) for module in modules):
            return name
    raise SettingsError("netCDF needs two packages; get them with: pip install h5netcdf h5py")

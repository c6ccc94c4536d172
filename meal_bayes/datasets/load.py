"""`load_dataset`: the recordings of a domain, public or a user's own, by name."""

from collections.abc import Callable
from pathlib import Path

from meal_bayes.datasets.csv_folder import load_csv_folder
from meal_bayes.datasets.cy101 import load_cy101
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.download import fetch
from meal_bayes.datasets.ispy32 import load_ispy32
from meal_bayes.datasets.roc36 import load_roc36
from meal_bayes.datasets.sources import find_folder
from meal_bayes.domain import Domain, load_domain
from meal_bayes.errors import SettingsError

_LOADERS: dict[str, Callable[[Domain, Path], Dataset]] = {
    "roc36": load_roc36,
    "ispy32": load_ispy32,
    "cy101": load_cy101,
}


def load_dataset(name: str | Path, *, root: str | Path | None = None) -> Dataset:
    """Load the recordings that fit a domain.

    Parameters
    ----------
    name : a shipped domain, or the path of your own domain table (TOML).
    root : folder of the files. Public data: a folder mirror or a clone of the repository; without
        it they are downloaded once and checked. Own data: the folder of CSV files.

    Raises
    ------
    SettingsError : no such domain, or own data without `root`.
    DataError : files that do not hold what their layout promises.
    DownloadError : files that cannot be downloaded.
    """
    if str(name).endswith(".npz"):
        raise SettingsError(
            f"{name} is a percept table, which holds no recordings; give the domain (a shipped "
            "name, or the path of its TOML) and, for your own, the folder of the CSV files."
        )
    domain = load_domain(name)
    loader = _LOADERS.get(domain.data)
    if loader is None:
        if root is None:
            raise SettingsError(
                f"Domain {domain.name!r} has no public recordings (those are {list(_LOADERS)}); "
                "give root=<folder of your CSV files>, or make data with make_synthetic."
            )
        return load_csv_folder(domain, Path(root))
    if root is None:
        root = fetch(domain.data)
    return loader(domain, find_folder(domain.data, Path(root)))

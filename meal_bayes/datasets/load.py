"""`load_dataset`: the recordings of a domain, public or a user's own, by name."""

from pathlib import Path

from meal_bayes.datasets.csv_folder import load_csv_folder
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.download import fetch
from meal_bayes.datasets.sources import SOURCES, find_folder
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError


def load_dataset(name: str | Path, *, root: str | Path | None = None) -> Dataset:
    """Load the recordings that fit a domain.

    Parameters
    ----------
    name : str | Path
        A shipped domain, or the path of your own domain table (TOML).
    root : str | Path | None
        Folder of the files. Public data: a folder mirror or a clone of the repository; without it
        they are downloaded once and checked. Own data: the folder of CSV files.

    Raises
    ------
    SettingsError
        No such domain, or own data without `root`.
    DataError
        Files that do not hold what their layout promises.
    DownloadError
        Files that cannot be downloaded.
    """
    if str(name).endswith(".npz"):
        raise SettingsError(
            f"{name} is a percept table, which holds no recordings; give the domain (a shipped "
            "name, or the path of its TOML) and, for your own, the folder of the CSV files."
        )
    domain = load_domain(name)
    if domain.data not in SOURCES:
        if root is None:
            raise SettingsError(
                f"Domain {domain.name!r} has no public recordings (those are {list(SOURCES)}); "
                "give root=<folder of your CSV files>, or make data with make_synthetic."
            )
        return load_csv_folder(domain, Path(root))
    if root is None:
        root = fetch(domain.data)
    return SOURCES[domain.data].load(domain, find_folder(domain.data, Path(root)))

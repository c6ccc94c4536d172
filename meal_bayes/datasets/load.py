"""`load_dataset`: the recordings of a domain, public or one's own, by name."""

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
    name : a shipped domain, or the path of a domain table of one's own (TOML).
    root : where the files lie. Public data: a folder mirror or a clone of the repository; without
        it they are downloaded once and checked. One's own data: the folder of CSV files.

    Raises
    ------
    SettingsError : no such domain, or one's own data without `root`.
    DataError : files that do not hold what their layout promises.
    DownloadError : files that cannot be had.
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

"""The sources of the public data sets: repository, commit, folder, loader."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from meal_bayes.datasets.cy101 import load_cy101
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.ispy32 import load_ispy32
from meal_bayes.datasets.roc36 import load_roc36
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, SettingsError


@dataclass(frozen=True, slots=True)
class Source:
    """The folder of a data set in a public repository, at one pinned commit.

    Attributes
    ----------
    repository : str
        Such as owner/name.
    recordings : str
        Name of the folder in `folder` that holds the feature files.
    load : Callable[[Domain, Path], Dataset]
        Reads a domain's data set from a folder.
    """

    repository: str
    commit: str
    folder: str
    recordings: str
    load: Callable[[Domain, Path], Dataset]

    @property
    def path(self) -> str:
        """Path below a mirror base: owner/name/commit/folder."""
        return f"{self.repository}/{self.commit}/{self.folder}"


_POMDP = ("shiqizhang6/perception_pomdp", "4ab4abf1a47ce184f0327d3c143533d482c2604c")
_LEARNING = ("keke-220/Predicate_Learning", "62b9e1efa8b4cf990a68c3526a9ae872d8a6b1ad")
SOURCES = {
    "roc36": Source(*_POMDP, "data/icra2014", "sensorimotor_features", load_roc36),
    "ispy32": Source(*_POMDP, "data/ijcai2016", "corl_features", load_ispy32),
    "cy101": Source(*_LEARNING, "data/cy101", "normalized_data_without_noobject", load_cy101),
}


def source(data: str) -> Source:
    """Return the source of a data set; `SettingsError` where there is none of that name."""
    if data not in SOURCES:
        raise SettingsError(unknown("data set", data, SOURCES))
    return SOURCES[data]


def find_folder(data: str, root: Path) -> Path:
    """Return a data set's folder below a mirror, in a clone of its repository, or at `root`."""
    home = source(data)
    for folder in (root / home.path, root / home.folder, root):
        if (folder / home.recordings).is_dir():
            return folder
    raise DataError(
        f"{root}: found no recordings of {data}; expected {home.path}/{home.recordings} below it; "
        f"give a folder mirror, a clone of {home.repository}, or leave root out to download."
    )

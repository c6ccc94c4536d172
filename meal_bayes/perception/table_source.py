"""The percept table of a data set: from the package, from the user, or computed once.

Only `TableSource.of` decides where the table of a data set comes from. It returns the domain, the
file of the table (which may not exist yet), and a digest of everything that the user can change.
`TableSource.load` computes and writes the table if necessary.
"""

import logging
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from pathlib import Path

from meal_bayes.datasets import (
    Dataset,
    PerceptTable,
    cache_folder,
    load_dataset,
    load_percepts,
    percepts,
    save_percepts,
)
from meal_bayes.datasets.csv_files import csv_files
from meal_bayes.datasets.percepts import shipped_path
from meal_bayes.datasets.sources import SOURCES, find_folder
from meal_bayes.digests import digest_of, package_version
from meal_bayes.domain import Domain, domain_table, load_domain, unknown
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.files import checked_path, file_name, path_text
from meal_bayes.perception.fitting import build_percept_table
from meal_bayes.perception.settings import NAMED

log = logging.getLogger("meal_bayes.perception")


@dataclass(frozen=True, slots=True)
class TableSource:
    """Where the percept table of a data set comes from.

    Equal sources have equal tables.

    Attributes
    ----------
    name : str
        Name with which `of` finds the source again, also in another process: the name of a domain
        in the package, or a path.
    perception : str
        Method of the classifiers: "default" or "paper".
    fingerprint : str
        Digest of everything that you can change: your own table, or your own domain with its
        recordings. The digest is empty for data in the package.
    domain : Domain
        Domain with the behaviors and attributes.
    path : Path
        File of the table (.npz). The name of a computed table in the cache depends on the
        recordings, the domain, the version of the package and the code of its perception.
    """

    name: str
    perception: str
    fingerprint: str
    domain: Domain = field(compare=False)
    path: Path = field(compare=False)
    _recordings: Dataset | str | None = field(default=None, compare=False, repr=False)
    _root: Path | None = field(default=None, compare=False, repr=False)
    _table: PerceptTable | None = field(default=None, compare=False, repr=False)

    @classmethod
    def of(
        cls,
        data: str | Path | Dataset | PerceptTable,
        perception: str = "default",
        *,
        root: str | Path | None = None,
    ) -> "TableSource":
        """Return the source of the percept table of a data set.

        Parameters
        ----------
        data : str | Path | Dataset | PerceptTable
            Name of a domain in the package; path of your own domain (TOML), with the folder of its
            recordings as `root`; a percept table or the path of its .npz file; or recordings.
        perception : str
            "default", or "paper" for the method of Sect. 4.2.
        root : str | Path | None
            Folder of your own recordings.

        Raises
        ------
        SettingsError
            If the method is unknown, the table was made by another method, the folder of the
            recordings is missing, or a folder is given but not needed.
        """
        if perception not in NAMED:
            raise SettingsError(unknown("perception", perception, NAMED))
        if isinstance(data, Dataset):
            return cls._of_recordings(data, perception)
        if isinstance(data, PerceptTable):
            return cls._of_table(data, perception)
        name = str(path_text(data))
        if name.endswith(".npz"):
            return cls._of_file(name, perception, root)
        folder = None if root is None else checked_path("root", root)
        return cls._of_domain(name, perception, folder)

    @classmethod
    def _of_domain(cls, name: str, perception: str, root: Path | None) -> "TableSource":
        """Return the source of a domain in the package, or of a user's domain with recordings."""
        domain = load_domain(name)
        is_own = name.endswith(".toml")
        if root is not None and not is_own:
            raise SettingsError(
                f"The percepts of {name!r} need no folder of recordings; leave root out, or give "
                "the path of your own domain (TOML)."
            )
        public = domain.data in SOURCES
        content = fingerprint(name, root)
        # Tables in the package need no recordings; all others are computed from recordings.
        if root is None and public and perception == "default":
            return cls(name, perception, content, domain, shipped_path(domain))
        if root is None and not public:
            raise SettingsError(
                f"{name} has no public recordings; give the path of its TOML and, as root, the "
                "folder of its CSV files, or a percept table (.npz)."
            )
        path = _computed_path(domain, perception, content)
        # A table from a user's recordings is found again by its path, which needs no folder.
        found_by = name if root is None else str(path)
        recordings = name if is_own else domain.data
        return cls(found_by, perception, content, domain, path, _recordings=recordings, _root=root)

    @classmethod
    def _of_file(cls, name: str, perception: str, root: str | Path | None) -> "TableSource":
        """Return the source of a table in a file."""
        if root is not None:
            raise SettingsError(f"{name} is already a percept table; leave root out.")
        content = fingerprint(name)
        table = _read(name, content)
        _check_method(table, perception, name)
        return cls(name, perception, content, table.domain, Path(name), _table=table)

    @classmethod
    def _of_table(cls, table: PerceptTable, perception: str) -> "TableSource":
        """Return the source of a table in memory, which `load` saves in the cache."""
        _check_method(table, perception, "dataset")
        content = table.digest()
        path = _cached(f"{file_name(table.domain.data)}-given-{content[:12]}.npz")
        return cls(str(path), perception, content, table.domain, path, _table=table)

    @classmethod
    def _of_recordings(cls, dataset: Dataset, perception: str) -> "TableSource":
        """Return the source of recordings in memory, from which `load` computes the table."""
        content = dataset.digest()
        path = _computed_path(dataset.domain, perception, content)
        return cls(str(path), perception, content, dataset.domain, path, _recordings=dataset)

    def load(
        self,
        *,
        on_progress: Callable[[int, int], None] | None = None,
        on_note: Callable[[str], None] | None = None,
    ) -> PerceptTable:
        """Return the table; a table that was computed or given in memory is saved to `path`.

        Parameters
        ----------
        on_progress : Callable[[int, int], None] | None
            Function that is called with the number of finished behaviors and of all behaviors while
            a table is computed.
        on_note : Callable[[str], None] | None
            Function that is called with a message before a table is computed; by default, the
            message is logged.
        """
        if self._table is not None:
            # Other processes of a run read the table from this file.
            if not self.path.is_file():
                save_percepts(self._table, self.path)
            return self._table
        recordings = self._recordings
        if recordings is None:
            return load_percepts(self.path, domain=self.domain)
        if self.path.is_file():
            try:
                return load_percepts(self.path, domain=self.domain)
            except DataError:
                log.warning("%s is damaged, and is made again", self.path)
        if isinstance(recordings, str):
            recordings = load_dataset(recordings, root=self._root)
        (on_note or log.info)(
            f"computing the {self.perception} percepts of {self.domain.name} from its "
            f"recordings, once; kept in {self.path}"
        )
        table = build_percept_table(recordings, perception=self.perception, progress=on_progress)
        save_percepts(table, self.path)
        return load_percepts(self.path, domain=self.domain)


def fingerprint(dataset: str, root: str | Path | None = None) -> str:
    """Compute a digest of a user's table, or of a user's domain and its recordings.

    A domain is resolved with all domains that it extends. Domains in the package are part of the
    code and not of this digest, which is then empty.
    """
    parts = list[object]()
    dataset = str(path_text(dataset))
    path = Path(dataset)
    if path.is_file() and path.suffix == ".npz":
        parts.append(path)
    elif path.is_file() and path.suffix == ".toml":
        parts.append(domain_table(load_domain(dataset)))
    folder = None if root is None else checked_path("root", root)
    if folder is not None and folder.is_dir():
        domain = load_domain(dataset)
        if domain.data in SOURCES:
            parts.append(find_folder(domain.data, folder))
        else:  # by their names, too: two files may change places
            files = sorted(csv_files(domain, folder))
            parts += [[file.name for file in files if file.is_file()], *files]
    return digest_of(*parts) if parts else ""


@lru_cache(maxsize=4)
def _read(path: str, content: str) -> PerceptTable:
    """Read a table; the cache is invalidated if the content of the file changes."""
    return load_percepts(path)


def _check_method(table: PerceptTable, perception: str, name: str) -> None:
    """Raise `SettingsError` if a table was not made by the requested method."""
    if perception == "default":
        return
    method = table.provenance.get("perception", "").split(" ")[0]  # it comes first
    if f"={perception}," not in method:
        raise SettingsError(
            f"{name} is a percept table of another method; leave perception out, or "
            "make another with `meal-bayes data percepts --dataset DOMAIN.toml --root "
            f"FOLDER --perception {perception}`."
        )


def _computed_path(domain: Domain, perception: str, content: str) -> Path:
    """Return the file of a table that is computed from recordings with this digest."""
    # With other code or another version of the package, the percepts may be different.
    code = digest_of(Path(__file__).resolve().parent, Path(percepts.__file__).resolve())[:8]
    parts = [file_name(domain.data), perception, package_version(), code, content[:12]]
    return _cached(f"{'-'.join(filter(None, parts))}.npz")


def _cached(name: str) -> Path:
    return cache_folder() / "percepts" / name

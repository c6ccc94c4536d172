"""Which percept table a data set has: the one that ships, the user's own, or one computed once.

What a data set is, is asked here alone, by `TableSource.of`. The answer is a value: the domain, the
file that holds the table (or will), and a digest of what the user can change of it. Nothing is
computed or written before `TableSource.load`.
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
from meal_bayes.datasets.percepts import shipped_path
from meal_bayes.datasets.sources import SOURCES, find_folder
from meal_bayes.digests import digest_of, package_version
from meal_bayes.domain import Domain, domain_table, load_domain, unknown
from meal_bayes.errors import SettingsError
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
        By which `of` finds it again, in another process too: of a shipped domain, or a path.
    perception : str
        The method that made it, or will: "default" or "paper".
    fingerprint : str
        Digest of what the user can change: an own table, or an own domain with its recordings;
        empty of what ships.
    domain : Domain
        Behaviors and attributes.
    path : Path
        The table's file (.npz); of one to compute, in the cache, named by the recordings, the
        domain, the package's version and the code of its perception.
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
        """Find out where the table of a data set comes from.

        Parameters
        ----------
        data : str | Path | Dataset | PerceptTable
            A shipped domain, a domain of one's own (the path of a TOML, with the folder of its
            recordings as `root`), a table (itself, or the path of an .npz), or recordings.
        perception : str
            "default", or "paper" for the method of Sect. 4.2.
        root : str | Path | None
            Folder of one's own recordings.

        Raises
        ------
        SettingsError
            A method that is none, a table made by another method, recordings that no folder is
            given for, or a folder that is not needed.
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
        """Return the source of a shipped domain, or of one's own with its recordings."""
        domain = load_domain(name)
        is_own = name.endswith(".toml")
        if root is not None and not is_own:
            raise SettingsError(
                f"The percepts of {name!r} need no folder of recordings; leave root out, or give "
                "the path of a domain of your own (TOML)."
            )
        public = domain.data in SOURCES
        content = fingerprint(name, root)
        # What ships needs no recordings; every other table is computed from some.
        if root is None and public and perception == "default":
            return cls(name, perception, content, domain, shipped_path(domain))
        if root is None and not public:
            raise SettingsError(
                f"{name} has no public recordings; give the path of its TOML and, as root, the "
                "folder of its CSV files, or a percept table (.npz)."
            )
        path = _computed_path(domain, perception, content)
        # With recordings of one's own it is found again by its path, which needs no folder.
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
        """Return the source of a table in memory, which `load` keeps in the cache."""
        _check_method(table, perception, "dataset")
        content = table.digest()
        path = _cached(f"{file_name(table.domain.data)}-given-{content[:12]}.npz")
        return cls(str(path), perception, content, table.domain, path, _table=table)

    @classmethod
    def _of_recordings(cls, dataset: Dataset, perception: str) -> "TableSource":
        """Return the source of recordings in memory, of which `load` computes the table."""
        content = dataset.digest()
        path = _computed_path(dataset.domain, perception, content)
        return cls(str(path), perception, content, dataset.domain, path, _recordings=dataset)

    def load(
        self,
        *,
        on_progress: Callable[[int, int], None] | None = None,
        on_note: Callable[[str], None] | None = None,
    ) -> PerceptTable:
        """Return the table; where it is computed or given in memory, it is kept in `path`.

        Parameters
        ----------
        on_progress : Callable[[int, int], None] | None
            Called with behaviors done and in all, while a table is computed.
        on_note : Callable[[str], None] | None
            Called with a line that says that one is; logged by default.
        """
        if self._table is not None:
            # Other processes of a run read it there.
            if not self.path.is_file():
                save_percepts(self._table, self.path)
            return self._table
        if self._recordings is not None and not self.path.is_file():
            recordings = self._recordings
            if isinstance(recordings, str):
                recordings = load_dataset(recordings, root=self._root)
            (on_note or log.info)(
                f"computing the {self.perception} percepts of {self.domain.name} from its "
                f"recordings, once; kept in {self.path}"
            )
            table = build_percept_table(
                recordings, perception=self.perception, progress=on_progress
            )
            save_percepts(table, self.path)
        return load_percepts(self.path, domain=self.domain)


def fingerprint(dataset: str, root: str | Path | None = None) -> str:
    """Compute a digest of a table or domain of one's own and its recordings.

    A domain counts as it is after all that it extends; nothing of a shipped one, which is code.
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
        data = load_domain(dataset).data
        if data in SOURCES:
            parts.append(find_folder(data, folder))
        else:
            parts.extend(sorted(folder.glob("*.csv")))
    return digest_of(*parts) if parts else ""


@lru_cache(maxsize=4)
def _read(path: str, content: str) -> PerceptTable:
    """Read a table once for each content that its file has had."""
    return load_percepts(path)


def _check_method(table: PerceptTable, perception: str, name: str) -> None:
    """Refuse a table that another method made than the one that was asked for by name."""
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
    """Name the file of a table that is computed from recordings of this content."""
    # With other code, or another version of the package, the percepts may be others.
    code = digest_of(Path(__file__).resolve().parent, Path(percepts.__file__).resolve())[:8]
    parts = [file_name(domain.data), perception, package_version(), code, content[:12]]
    return _cached(f"{'-'.join(filter(None, parts))}.npz")


def _cached(name: str) -> Path:
    return cache_folder() / "percepts" / name

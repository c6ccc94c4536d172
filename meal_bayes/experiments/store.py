"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound."""

import hashlib
import json
import logging
import platform
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path

from meal_bayes.datasets.sources import SOURCES, find_folder
from meal_bayes.domain import load_domain
from meal_bayes.domain.tables import domain_table
from meal_bayes.errors import LogError
from meal_bayes.files import file_name
from meal_bayes.trial_log import log_info

log = logging.getLogger("meal_bayes.experiments")

UNIT = 100  # trials of one agent in a file
_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn")  # whose versions may change a number


@dataclass(frozen=True, slots=True)
class Store:
    """The folder of one experiment, named by its settings and the code that ran it.

    The name changes with either, so a run that is called again finds its own units, whole, and
    nobody else's.
    """

    folder: Path

    @classmethod
    def of(cls, root: str | Path, name: str, config: Mapping[str, object]) -> "Store":
        """Name the folder of a configuration under `root`; `name` may be any text."""
        digest = digest_of(dict(config), environment())
        return cls(Path(root) / f"{file_name(name, 200)}-{digest[:8]}")

    def unit(self, agent: str, index: int) -> Path:
        """Return the path of one unit's file."""
        return self.folder / file_name(agent, 200) / f"unit-{index:04d}.mcap"


def is_whole(path: Path, *, trials: int | None = None) -> bool:
    """Check a unit's log to its end; what is damaged is warned of.

    Parameters
    ----------
    trials : int | None
        How many it must hold; any number by default.
    """
    if not path.is_file():
        return False
    try:
        found = log_info(path).trials
    except LogError as fault:
        log.warning("%s; it is made again", str(fault).partition(";")[0])
        return False
    if trials is not None and found != trials:
        log.warning("%s holds %d trials, expected %d; it is made again", path, found, trials)
        return False
    return True


def digest_of(*parts: object) -> str:
    """Compute a digest of what a result depends on.

    Parameters
    ----------
    parts : object
        JSON values; paths, by the contents of the file or of all files of the folder.
    """
    digest = hashlib.sha256()
    for part in parts:
        for piece in _pieces(part):
            digest.update(hashlib.sha256(piece).digest())
    return digest.hexdigest()


def fingerprint(dataset: str, root: str | None = None) -> str:
    """Compute a digest of a table or domain of one's own and its recordings.

    A domain counts as it is after all that it extends; nothing of a shipped one, which is code.
    """
    parts: list[object] = []
    if Path(dataset).suffix == ".npz" and Path(dataset).is_file():
        parts.append(Path(dataset))
    elif Path(dataset).suffix == ".toml" and Path(dataset).is_file():
        parts.append(domain_table(load_domain(dataset)))
    if root is not None and Path(root).is_dir():
        data = load_domain(dataset).data
        folder = find_folder(data, Path(root)) if data in SOURCES else None
        parts.extend([folder] if folder else sorted(Path(root).glob("*.csv")))
    return digest_of(*parts) if parts else ""


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Compute a digest of the package's own code and tables."""
    package = Path(__file__).resolve().parents[1]
    files = [p for p in sorted(package.rglob("*")) if p.suffix in (".py", ".toml", ".npz", ".xz")]
    names = [path.relative_to(package).as_posix() for path in files]
    return digest_of(names, *files)[:16]


def environment() -> dict[str, str]:
    """Return what may change a number beside settings: the package's code, and versions."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    python = {"python": platform.python_version(), "system": sys.platform}
    return {"meal_bayes": code_digest(), **python, **versions}


def _pieces(part: object) -> Iterator[bytes]:
    if isinstance(part, Path):
        files = [part] if part.is_file() else sorted(p for p in part.rglob("*") if p.is_file())
        for file in files:
            yield file.relative_to(part).as_posix().encode()
            yield file.read_bytes()
    else:
        yield json.dumps(part, sort_keys=True).encode()

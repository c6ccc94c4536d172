"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound."""

import hashlib
import json
import logging
import platform
import sys
from collections.abc import Mapping
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

_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn")  # whose versions may change a number


def run_folder(root: str | Path, name: str, config: Mapping[str, object]) -> Path:
    """Name the folder of an experiment under `root` by any text, its settings and its code.

    It changes with either, so a run that is called again finds its own units, whole, and nobody
    else's.
    """
    digest = digest_of(dict(config), environment())
    return Path(root) / f"{file_name(name, 200)}-{digest[:8]}"


def agent_folder(folder: Path, agent: str) -> Path:
    """Name the folder of an agent's units."""
    return folder / file_name(agent, 200)


def is_whole(path: Path, *, trials: int | None = None) -> bool:
    """Check a unit's log of so many trials to its end; what is damaged is warned of."""
    if not path.is_file():
        return False
    try:
        held = log_info(path).trials
    except LogError as fault:
        log.warning("%s; it is made again", str(fault).partition(";")[0])
        return False
    if trials is not None and held != trials:
        log.warning("%s holds %d trials, expected %d; it is made again", path, held, trials)
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
        pieces = [] if isinstance(part, Path) else [json.dumps(part, sort_keys=True).encode()]
        if isinstance(part, Path):
            files = [part] if part.is_file() else sorted(p for p in part.rglob("*") if p.is_file())
            for file in files:
                pieces += [file.relative_to(part).as_posix().encode(), file.read_bytes()]
        for piece in pieces:
            digest.update(hashlib.sha256(piece).digest())
    return digest.hexdigest()


def fingerprint(dataset: str, root: str | None = None) -> str:
    """Compute a digest of a table or domain of one's own and its recordings.

    A domain counts as it is after all that it extends; nothing of a shipped one, which is code.
    """
    parts, path = list[object](), Path(dataset)
    if path.is_file() and path.suffix in (".npz", ".toml"):
        parts.append(path if path.suffix == ".npz" else domain_table(load_domain(dataset)))
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

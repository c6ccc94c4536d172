"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound."""

import ast
import hashlib
import inspect
import json
import logging
import platform
import re
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import lru_cache
from importlib import metadata
from pathlib import Path
from types import ModuleType

from meal_bayes.datasets.sources import SOURCES, find_folder
from meal_bayes.domain import load_domain
from meal_bayes.domain.tables import domain_table
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.trial_log import Marks, count_whole

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
        digest = digest_of(dict(config), code_digest(), _versions())
        return cls(Path(root) / f"{file_name(name)}-{digest[:8]}")

    def unit(self, agent: str, index: int) -> Path:
        """File of one unit."""
        return self.folder / file_name(agent) / f"unit-{index:04d}.mcap"


def is_whole(path: Path, *, trials: int | None = None) -> bool:
    """Check a unit's log, or its table of marks, to its end; what is damaged is warned of.

    Parameters
    ----------
    trials : how many it must hold; any number by default.
    """
    if not path.is_file():
        return False
    try:
        found = _trials_of(path)
    except LogError as fault:
        log.warning("%s; it is made again", str(fault).partition(";")[0])
        return False
    if trials is not None and found != trials:
        log.warning("%s holds %d trials, expected %d; it is made again", path, found, trials)
        return False
    return True


def digest_of(*parts: object) -> str:
    """Digest what decides a result; equal results have equal ones.

    Parameters
    ----------
    parts : JSON values; paths, by the contents of the file or of all files of the folder; modules,
        and classes, functions and other objects of modules: by the source of the module and of
        all that it imports from beside it.

    Raises
    ------
    SettingsError : an object whose source is not in a file.
    """
    digest = hashlib.sha256()
    for part in parts:
        for piece in _pieces(part):
            digest.update(hashlib.sha256(piece).digest())
    return digest.hexdigest()


def file_name(text: str) -> str:
    """Make a name of a file of any text."""
    return re.sub(r"[^\w.-]+", "_", text)


def fingerprint(dataset: str, root: str | None = None) -> str:
    """Digest a table or domain of one's own and its recordings: others are another run.

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
    """Digest the package's own code and tables."""
    package = Path(__file__).resolve().parents[1]
    files = [p for p in sorted(package.rglob("*")) if p.suffix in (".py", ".toml", ".npz", ".xz")]
    names = [path.relative_to(package).as_posix() for path in files]
    return digest_of(names, *files)[:16]


def _trials_of(path: Path) -> int:
    """Count the trials of a sound file."""
    return len(Marks.load(path).cost) if path.suffix == ".csv" else count_whole(path)


def _pieces(part: object) -> Iterator[bytes]:
    if isinstance(part, Path):
        files = [part] if part.is_file() else sorted(p for p in part.rglob("*") if p.is_file())
        for file in files:
            yield file.relative_to(part).as_posix().encode()
            yield file.read_bytes()
    elif part is None or isinstance(part, str | bool | int | float | list | tuple | dict):
        yield json.dumps(part, sort_keys=True).encode()
    else:
        for file in _sources(part):
            yield file.name.encode()
            yield file.read_bytes()


def _sources(thing: object) -> list[Path]:
    """List the files that an object's code is in: its module's, and those it imports from there."""
    known = isinstance(thing, ModuleType) or hasattr(thing, "__qualname__")
    module = inspect.getmodule(thing if known else type(thing))
    file = getattr(module, "__file__", None)
    if module is None or file is None:
        raise SettingsError(f"The source of {thing!r} is in no file; put it into a module.")
    depth = module.__name__.count(".") + (Path(file).name == "__init__.py")
    folder = Path(file).resolve().parents[depth]
    found, todo = set[Path](), {Path(file).resolve()}
    while todo:
        path = todo.pop()
        found.add(path)
        todo |= set(_imported(path, folder)) - found
    return sorted(found)


def _imported(path: Path, folder: Path) -> Iterator[Path]:
    """Find the modules below a folder that a file imports."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        names = [alias.name for alias in getattr(node, "names", [])]
        if isinstance(node, ast.ImportFrom):
            above = path.parents[node.level - 1] if node.level else folder
            places = [above.joinpath(*(node.module or "").split("."))]
            places += [places[0] / name for name in names]
        elif isinstance(node, ast.Import):
            places = [folder.joinpath(*name.split(".")) for name in names]
        else:
            continue
        for place in places:
            for file in (place.with_name(f"{place.name}.py"), place / "__init__.py"):
                if file.is_file() and "site-packages" not in file.parts:
                    yield file.resolve()


def _versions() -> dict[str, str]:
    found = {"python": platform.python_version(), "system": sys.platform}
    for name in _LIBRARIES:
        found[name] = metadata.version(name)
    return found

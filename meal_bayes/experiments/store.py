"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound.

The name of a run has a digest of all that it depends on, code of the user's included. The bytes of
a pickle by value would do for that, were they equal from process to process: cloudpickle names
classes at random, and sets come in any order. So an agent's settings are digested by joblib, which
sorts, and its code by the files that it was imported from.
"""

import contextlib
import hashlib
import inspect
import logging
import platform
import sys
import uuid
from functools import partial
from importlib import metadata
from modulefinder import ModuleFinder
from pathlib import Path
from types import ModuleType
from typing import TYPE_CHECKING, Any

from joblib.hashing import NumpyHasher

from meal_bayes.agents import Agent
from meal_bayes.digests import code_digest, digest_of
from meal_bayes.errors import LogError
from meal_bayes.files import file_name
from meal_bayes.trial_log import log_info

if TYPE_CHECKING:
    from meal_bayes.experiments.config import OfflineConfig, OnlineConfig

log = logging.getLogger("meal_bayes.experiments")

_INSTALLED = {"site-packages", "dist-packages"}  # folders of pip's and of the system's
_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn")  # whose versions may change a number


def run_folder(
    root: str | Path,
    name: str,
    config: "OfflineConfig | OnlineConfig",
    *,
    ignore: tuple[str, ...] = (),
    **facts: object,
) -> Path:
    """Name the folder of an experiment under `root` by any text, its settings and its code.

    It changes with either, so a run that is called again finds its own units, whole, and nobody
    else's. Agents name folders in it: of them the user's code counts alone. Facts stand beside the
    settings; those to ignore are the ones that only say how much of the same is run.
    """
    sources = {agent.name: digest for agent in config.agents if (digest := agent_digest(agent))}
    settings = {name: value for name, value in config.as_dict().items() if name not in ignore}
    digest = digest_of({**settings, "agents": sources, **facts}, environment())
    return Path(root) / f"{file_name(name, 200)}-{digest[:8]}"


def is_whole(path: Path) -> bool:
    """Check a unit's log to its end; what is damaged is warned of."""
    try:
        return path.is_file() and log_info(path).whole
    except LogError as fault:
        log.warning("%s; it is made again", str(fault).partition(";")[0])
        return False


def environment() -> dict[str, str]:
    """Return what may change a number beside settings: the package's code, and versions."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    python = {"python": platform.python_version(), "system": sys.platform}
    return {"meal_bayes": code_digest(), **python, **versions}


def is_own(module: ModuleType) -> bool:
    """Return whether a module is the user's: it has a file, and is neither installed nor ours."""
    file = getattr(module, "__file__", None)
    if file is None or module.__name__ not in sys.modules or _INSTALLED & {*Path(file).parts}:
        return False
    return module.__name__.partition(".")[0] not in {"meal_bayes", *sys.stdlib_module_names}


def agent_digest(agent: Agent) -> str:
    """Compute a digest of an agent's settings and of the user's code that it goes by, if any."""
    hasher = _AgentHasher()
    settings = hasher.hash(agent)
    if not hasher.sources:
        return ""
    return hashlib.sha256(repr((settings, sorted(hasher.sources))).encode()).hexdigest()[:16]


class _AgentHasher(NumpyHasher):  # type: ignore[misc]  # joblib has no types
    """Digests values; functions and classes by name, and what functions are closed over."""

    def __init__(self) -> None:
        super().__init__("sha256")
        self.sources = set[str]()  # digests of the code of those that are not this package's

    def reducer_override(self, value: Any) -> Any:
        """Return how a value is digested, as `pickle.Pickler.reducer_override`."""
        code = inspect.unwrap(value) if callable(value) else value  # compiled, cached
        if isinstance(value, frozenset):
            return str, ("frozenset",), sorted(value, key=repr)
        if isinstance(code, ModuleType):
            return str, (code.__name__,)
        if code is str or not (inspect.isfunction(code) or isinstance(code, type)):
            return NotImplemented
        name = f"{code.__module__}.{code.__qualname__}"
        self.sources |= _sources(code)
        if isinstance(code, type):
            return str, (name,)
        cells = [cell.cell_contents for cell in code.__closure__ or ()]
        return str, (name,), (code.__defaults__, code.__kwdefaults__, cells)


def _sources(code: Any) -> set[str]:
    """Digest the file of a function or class, and what it imports from beside it."""
    module = sys.modules.get(code.__module__)
    top = code.__module__.partition(".")[0]
    path = Path(getattr(module, "__file__", None) or "")
    if top in {"meal_bayes", *sys.stdlib_module_names}:
        return set()
    if module is None or not path.is_file():
        try:
            return {inspect.getsource(code)}  # typed into a session
        except (OSError, TypeError):
            return {uuid.uuid4().hex}  # nothing finds it again
    files = _imported(module.__name__, path) if is_own(module) else [path]
    return {hashlib.sha256(file.read_bytes()).hexdigest() for file in {path, *files}}


def _imported(name: str, path: Path) -> list[Path]:
    levels = name.count(".") + (path.name == "__init__.py")
    finder = ModuleFinder([str(path.parents[levels])], excludes=["meal_bayes"])
    for search in (partial(finder.import_hook, name), partial(finder.run_script, str(path))):
        with contextlib.suppress(ImportError, SyntaxError, AttributeError):  # a namespace package
            search()
            break
    files: list[str | None] = [getattr(m, "__file__", None) for m in finder.modules.values()]
    return [Path(file) for file in files if file]

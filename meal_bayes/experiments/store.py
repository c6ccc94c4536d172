"""Where runs lie: logs/<experiment>/<agent>/<unit>.mcap; a unit is done when its file is sound.

The name of a run has a digest of all that it depends on: settings, versions, and of an agent that
does not ship its values and the files of its code, with what these import from beside them. A trial
is read again only where it is known to be the agent's own.
"""

import contextlib
import hashlib
import logging
import platform
import sys
import uuid
from collections.abc import Mapping
from functools import partial
from importlib import metadata
from modulefinder import ModuleFinder
from pathlib import Path
from types import FunctionType, MethodType, ModuleType
from typing import TYPE_CHECKING, Any

from meal_bayes.agents import AGENTS, Agent
from meal_bayes.digests import code_digest, digest_of
from meal_bayes.errors import LogError
from meal_bayes.files import checked_path, file_name
from meal_bayes.trial_log import log_info

if TYPE_CHECKING:
    from meal_bayes.experiments.config import OfflineConfig, OnlineConfig

log = logging.getLogger("meal_bayes.experiments")

_INSTALLED = {"site-packages", "dist-packages"}  # folders of pip's and of the system's
_LONGEST = 200  # bytes of a folder's name
_PLAIN = (bool, int, float, complex, str, bytes)
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
    sources = {agent.name: own_agent_digest(agent) for agent in config.agents}
    sources = {name: digest for name, digest in sources.items() if digest}
    settings = {name: value for name, value in config.as_dict().items() if name not in ignore}
    digest = digest_of({**settings, "agents": sources, **facts}, environment())
    return checked_path("logs", root) / f"{file_name(name, _LONGEST)}-{digest[:8]}"


def agent_folder(folder: Path, agent: str) -> Path:
    """Return where the logs of an agent lie in the folder of a run."""
    return folder / file_name(agent, _LONGEST)


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


class _UnknownError(Exception):
    """Nobody can say whether a value is the same as in another run."""


def own_agent_digest(agent: Agent) -> str:
    """Compute a digest of an agent's settings and of the user's code that it goes by.

    It is "" of an agent that ships. It is that of no other where nobody can know whether the agent
    is the same as before: it holds a function or class that was made while a program ran, or
    something without a value, such as an open file. A learner's file says less of an agent, by
    `agent_digest` of `learner/digest.py`: it is handed the agent again.
    """
    if agent == AGENTS.get(agent.name):
        return ""
    try:
        return digest_of(Description().of(agent))[:16]
    except (_UnknownError, RecursionError) as why:
        log.warning(
            "agent %r holds %s: no earlier trial is known to be its own, so the run has a folder "
            "of its own (functions and classes of a module can be known)",
            agent.name,
            why,
        )
        return uuid.uuid4().hex


class Description:
    """Describes values by lists and texts that are equal for equal values, in every process.

    What is not plain is taken apart as for a pickle, whose own bytes differ from process to
    process: sets come in any order.
    """

    def __init__(self) -> None:
        self._done: dict[int, tuple[object, object]] = {}  # by identity: a value, and what it is
        self._path: list[int] = []  # of the values that this one is in

    def of(self, value: Any) -> object:
        """Describe any value; an `_UnknownError` where that cannot be done."""
        if value is None or isinstance(value, _PLAIN):
            return [type(value).__name__, repr(value)]
        if id(value) in self._path:
            return ["again", self._path.index(id(value))]
        if id(value) not in self._done:
            self._path.append(id(value))
            self._done[id(value)] = value, [type(value).__name__, self._parts(value)]
            self._path.pop()
        return self._done[id(value)][1]

    def _parts(self, value: Any) -> object:  # noqa: PLR0911  a kind of values a line
        definition = isinstance(value, type | FunctionType) or hasattr(value, "__wrapped__")
        if definition and not isinstance(value, MethodType):
            return self._named(value)
        if isinstance(value, ModuleType):
            return [value.__name__, self._code(value, {})]
        if type(value) in (list, tuple):
            return list(map(self.of, value))
        if type(value) in (set, frozenset):
            return sorted(map(self.of, value), key=repr)
        if type(value) is dict:
            return sorted(
                ([self.of(key), self.of(entry)] for key, entry in value.items()), key=repr
            )
        try:
            reduced = value.__reduce_ex__(4)
            if isinstance(reduced, str):  # a global of this name
                return [getattr(value, "__module__", None), reduced]
            parts = [*reduced[:3], *map(list, filter(None, reduced[3:5]))]
        except Exception as fault:  # whatever it raises
            raise _UnknownError(f"{type(value).__qualname__}, which has no value") from fault
        return [self.of(type(value)), *map(self.of, parts)]

    def _named(self, value: Any) -> object:
        """Describe a function or class by its name, if it can be found by that, and its code."""
        module = sys.modules.get(value.__module__)
        name = value.__qualname__
        target: Any = module
        for part in name.split("."):
            target = getattr(target, part, None)
        if (value.__module__ != "builtins" and target is not value) or module is None:
            raise _UnknownError(f"{value.__module__}.{name}, which was made while a program ran")
        kinds = [
            kind
            for kind in getattr(value, "__mro__", ())[1:]
            if is_own(sys.modules[kind.__module__])
        ]
        return [value.__module__, name, self._code(module, vars(value)), *map(self.of, kinds)]

    def _code(self, module: ModuleType, attributes: Mapping[str, Any]) -> list[object]:
        """Describe a user's code by its files, and the plain values that a program may have set."""
        files = _sources(module)
        if not files:
            return []
        values = []
        for name, value in [*vars(module).items(), *attributes.items()]:
            if not name.startswith("__") and isinstance(
                value, (*_PLAIN, list, tuple, dict, set, frozenset)
            ):
                with contextlib.suppress(_UnknownError):
                    values.append([name, self.of(value)])
        return [sorted(files), sorted(values, key=repr)]


def _sources(module: ModuleType) -> set[str]:
    """Digest the file of a module, and of what it imports from beside it; none of what ships."""
    top = module.__name__.partition(".")[0]
    if top in {"meal_bayes", *sys.stdlib_module_names}:
        return set()
    path = Path(getattr(module, "__file__", None) or "")
    if not path.is_file():
        raise _UnknownError(f"code of {module.__name__}, which is in no file")
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

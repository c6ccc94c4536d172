"""Code of the user's that an agent goes by: its digest is in the name of a run.

The bytes of a pickle by value would do, were they equal from process to process: cloudpickle names
classes at random, and sets come in any order. So settings are digested by joblib, which sorts, and
code by the files that it was imported from.
"""

import contextlib
import hashlib
import inspect
import sys
import uuid
from collections.abc import Iterable
from functools import partial
from modulefinder import ModuleFinder
from pathlib import Path
from types import ModuleType
from typing import Any

from joblib.hashing import NumpyHasher

from meal_bayes.agents import Agent

_INSTALLED = {"site-packages", "dist-packages"}  # folders of pip's and of the system's


def is_own(module: ModuleType) -> bool:
    """Return whether a module is the user's: it has a file, and is neither installed nor ours."""
    file = getattr(module, "__file__", None)
    top = module.__name__.partition(".")[0] if file else ""
    return (
        file is not None
        and module.__name__ in sys.modules
        and top not in {"meal_bayes", *sys.stdlib_module_names}
        and not _INSTALLED & {*Path(file).parts}
    )


def agent_digests(agents: Iterable[Agent]) -> dict[str, str]:
    """Return the digest of each agent that goes by the user's code, by its name."""
    return {agent.name: digest for agent in agents if (digest := agent_digest(agent))}


def agent_digest(agent: Agent) -> str:
    """Compute a digest of an agent's settings and of the user's code that it goes by.

    Returns
    -------
    str
        16 letters and digits; empty where all code is this package's.
    """
    hasher = _AgentHasher()
    settings = hasher.hash(agent)
    if not hasher.sources:
        return ""
    return hashlib.sha256(repr((settings, sorted(hasher.sources))).encode()).hexdigest()[:16]


class _AgentHasher(NumpyHasher):  # type: ignore[misc]  # joblib has no types
    """Digests values; functions and classes by name, and what functions are closed over.

    Attributes
    ----------
    sources : set of str
        Digests of the code of those that are not this package's.
    """

    def __init__(self) -> None:
        super().__init__("sha256")
        self.sources = set[str]()

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
    top, path = code.__module__.partition(".")[0], Path(getattr(module, "__file__", None) or "")
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

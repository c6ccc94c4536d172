"""Where the code of an agent given as a value comes from: what decides its results, beside ours."""

import ast
import functools
import hashlib
import inspect
import re
import sys
import uuid
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

from meal_bayes.agents.agent import Agent

_OWN = "meal_bayes"
_ADDRESS = re.compile(r" at 0x[0-9a-f]+")


@dataclass(frozen=True, slots=True)
class Origin:
    """Modules that an agent of one's own needs.

    Attributes
    ----------
    modules : top-level modules and packages, by name, and those that they import from beside them.
    folders : where they are imported from.
    digest : of their files and of the agent's settings; empty where all code is this package's.
    """

    modules: tuple[str, ...]
    folders: tuple[str, ...]
    digest: str


def origin_of(agent: Agent) -> Origin:
    """Find the modules of an agent's planner and observation model, and digest their files."""
    digest, modules, folders = hashlib.sha256(), dict[str, None](), dict[str, None]()
    for part in _parts(agent):
        name = _module_name(part)
        if name.partition(".")[0] == _OWN:
            continue
        digest.update(f"{name} {_settings(part)}".encode())
        module = sys.modules.get(name.partition(".")[0])
        files = [] if module is None else _files(module)
        if not files:
            digest.update(_typed_in(part).encode())
        for file in files:
            digest.update(file.name.encode() + hashlib.sha256(file.read_bytes()).digest())
        if module is not None and files:
            root, main = _root(module), str(module.__file__) if name == "__main__" else ""
            found = [file for file in files if file != Path(main).resolve()]
            modules |= dict.fromkeys(file.relative_to(root).parts[0] for file in found)
            folders |= dict.fromkeys([str(root)] if found else [])
    if digest.digest() == hashlib.sha256().digest():
        return Origin((), (), "")
    flags = {field: getattr(agent, field) for field in agent.__slots__}
    digest.update(_ADDRESS.sub("", repr(flags)).encode())
    names = tuple(name.removesuffix(".py") for name in modules)
    return Origin(names, tuple(folders), digest.hexdigest()[:16])


def _parts(agent: Agent) -> Iterator[object]:
    """Yield what may be of another's making: functions, partial functions, objects in them."""
    if agent.trained_by is not None:
        yield from _parts(agent.trained_by)
    waiting: list[object] = [agent.solver, agent.observation_model, agent.exploration]
    while waiting:
        part = waiting.pop()
        if part is None:
            continue
        yield part
        if isinstance(part, functools.partial):
            waiting += [part.func, *part.args, *part.keywords.values()]
        elif hasattr(part, "planner"):
            waiting.append(part.planner)


def _module_name(part: object) -> str:
    own = part if inspect.isroutine(part) or isinstance(part, type) else type(part)
    return str(getattr(own, "__module__", None) or type(part).__module__)


def _settings(part: object) -> str:
    if inspect.isroutine(part) or isinstance(part, type):
        return str(getattr(part, "__qualname__", part))
    return _ADDRESS.sub("", f"{type(part).__qualname__} {getattr(part, '__dict__', '')} {part!r}")


def _files(module: ModuleType) -> list[Path]:
    """List the source files of a module or package, and of what it imports from beside it."""
    file = getattr(module, "__file__", None)
    if file is None or not Path(file).is_file():
        return []
    own = Path(file).resolve()
    todo = set(own.parent.rglob("*.py")) if hasattr(module, "__path__") else {own}
    found, root = set[Path](), _root(module)
    while todo:
        path = todo.pop()
        found.add(path)
        todo |= set(_imported(path, root)) - found
    return sorted(found)


def _imported(path: Path, root: Path) -> Iterator[Path]:
    """Find the files below a folder that a file imports, but what is installed, and ours."""
    try:
        nodes = list(ast.walk(ast.parse(path.read_bytes())))
    except (SyntaxError, ValueError):  # a file of a package that is no Python
        return
    for node in nodes:
        names = [alias.name for alias in getattr(node, "names", [])]
        if isinstance(node, ast.ImportFrom):
            above = path.parents[node.level - 1] if node.level else root
            places = [above.joinpath(*(node.module or "").split("."))]
            places += [places[0] / name for name in names]
        elif isinstance(node, ast.Import):
            places = [root.joinpath(*name.split(".")) for name in names]
        else:
            continue
        for place in places:
            for file in (place.with_name(f"{place.name}.py"), place / "__init__.py"):
                if file.is_file() and _beside(file.resolve(), root):
                    yield file.resolve()


def _beside(file: Path, root: Path) -> bool:
    """Check that a file is below a folder, and neither installed nor ours."""
    below = file.is_relative_to(root) and file.relative_to(root).parts[0] != _OWN
    return below and "site-packages" not in file.parts


def _root(module: ModuleType) -> Path:
    folder = Path(str(module.__file__)).resolve().parent
    return folder.parent if hasattr(module, "__path__") else folder


def _typed_in(part: object) -> str:
    """Return the source of what was typed into a session; nothing finds it again where unknown."""
    own = part if inspect.isroutine(part) or isinstance(part, type) else type(part)
    try:
        return inspect.getsource(own)
    except (OSError, TypeError):
        return uuid.uuid4().hex

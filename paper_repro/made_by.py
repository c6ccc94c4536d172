"""The digest of what makes a table: a command, and the code and data of which its numbers are made.

A change of prose or of place makes no table old: comments, docstrings, messages of errors, layout,
imports, and the file in which a function stands do not count. Neither do files that show or store
results and decide no number (`SHOWING`). Every other file of the package counts, so that a new one
is not forgotten; of a command that runs a script, the script and what it imports from its folder
count too, and of one that runs an item of the paper, its script and what items share (`SHARED`).

A change of the package that decides nothing else need not make results again: if no decision of
`benchmarks/digests.py` differs, `--carry-over` gives the results the digest of the changed code.
"""

import ast
import hashlib
import json
import shlex
import tomllib
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHOWING = (  # files and folders of the package
    "__init__.py", "__main__.py", "cache.py", "canvas.py", "cli", "digests.py", "errors.py",
    "features.py", "files.py", "gym", "look.py", "processes.py", "testing", "threads.py",
    "trial_log", "untrusted.py", "viewer",
    "datasets/bags.py", "evaluation/plots.py", "evaluation/posterior_report.py",
    "evaluation/report.py", "experiments/parallel.py", "experiments/store.py", "learner/card.py",
    "learner/find.py", "learner/saved.py", "learner/trial_logs.py", "posterior/idata.py",
    "trials/picture.py", "trials/text.py",
)  # fmt: skip
SHARED = (  # of the paper's items
    "agents.py", "frame.py", "inference.py", "offline.py", "online.py", "paper_values.toml",
    "published.py", "replay.py", "sarsop.py", "statements.py", "domains",
)  # fmt: skip
_LENGTH = 12  # hexadecimal digits
_IMPORTS = (ast.Import, ast.ImportFrom)


def made_by(command: str, root: Path = ROOT) -> str:
    """Compute the digest of a command and of the sources below a folder, in 12 digits.

    Parameters
    ----------
    command : str
        As it stands in a page: its arguments are the settings.
    root : Path
        Folder of the project.
    """
    digest = hashlib.sha256(json.dumps(shlex.split(command)).encode())
    for part in sorted(part for file in sources(command, root) for part in parts(file)):
        digest.update(part)
    return digest.hexdigest()[:_LENGTH]


def sources(command: str, root: Path = ROOT) -> Iterator[Path]:
    """Yield the files that decide the numbers of a command."""
    package = root / "meal_bayes"
    yield from (file for file in _files(package) if not _is_part(file, package, SHOWING))
    program, *words = shlex.split(command)
    if program == "python":
        yield from _with_imported(root / words[0])
    elif words[0] == "reproduce":
        items = root / "paper_repro"
        yield from (file for file in _files(items) if _is_part(file, items, SHARED))
        yield items / "items" / f"{words[1]}.py"


def _with_imported(script: Path) -> set[Path]:
    """Return a script and the files beside it that it imports, and that these import."""
    found, left = set[Path](), [script]
    while left:
        found.add(file := left.pop())
        nodes = [*ast.walk(ast.parse(file.read_bytes()))]
        names = [one.name for node in nodes if isinstance(node, ast.Import) for one in node.names]
        names += [node.module or "" for node in nodes if isinstance(node, ast.ImportFrom)]
        beside = (script.parent / f"{name}.py" for name in names if name)
        left += [file for file in beside if file.is_file() and file not in found]
    return found


def _files(folder: Path) -> Iterator[Path]:
    for file in sorted(folder.rglob("*")):
        if file.suffix in (".py", ".toml", ".npz"):
            yield file


def _is_part(file: Path, folder: Path, parts: Sequence[str]) -> bool:
    """Return whether a file is one of some files and folders, or in one."""
    name = file.relative_to(folder).as_posix()
    return any(name == part or name.startswith(f"{part}/") for part in parts)


@lru_cache(maxsize=1000)
def parts(file: Path, *, constants: bool = False) -> tuple[bytes, ...]:
    """Return a digest of each function, class and constant of a module, or of a file of data.

    With `constants`, functions and classes of a module are left out.
    """
    content = file.read_bytes()
    if file.suffix == ".py":
        nodes = [node for node in ast.parse(content).body if _counts(node)]
        if constants:
            nodes = [node for node in nodes if isinstance(node, ast.Assign | ast.AnnAssign)]
        written = [structure([node]).encode() for node in nodes]
    elif file.suffix == ".toml":
        written = [json.dumps(tomllib.loads(content.decode()), sort_keys=True).encode()]
    else:
        written = [content]
    return tuple(hashlib.sha256(text).digest() for text in written)


def structure(node: object) -> str:
    """Write a syntax tree as text without what does not count, alike in each Python version."""
    if isinstance(node, list):
        return "[" + ",".join(structure(part) for part in node if _counts(part)) + "]"
    if isinstance(node, ast.Raise):
        return "Raise"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = [
        f"{name}={structure(value)}"
        for name, value in ast.iter_fields(node)
        if value not in (None, []) and name not in ("kind", "type_comment")
    ]
    return f"{type(node).__name__}({','.join(fields)})"


def _counts(node: object) -> bool:
    """Return whether a part is neither an import nor a text alone, such as a docstring."""
    if isinstance(node, ast.Assign):
        return not (isinstance(node.targets[0], ast.Name) and node.targets[0].id == "__all__")
    is_text = (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )
    return not (is_text or isinstance(node, _IMPORTS))

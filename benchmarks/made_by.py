"""The digest of what makes a table: a command, and the code and data of which its numbers are made.

Comments, docstrings, messages of errors and the layout of the source do not count. Neither do files
that show or store results and decide no number (`SHOWING`). Every other file of the package counts,
so that a new one is not forgotten; of a command that runs a script, the script counts too.
"""

import ast
import hashlib
import json
import shlex
import tomllib
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SHOWING = (  # files and folders of the package
    "__init__.py", "__main__.py", "cache.py", "canvas.py", "cli", "digests.py", "errors.py",
    "files.py", "gym", "look.py", "processes.py", "testing", "trial_log", "untrusted.py",
    "version.py", "viewer",
    "datasets/bags.py", "evaluation/plots.py", "evaluation/posterior_report.py",
    "evaluation/report.py", "experiments/parallel.py", "experiments/store.py", "learner/card.py",
    "learner/saved.py", "learner/trial_logs.py", "learner/views.py", "posterior/idata.py",
    "trials/picture.py", "trials/text.py",
)  # fmt: skip
_LENGTH = 12  # hexadecimal digits


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
    for file in sources(command, root):
        digest.update(file.relative_to(root).as_posix().encode())
        digest.update(content(file))
    return digest.hexdigest()[:_LENGTH]


def sources(command: str, root: Path = ROOT) -> Iterator[Path]:
    """Yield the files that decide the numbers of a command."""
    package = root / "meal_bayes"
    for file in sorted(package.rglob("*")):
        name = file.relative_to(package).as_posix()
        shows = any(name == part or name.startswith(f"{part}/") for part in SHOWING)
        if file.suffix in (".py", ".toml", ".npz", ".xz") and not shows:
            yield file
    program, *words = shlex.split(command)
    if program == "python":
        yield root / words[0]


@lru_cache(maxsize=1000)
def content(file: Path) -> bytes:
    """Return the digest of what counts of a file."""
    counted = file.read_bytes()
    if file.suffix == ".py":
        counted = structure(ast.parse(counted)).encode()
    if file.suffix == ".toml":
        counted = json.dumps(tomllib.loads(counted.decode()), sort_keys=True).encode()
    return hashlib.sha256(counted).digest()


def structure(node: object) -> str:
    """Write a syntax tree as text without docstrings and messages, alike in each Python version."""
    if isinstance(node, list):
        return "[" + ",".join(map(structure, node)) + "]"
    if isinstance(node, ast.Raise):
        return "Raise"
    if not isinstance(node, ast.AST):
        return repr(node)
    fields = []
    for name, value in ast.iter_fields(node):
        if name == "body" and isinstance(value, list):
            value = [part for part in value if not _is_text(part)]  # noqa: PLW2901
        if value not in (None, []) and name not in ("kind", "type_comment"):
            fields.append(f"{name}={structure(value)}")
    return f"{type(node).__name__}({','.join(fields)})"


def _is_text(node: object) -> bool:
    """Return whether a statement is a text alone, such as a docstring."""
    return (
        isinstance(node, ast.Expr)
        and isinstance(node.value, ast.Constant)
        and isinstance(node.value.value, str)
    )

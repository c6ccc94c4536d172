"""A plain `pip install .` is whole: what the package imports, it declares."""

import ast
import re
import sys
import tomllib
from importlib import metadata
from itertools import chain
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def names(requirements):
    """Return the plain names of requirements."""
    found = (re.match(r"[A-Za-z0-9._-]+", text) for text in requirements)
    return {match.group().lower().replace("_", "-") for match in found if match}


def imported():
    """Yield the libraries that a module of the package imports."""
    for path in (ROOT / "meal_bayes").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                yield from (alias.name for alias in node.names)
            elif isinstance(node, ast.ImportFrom):
                yield node.module or ""


def test_what_is_imported_is_declared():
    extras = [PROJECT["optional-dependencies"][name] for name in ("cluster", "gym", "sim")]
    declared = names([*PROJECT["dependencies"], *chain(*extras)]) | {"distributed"}
    homes = metadata.packages_distributions()
    libraries = {name.partition(".")[0] for name in imported()} - {"meal_bayes"}
    missing = {
        name
        for name in libraries - set(sys.stdlib_module_names)
        if not names(homes.get(name, [name])) & declared
    }
    assert missing == set()


def test_what_is_declared_is_pinned_for_the_ci():
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = names(line for line in lines if not line.startswith("#"))
    assert names(PROJECT["dependencies"]) <= pinned
    both = [line for line in lines if line.startswith(("h5py==", "h5netcdf=="))]
    assert len(both) == 2
    assert not any(";" in line for line in both)  # for every Python

"""`meal-bayes doctor`: the environment, in one page to paste into a bug report."""

import os
import platform
import stat
from collections.abc import Callable
from importlib import metadata
from pathlib import Path

import click

import meal_bayes
from meal_bayes.cache import cache_root
from meal_bayes.cli.console import output, print_facts, print_json
from meal_bayes.cli.options import shared

_LIBRARIES = (
    "numpy", "scipy", "numba", "scikit-learn", "pymc", "arviz", "h5netcdf", "mcap", "protobuf",
    "zstandard", "rerun-sdk", "matplotlib", "click", "rich", "distributed", "mujoco", "gymnasium",
)  # fmt: skip
_DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")


@click.command(short_help="Show the environment, for a bug report.")
@shared("json")
def doctor(as_json: bool) -> None:
    """Show versions, folders, viewer, data and cores, for a bug report.

    Nothing is changed, and nothing is sent anywhere.
    """
    checks: dict[str, Callable[[], str]] = {
        "package": lambda: f"meal-bayes {meal_bayes.__version__} in {meal_bayes.__path__[0]}",
        "system": _system,
        "versions": lambda: ", ".join(f"{name} {_version(name)}" for name in _LIBRARIES),
        "cache": lambda: _folder(cache_root()),
        "data": _data,
        "viewer": _viewer,
    }
    facts = {}
    for name, check in checks.items():
        # One part that is broken must not hide the others.
        try:
            facts[name] = check()
        except Exception as fault:
            text = " ".join(str(fault).split())[:100]
            facts[name] = f"broken: {type(fault).__name__}: {text}"
    if as_json:
        print_json(facts)
    else:
        print_facts(output(), facts)


def _system() -> str:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    cores = f"{usable} of {os.cpu_count()} cores"
    return f"Python {platform.python_version()}, {platform.platform()}, {cores}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"


def _folder(path: Path) -> str:
    """Return whether a folder exists and can be written, and who else may write there."""
    if not path.exists():
        parent = next(parent for parent in path.absolute().parents if parent.exists())
        return f"{path}, {'can' if os.access(parent, os.W_OK) else 'CANNOT'} be made"
    mode = path.stat().st_mode
    writable = "writable" if os.access(path, os.W_OK | os.X_OK) else "NOT writable"
    others = mode & (stat.S_IWGRP | stat.S_IWOTH) and not mode & stat.S_ISVTX
    shared = ", OTHERS can write" if others else ""
    return f"{path.resolve()}, mode {stat.S_IMODE(mode):04o}, {writable}{shared}"


def _data() -> str:
    from meal_bayes.datasets import cache_folder, registry
    from meal_bayes.datasets.sources import SOURCES

    counts = [_folder(cache_folder())]
    for name in SOURCES:
        files = [cache_folder() / path for path in registry(name)]
        counts.append(f"{name} {sum(path.is_file() for path in files)} of {len(files)} files")
    return "; ".join(counts)


def _viewer() -> str:
    from meal_bayes.viewer.window import viewer_program

    drivers = [file.stem for folder in _DRIVERS for file in sorted(Path(folder).glob("*.json"))]
    return f"{viewer_program()}; Vulkan drivers: {', '.join(drivers) or 'none'}"

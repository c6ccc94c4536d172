"""`meal-bayes doctor`: the environment, in one page to paste into a bug report."""

import os
import platform
import re
import shutil
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from importlib import import_module, metadata, util
from pathlib import Path

import click
from platformdirs import user_cache_path

from meal_bayes.cli.console import output, print_facts, print_json
from meal_bayes.cli.options import json_option

_LISTED = (
    "numpy", "scipy", "numba", "scikit-learn", "pymc", "arviz", "h5netcdf", "h5py", "mcap",
    "protobuf", "rerun-sdk", "matplotlib", "click", "rich",
)  # fmt: skip
_LOADED = ("numpy", "scipy", "numba", "mcap", "zstandard", "sklearn", "h5netcdf", "h5py", "rerun")
_EXTRAS = {"cluster": "distributed", "view": "playwright"}
_BROWSERS = ("chromium", "chromium-browser", "google-chrome", "firefox", "safari", "msedge")
_DRIVERS = ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d", "/usr/local/share/vulkan/icd.d")
_OTHERS = stat.S_IWGRP | stat.S_IWOTH


@click.command(short_help="Show the environment, for a bug report.")
@json_option
def doctor(as_json: bool) -> None:
    """Show versions, folders, compiled kernels, viewer, data and cores, for a bug report.

    Nothing is changed, and nothing is sent anywhere.
    """
    facts = dict(_facts())
    if as_json:
        print_json(facts)
        return
    print_facts(output(), facts)


def _facts() -> Iterator[tuple[str, str]]:
    checks: dict[str, Callable[[], str]] = {
        "package": _package,
        "system": lambda: f"Python {platform.python_version()}, {platform.platform()}",
        "cores": _cores,
        "versions": lambda: ", ".join(f"{name} {_version(name)}" for name in _LISTED),
        "loading": _loading,
        "extras": _extras,
        "data cache": lambda: _folder(_data_cache()),
        "user cache": lambda: _folder(user_cache_path("meal_bayes", appauthor=False)),
        "temporary": lambda: _folder(Path(tempfile.gettempdir())),
        "logs": lambda: _folder(Path("logs")),
        "kernels": _kernels,
        "data": _data,
        "viewer": _viewer,
        "vulkan": _vulkan,
        "browser": lambda: ", ".join(filter(None, map(shutil.which, _BROWSERS))) or "none found",
        "compiler": lambda: _program("g++", "c++", "clang++"),
        "pomdpsol": lambda: _program(os.environ.get("MEAL_BAYES_POMDPSOL") or "pomdpsol"),
        "terminal": _terminal,
        "settings": _settings,
    }
    for name, check in checks.items():
        try:
            yield name, check()
        except Exception as fault:  # a broken part is what this command is for
            yield name, f"broken: {type(fault).__name__}: {' '.join(str(fault).split())[:200]}"


def _package() -> str:
    import meal_bayes

    return f"meal-bayes {meal_bayes.__version__} in {Path(meal_bayes.__file__).parent}"


def _cores() -> str:
    usable = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    memory = ""
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        memory = f", {os.sysconf('SC_PHYS_PAGES') * os.sysconf('SC_PAGE_SIZE') / 1e9:.1f} GB"
    return f"{usable} of {os.cpu_count()} may be used{memory}"


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"


def _loading() -> str:
    """Return which libraries cannot be imported; installed does not mean working."""
    broken = []
    for name in _LOADED:
        try:
            import_module(name)
        except Exception as fault:  # whatever a broken library raises
            broken.append(f"{name}: {type(fault).__name__}: {' '.join(str(fault).split())[:80]}")
    return "; ".join(broken) or f"{', '.join(_LOADED)} load"


def _extras() -> str:
    return ", ".join(
        f"{name} {'there' if util.find_spec(module) else 'not installed'}"
        for name, module in _EXTRAS.items()
    )


def _data_cache() -> Path:
    from meal_bayes.datasets import cache_folder

    return cache_folder()


def _folder(path: Path) -> str:
    """Return whether a folder exists, its owner and its permissions."""
    if not path.exists():
        place = next((parent for parent in path.absolute().parents if parent.exists()), path)
        can = "can" if os.access(place, os.W_OK) else "CANNOT"
        return f"{path}, not there yet, {can} be made"
    found = path.stat()
    state = [str(path), f"mode {stat.S_IMODE(found.st_mode):04o}"]
    state.append("writable" if os.access(path, os.W_OK | os.X_OK) else "NOT writable")
    if hasattr(os, "getuid") and found.st_uid != os.getuid():
        state.append(f"belongs to user {found.st_uid}")
    if found.st_mode & _OTHERS and not found.st_mode & stat.S_ISVTX:
        state.append("OTHERS can write")
    if path.is_symlink():
        state.append(f"a link to {path.resolve()}")
    return ", ".join(state)


def _kernels() -> str:
    """Return whether numba has compiled the planner before, for this Python."""
    import meal_bayes

    folders = [Path(meal_bayes.__file__).parent, user_cache_path("meal_bayes", appauthor=False)]
    folders += [Path(name) for name in (os.environ.get("NUMBA_CACHE_DIR"),) if name]
    tag = f"py{sys.version_info.major}{sys.version_info.minor}"
    count = sum(1 for folder in folders for file in folder.rglob("*.nbi") if tag in file.name)
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        return "NUMBA_DISABLE_JIT is set: nothing is compiled, planning is slow"
    return f"{count} compiled for {tag}" if count else "not compiled yet; the first run does it"


def _data() -> str:
    from meal_bayes.datasets import registry
    from meal_bayes.datasets.sources import SOURCES

    state = []
    for name in SOURCES:
        files = registry(name)
        here = sum((_data_cache() / path).is_file() for path in files)
        state.append(f"{name} {here} of {len(files)} files")
    return ", ".join(state)


def _viewer() -> str:
    from meal_bayes.viewer.window import viewer_program

    return str(viewer_program())


def _vulkan() -> str:
    from ctypes.util import find_library

    drivers = [file.stem for folder in _DRIVERS for file in sorted(Path(folder).glob("*.json"))]
    library = find_library("vulkan")
    return f"{library or 'no library'}; drivers: {', '.join(drivers) or 'none'}"


def _program(*names: str) -> str:
    return next(filter(None, map(shutil.which, names)), f"none ({', '.join(names)})")


def _terminal() -> str:
    size = shutil.get_terminal_size()
    where = "a terminal" if sys.stdout.isatty() else "no terminal"
    return f"{where}, {size.columns} columns, {sys.stdout.encoding}, TERM={os.environ.get('TERM')}"


def _settings() -> str:
    """Return the environment variables of the program, without passwords in addresses."""
    names = [n for n in sorted(os.environ) if n.startswith(("MEAL_BAYES_", "NUMBA_", "OMP_"))]
    shown = {name: re.sub(r"//[^/@]*@", "//...@", os.environ[name]) for name in names}
    return ", ".join(f"{name}={value}" for name, value in shown.items()) or "none"

"""`meal-bayes doctor`: the environment, in one page to paste into a bug report."""

import os
import platform
from importlib import metadata

import click

import meal_bayes
from meal_bayes.cache import cache_root
from meal_bayes.cli.console import output, print_facts, print_json
from meal_bayes.cli.options import shared
from meal_bayes.errors import MealBayesError

_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn", "pymc", "arviz", "joblib", "mcap",
              "rerun-sdk", "matplotlib", "pandas", "dask", "mujoco", "gymnasium")  # fmt: skip
_HOMELESS = "none, as this user has no home folder; set XDG_CACHE_HOME"


@click.command(short_help="Print versions and settings, for a bug report.")
@shared("json")
def doctor(as_json: bool) -> None:
    """Print versions, folders, viewer and number of cores, for a bug report.

    Nothing is changed, and nothing is sent anywhere.
    """
    from meal_bayes.datasets import cache_folder
    from meal_bayes.viewer.window import viewer_program

    facts = {
        "package": f"meal-bayes {meal_bayes.__version__} in {meal_bayes.__path__[0]}",
        "system": f"Python {platform.python_version()}, {platform.platform()}, "
        f"{os.cpu_count()} cores",
        "versions": ", ".join(f"{name} {_version(name)}" for name in _LIBRARIES),
        "cache": str(cache_root() or _HOMELESS),
    }
    try:
        facts["data"] = str(cache_folder())
    except (RuntimeError, MealBayesError):
        facts["data"] = _HOMELESS
    try:
        facts["viewer"] = str(viewer_program())
    except Exception as fault:  # a broken viewer must not hide the rest
        facts["viewer"] = f"broken: {type(fault).__name__}: {fault}"
    print_json(facts) if as_json else print_facts(output(), facts)


def _version(name: str) -> str:
    try:
        return metadata.version(name)
    except metadata.PackageNotFoundError:
        return "missing"

"""Options that several commands share."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

Command = TypeVar("Command", bound=Callable[..., Any])

dataset_option = click.option(
    "--dataset",
    default="roc36",
    show_default=True,
    metavar="NAME|FILE",
    help="roc36, ispy32, cy101, a variant of them, or your own percept table (.npz).",
)


def seed_option(default: int = 0) -> Callable[[Command], Command]:
    """Make the option --seed."""
    return click.option(
        "--seed",
        type=click.IntRange(min=0),
        default=default,
        show_default=True,
        metavar="S",
        help="Of failures, recordings and planning; equal seeds give equal trials.",
    )


def agent_value(text: str) -> object:
    """Return an agent's name as it is, or what `package.module:name` names.

    Raises
    ------
    SettingsError : a module that cannot be imported, or has no such name.
    """
    module, _, name = text.partition(":")
    if not name:
        return text
    from importlib import import_module

    from meal_bayes.errors import SettingsError

    if "" not in sys.path and str(Path.cwd()) not in sys.path:
        sys.path.insert(0, str(Path.cwd()))  # as `python -m` does
    try:
        found: Any = import_module(module)
        for part in name.split("."):
            found = getattr(found, part)
    except (ImportError, AttributeError) as fault:
        raise SettingsError(
            f"The agent {text!r} cannot be imported ({fault}); give package.module:name of an "
            "Agent or a planner, from this folder or an installed package."
        ) from fault
    return found


AGENTS = (
    "random, random_legal, predefined, predefined_plus, greedy, morc, olfc or bayes; or "
    "package.module:name of your own"
)
logs_option = click.option(
    "--logs",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path("logs"),
    show_default=True,
    help="Folder of the trial logs.",
)
json_option = click.option("--json", "as_json", is_flag=True, help="Print one JSON object.")
fresh_option = click.option("--fresh", is_flag=True, help="Run again what is there already.")
jobs_option = click.option(
    "--jobs", type=click.IntRange(min=1), default=1, show_default=True, help="Processes."
)
cluster_option = click.option(
    "--cluster", metavar="ADDRESS", help="Of a Dask scheduler, whose workers run it instead."
)
perception_option = click.option(
    "--perception",
    type=click.Choice(["default", "paper"]),
    default="default",
    show_default=True,
    help="Which classifiers made the percepts: ours, or the paper's recipe.",
)


def listed(*texts: str) -> tuple[str, ...]:
    """Take names that are given one by one or as comma lists."""
    return tuple(name.strip() for text in texts for name in text.split(","))

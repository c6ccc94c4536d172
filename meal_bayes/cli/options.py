"""Options that several commands share."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import click

from meal_bayes.cli.values import LARGEST_SEED, MOST_JOBS, Address, Whole

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
        type=Whole(0, LARGEST_SEED),
        default=default,
        show_default=True,
        metavar="S",
        help="Of failures, recordings and planning; equal seeds give equal trials.",
    )


AGENTS = "random, random_legal, predefined, predefined_plus, greedy, morc, olfc or bayes"
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
    "--jobs", type=Whole(1, MOST_JOBS), default=1, show_default=True, help="Processes."
)
cluster_option = click.option(
    "--cluster", type=Address(), metavar="ADDRESS",
    help="Of a Dask scheduler, whose workers run it instead.",
)  # fmt: skip
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

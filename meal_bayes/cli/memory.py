"""`meal-bayes memory`: the labels that people gave the robot."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from meal_bayes.cli.console import note, print_json, print_table
from meal_bayes.cli.options import dataset_option, json_option, logs_option
from meal_bayes.cli.program import Section

if TYPE_CHECKING:
    from meal_bayes.trial_log import ObjectLabels


@click.group(cls=Section)
def memory() -> None:
    """Show or forget the labels that `ask --learn` received."""


@memory.command()
@dataset_option
@logs_option
@json_option
def show(dataset: str, root: Path | None, logs: Path, as_json: bool) -> None:
    """List the labels of the objects of a data set, the latest last."""
    found = _memory(logs, dataset)
    if as_json:
        rows = [
            {"object": one.object_name, "labels": dict(one.values), "log": str(one.path)}
            for one in found
        ]
        print_json({"memory": rows})
        return
    if not found:
        note(f'no labels yet; ask with --learn: meal-bayes ask --learn "..." --logs {logs}')
        return
    cells = (
        (one.object_name, ", ".join(k if v else f"not {k}" for k, v in one.values.items()),
         one.path.name)
        for one in found
    )  # fmt: skip
    print_table(("object", "is", "log"), cells, left=("is", "log"))


@memory.command()
@click.option("--object", "name", metavar="NAME", help="Only the labels of this object.")
@dataset_option
@logs_option
def forget(name: str | None, dataset: str, root: Path | None, logs: Path) -> None:
    """Forget labels; the trials stay in their logs."""
    from meal_bayes.trial_log import forget as forget_labels

    chosen = [one for one in _memory(logs, dataset) if name in (None, one.object_name)]
    note(f"forgot the labels in {forget_labels(chosen)} trials")


def _memory(logs: Path, dataset: str) -> "list[ObjectLabels]":
    from meal_bayes.datasets.percept_file import domain_of
    from meal_bayes.trial_log import read_memory

    return read_memory(logs, domain_of(dataset).data)

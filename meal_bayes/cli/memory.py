"""`meal-bayes memory`: what people told the robot about objects."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from meal_bayes.cli.options import dataset_option, json_option, logs_option
from meal_bayes.cli.program import Section
from meal_bayes.cli.screen import note, output

if TYPE_CHECKING:
    from meal_bayes.trial_log import ObjectLabels


@click.group(cls=Section)
def memory() -> None:
    """Show or forget what `ask --learn` was told."""


@memory.command()
@dataset_option
@logs_option
@json_option
def show(dataset: str, root: Path | None, logs: Path, as_json: bool) -> None:
    """List what was told of the objects of a data set, the latest last."""
    found = _memory(logs, dataset)
    if as_json:
        rows = [
            {"object": t.object_name, "told": dict(t.values), "log": str(t.path)} for t in found
        ]
        click.echo(json.dumps({"memory": rows}))
        return
    if not found:
        note(f'nothing was told yet; ask with --learn: meal-bayes ask --learn "..." --logs {logs}')
        return
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for name in ("object", "is", "log"):
        table.add_column(name, overflow="fold")
    for told in found:
        words = ", ".join(k if v else f"not {k}" for k, v in told.values.items())
        table.add_row(told.object_name, words, told.path.name)
    output().print(table)


@memory.command()
@click.option("--object", "name", metavar="NAME", help="Only what was told of this object.")
@dataset_option
@logs_option
def forget(name: str | None, dataset: str, root: Path | None, logs: Path) -> None:
    """Forget what was told; the trials stay in their logs."""
    from meal_bayes.trial_log import forget as forget_told

    chosen = [told for told in _memory(logs, dataset) if name in (None, told.object_name)]
    note(f"forgot what was told in {forget_told(chosen)} trials")


def _memory(logs: Path, dataset: str) -> "list[ObjectLabels]":
    from meal_bayes.datasets.percept_file import domain_of
    from meal_bayes.trial_log import read_memory

    return read_memory(logs, domain_of(dataset).data)

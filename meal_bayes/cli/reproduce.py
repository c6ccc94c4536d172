"""`meal-bayes reproduce`: the paper's tables and figures, by the package of a source checkout."""

import json
import sys
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.errors import DownloadError

_PACKAGE = "paper_repro"


@click.command(short_help="Run the paper's tables and figures again (in a checkout).")
@click.argument("items", nargs=-1, required=True, metavar="ITEM...|all|readme")
@click.option("--quick", is_flag=True, help="Run a few trials of each item.")
@click.option(
    "--as-published",
    is_flag=True,
    help="Run the paper's own settings only: percepts drawn from the learned confusion matrices.",
)
@opt.shared("seed", "jobs", "cluster", "logs")
@opt.option(
    "--trials", opt.COUNT, None, "T", "Maximum number of trials of an agent in offline runs."
)
@opt.option(
    "--repeats",
    click.IntRange(0, opt.LARGEST_COUNT),
    None,
    "R",
    "Maximum number of repeats of online runs; 0 runs none.",
)
@opt.option(
    "--only",
    None,
    "",
    "TEXT",
    "Run only the panels of Fig. 10 with TEXT in their title.",
)
@click.option(
    "--dry-run",
    is_flag=True,
    help="Print what would run, how long that took last, and how many units run at once.",
)
@opt.shared("json")
def reproduce(
    items: tuple[str, ...], cluster: str | None, dry_run: bool, as_json: bool, **setting: Any
) -> None:
    """Run ITEMs of the paper (table3, fig8, ...), or all, and judge its statements.

    A full run writes tables and figures to results/ beside the items, and the pages that show them;
    `readme` only makes these pages. A run of another seed, or of fewer trials, repeats or panels,
    writes its results beside the logs. `all` runs the items that this version has not run yet; an
    item that you name is run again. Trials are kept with the logs, so a stopped run can continue.
    """
    from meal_bayes.experiments.parallel import on_cluster

    if dry_run and (as_json or items == ("readme",)):
        given = "--json" if as_json else "readme"
        raise click.UsageError(f"--dry-run prints lines and writes nothing; leave out {given}.")
    # The items are no part of the wheel: they are imported from the checkout.
    sys.path.insert(0, str(checkout()))
    frame = import_module(f"{_PACKAGE}.frame")
    pages = import_module(f"{_PACKAGE}.pages")
    if items == ("readme",):
        for path in pages.write_pages():
            click.echo(path)
        return
    full = frame.Setting(**setting).full
    todo = frame.named(items)
    if full and items == ("all",):
        todo = tuple(item for item in todo if frame.is_older(item))
    if dry_run:
        click.echo(_plan(frame, todo))
        for item in todo:
            click.echo(_units_of(frame, item, frame.Setting(**setting)))
        return
    results = []
    skipped = {}
    for number, item in enumerate(todo):
        terminal.note(_plan(frame, todo[number:]) if full else f"{item} ...")
        try:
            with on_cluster(cluster), terminal.progress(item, "trials") as advance:
                settings = frame.Setting(**setting, on_progress=advance)
                results.append(frame.reproduce(item, settings))
        except (DownloadError, frame.NotRun) as fault:  # no recordings; the rest does without
            skipped[item] = str(fault)
            terminal.note(f"{item} is skipped: {fault}")
            continue
        if not as_json:
            click.echo(pages.result_page(results[-1]))
    if full and (results or not todo):
        pages.write_pages()
    if as_json:
        click.echo(json.dumps({"items": results, "skipped": skipped}, allow_nan=False))
        return
    for result in results:
        click.echo(f"{result['item']}: {result['verdict']}")


def _plan(frame: Any, items: tuple[str, ...]) -> str:
    """Say which items are to run, and how many minutes each took last, with runs that it shares."""
    minutes = {item: frame.minutes_of(item) for item in items}
    told = ", ".join(f"{item} {number:.0f}" for item, number in minutes.items())
    return f"{len(items)} items, at most {sum(minutes.values()):.0f} minutes of computing: {told}"


def _units_of(frame: Any, item: str, setting: Any) -> str:
    """Say how many units of an item would run at once."""
    try:
        planned = frame.planned_runs(item, setting)
    except (DownloadError, frame.NotRun) as fault:
        return f"{item} is skipped: {fault}"
    if not planned:
        return f"{item} runs at once what it compares, one comparison after another"
    units = {unit.path: unit for run in planned for unit in run.units}.values()
    left = sum(unit.done < unit.size for unit in units)
    return f"{item}: {len(units)} units in one list, {left} to run, which can all run at once"


def checkout() -> Path:
    """Find the folder that holds the items, here or above: the installed package does not."""
    for folder in (Path.cwd(), *Path.cwd().parents):
        if (folder / _PACKAGE / "paper_values.toml").is_file():
            return folder
    raise click.UsageError(
        f"No items of the paper in {Path.cwd() / _PACKAGE}; they are in the folder {_PACKAGE}/ of "
        "the source code, not in the installed package: call this in a checkout."
    )

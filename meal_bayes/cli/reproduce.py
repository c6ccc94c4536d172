"""`meal-bayes reproduce`: the paper's tables and figures, by the scripts of a checkout."""

import json
import sys
from importlib import import_module
from pathlib import Path

import click

from meal_bayes.cli.console import note, progress
from meal_bayes.cli.options import jobs_option, json_option, logs_option, seed_option
from meal_bayes.errors import DownloadError

_FOLDER = "paper_repro"
_PROGRAM = "reproduction"  # the module of that folder that knows its items


@click.command(short_help="Run the paper's tables and figures again (in a checkout).")
@click.argument("items", nargs=-1, required=True, metavar="ITEM...|all|readme")
@click.option("--quick", is_flag=True, help="A few trials each; results beside the logs.")
@click.option(
    "--as-published", is_flag=True,
    help="The published code's protocol alone: percepts drawn from the learned tables.",
)  # fmt: skip
@seed_option()
@jobs_option
@logs_option
@click.option(
    "--scripts", type=click.Path(file_okay=False, path_type=Path), metavar="FOLDER",
    help=f"Where the scripts are; {_FOLDER}/ here or above by default.",
)  # fmt: skip
@json_option
def reproduce(
    items: tuple[str, ...],
    quick: bool,
    as_published: bool,
    seed: int,
    jobs: int,
    logs: Path,
    scripts: Path | None,
    as_json: bool,
) -> None:
    """Run ITEMs of the paper (table3, fig8, ...), or all, and judge what stands.

    Trials are kept under the logs, so a run that was stopped goes on. A full run writes tables and
    figures to results/ beside the scripts; `readme` makes the pages that show them.
    """
    folder = _found(scripts)
    sys.path.insert(0, str(folder))
    program, pages = import_module(_PROGRAM), import_module("pages")
    setting = import_module("frame").Setting
    if items == ("readme",):
        for path in program.write_pages():
            click.echo(path)
        return
    results, skipped = [], {}
    for item in program.named(items):
        note(f"{item} ...")
        try:
            with progress(item, "trials") as advance:
                chosen = setting(quick, seed, jobs, logs, as_published, advance)
                results.append(program.reproduce(item, chosen))
        except DownloadError as fault:  # no recordings; the rest does without
            skipped[item] = str(fault)
            note(f"{item} is skipped: {fault}")
            continue
        if not as_json:
            click.echo(pages.result_page(results[-1]))
    if as_json:
        click.echo(json.dumps({"items": results, "skipped": skipped}, allow_nan=False))
        return
    for told in results:
        click.echo(f"{told['item']}: {told['verdict']}")


def _found(scripts: Path | None) -> Path:
    """Find the folder of the scripts, which the installed package does not hold."""
    here = Path.cwd()
    tried = [scripts] if scripts else [place / _FOLDER for place in (here, *here.parents)]
    for folder in tried:
        if (folder / f"{_PROGRAM}.py").is_file():
            return folder.resolve()
    raise click.UsageError(
        f"No scripts of the paper's items in {tried[0]}; they are in the folder {_FOLDER}/ of the "
        "source code, not in the installed package: call this in a checkout, or give "
        f"--scripts PATH/TO/{_FOLDER}."
    )

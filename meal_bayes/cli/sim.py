"""`meal-bayes sim`: an arm in physics records objects, and is asked about new ones."""

from collections import Counter
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.table import Table

from meal_bayes.cli.options import jobs_option, seed_option
from meal_bayes.cli.program import Section
from meal_bayes.cli.screen import Advance, note, output, progress

if TYPE_CHECKING:
    from meal_bayes.robots.simulated_arm import Recorded
    from meal_bayes.robots.simulated_arm.record import Happened

DOMAIN = "simulated_arm"


@click.group(cls=Section)
def sim() -> None:
    """Let an arm in physics (MuJoCo, extra `sim`) touch objects, and ask it about new ones."""


@sim.command(short_help="Record objects as a data set of your own.")
@click.option("--objects", type=click.IntRange(min=2), default=30, show_default=True)
@click.option("--recordings", type=click.IntRange(min=1), default=5, show_default=True)
@click.option(
    "--out", required=True, type=click.Path(file_okay=False, path_type=Path),
    help="The folder for the CSV files and the table of the domain.",
)  # fmt: skip
@seed_option()
@jobs_option
def record(objects: int, recordings: int, out: Path, seed: int, jobs: int) -> None:
    """Record every behavior on objects drawn from the seed, as CSV files and a TOML.

    What fails is tried again; an object that slips again and again has fewer recordings.
    """
    with progress("recording", "objects") as advance:
        recorded = record_training(objects, recordings, seed, jobs=jobs, advance=advance)
    path = save_recordings(recorded, out)
    happened = sum((one.happened for one in recorded), Counter[tuple[str, str, str]]())
    click.echo(f"{out}: {objects} objects, up to {recordings} recordings each")
    _print_outcomes(happened)
    note(f"make percepts of them with: meal-bayes data percepts --dataset {path} --root {out} ...")


def _print_outcomes(happened: "Happened") -> None:
    """Print what each behavior led to, and how often."""
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    for name in ("behavior", "from", "to", "times", "share"):
        table.add_column(name, justify="right" if name in ("times", "share") else "left")
    tried: Counter[tuple[str, str]] = Counter()
    for (state, behavior, _), count in happened.items():
        tried[behavior, state] += count
    for (state, behavior, after), count in sorted(happened.items()):
        share = f"{count / tried[behavior, state]:.3f}"
        table.add_row(behavior, state, after, str(count), share)
    output().print(table)


def record_training(
    objects: int, recordings: int, seed: int, *, jobs: int, advance: Advance
) -> "list[Recorded]":
    """Record training objects, in processes.

    Parameters
    ----------
    advance : called with (objects recorded, objects in all).
    """
    from meal_bayes.experiments.parallel import in_parallel
    from meal_bayes.robots.simulated_arm import record_object

    found = []
    work = partial(record_object, recordings=recordings, seed=seed)
    for recorded in in_parallel(work, range(objects), jobs=jobs):
        found.append(recorded)
        advance(len(found), objects)
    return sorted(found, key=lambda one: one.name)


def save_recordings(recorded: "list[Recorded]", folder: Path) -> Path:
    """Write recordings and the table of their domain, and return the table's path."""
    from importlib import resources

    from meal_bayes.datasets import save_csv_folder
    from meal_bayes.domain import load_domain
    from meal_bayes.robots.simulated_arm import to_dataset

    save_csv_folder(to_dataset(load_domain(DOMAIN), recorded), folder)
    table = resources.files("meal_bayes.domain") / "tables" / f"{DOMAIN}.toml"
    path = folder / f"{DOMAIN}.toml"
    path.write_text(table.read_text(encoding="utf-8"), encoding="utf-8")
    return path

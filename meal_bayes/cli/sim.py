"""`meal-bayes sim`: an arm in physics records objects, and is asked about new ones."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import click

from meal_bayes.cli.options import jobs_option, seed_option
from meal_bayes.cli.program import Section
from meal_bayes.cli.screen import Advance, note, progress

if TYPE_CHECKING:
    from meal_bayes.datasets import Dataset
    from meal_bayes.robots.simulated_arm import Recorded

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

    An object that slips out of the gripper again and again is told of and left out.
    """
    with progress("recording", "objects") as advance:
        dataset = record_training(objects, recordings, seed, jobs=jobs, advance=advance)
    path = save_recordings(dataset, out)
    click.echo(f"{out}: {len(dataset.objects)} objects, {recordings} recordings each")
    note(f"make percepts of them with: meal-bayes data percepts --dataset {path} --root {out} ...")


def record_training(
    objects: int, recordings: int, seed: int, *, jobs: int, advance: Advance
) -> "Dataset":
    """Record training objects, in processes, until there are as many as asked.

    Parameters
    ----------
    advance : called with (objects recorded, objects in all).
    """
    from meal_bayes.domain import load_domain
    from meal_bayes.experiments.parallel import in_parallel
    from meal_bayes.robots.simulated_arm import record_object, to_dataset

    work = partial(record_object, recordings=recordings, seed=seed)
    found: list[Recorded] = []
    tried = 0
    while (missing := objects - len(found)) > 0:
        left = in_parallel(work, range(tried, tried + missing), jobs=jobs)
        tried += missing
        for recorded in left:
            if recorded.whole:
                found.append(recorded)
                advance(len(found), objects)
            else:
                note(f"{recorded.name} slipped again and again: left out")
    return to_dataset(load_domain(DOMAIN), sorted(found, key=lambda one: one.name))


def save_recordings(dataset: "Dataset", folder: Path) -> Path:
    """Write recordings and the table of their domain, and return the table's path."""
    from importlib import resources

    from meal_bayes.datasets import save_csv_folder

    save_csv_folder(dataset, folder)
    table = resources.files("meal_bayes.domain") / "tables" / f"{DOMAIN}.toml"
    path = folder / f"{DOMAIN}.toml"
    path.write_text(table.read_text(encoding="utf-8"), encoding="utf-8")
    return path

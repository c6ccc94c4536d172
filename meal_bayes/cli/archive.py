"""`meal-bayes archive`: one file that holds a study."""

from pathlib import Path

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt

_PLACE = click.Path(exists=True, path_type=Path)


@click.command(short_help="Pack the logs of a study, with what belongs to them.")
@click.argument("folder", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.argument("out", type=opt.FILE)
@click.argument("others", nargs=-1, type=_PLACE)
def archive(folder: Path, out: Path, others: tuple[Path, ...]) -> None:
    """Check the logs in FOLDER, and pack them as OUT (.zip) with a list of what they are.

    OTHERS are files and folders of your own that belong to the study: the domain, its recordings, a
    percept table, scripts. Equal inputs give equal bytes.
    """
    from meal_bayes.digests import checksum_of
    from meal_bayes.errors import SettingsError
    from meal_bayes.trial_log.archive import write_archive

    if out.suffix != ".zip":
        raise SettingsError(f"{out}: give a name that ends in .zip.")
    with terminal.output(stderr=True).status(f"checking the logs of {folder} ..."):
        write_archive(folder, out, others)
    size = out.stat().st_size / 1e6
    terminal.say(f"{out}: {size:.1f} MB, sha256 {checksum_of(out)}")

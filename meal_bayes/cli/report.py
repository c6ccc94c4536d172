"""`meal-bayes report`: one page of a run."""

from pathlib import Path

import click

from meal_bayes.cli.console import note, progress, say
from meal_bayes.cli.options import FILE, option


@click.command(short_help="Write one page (HTML) of a run: tables, figures, worst trials.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path))
@option("-o --out", FILE, Path("report.html"), "FILE.html",
        "The page; everything it needs is in it.")  # fmt: skip
def report(logs: tuple[Path, ...], out: Path) -> None:
    """Write one page of the trials in LOGS, files or runs' folders."""
    from meal_bayes.evaluation.report import write_report
    from meal_bayes.trial_log import Logs

    found = Logs(*logs)
    with progress("reading", "files") as advance:
        written = write_report(found, out, on_progress=advance)
    for problem in found.problems:
        note(f"warning: {problem}; the report counts the whole trials")
    trials, agents = written.trials, len(written.agents)
    counted = f"{trials} trial{'s' * (trials != 1)} of {agents} agent{'s' * (agents != 1)}"
    say(f"{out}: {counted}, {written.size:,} bytes")

"""`meal-bayes view`: trials step by step in rerun, live or from a log."""

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import click

from meal_bayes.cli.console import note, progress, say
from meal_bayes.cli.log import numbered
from meal_bayes.cli.options import FILE, LARGEST_COUNT, option
from meal_bayes.cli.program import ABSENT
from meal_bayes.files import check_output, draft_of, write_whole

if TYPE_CHECKING:
    from collections.abc import Iterator

    from meal_bayes.trial_log import Logs
    from meal_bayes.trials import Trial, TrialOutcomes
    from meal_bayes.viewer import Viewer
    from meal_bayes.viewer.replay import Target

_LARGE = 1_000_000  # bytes of logs, some 200 trials


@click.command(short_help="Show trials step by step: beliefs, values, search, percepts.")
@click.argument("log", type=click.Path(path_type=Path))
@option(
    "--trial number",
    click.IntRange(0, LARGEST_COUNT),
    None,
    "N",
    "Show this trial step by step, counted from 0; the first by default.",
)
@click.option("--all", "every", is_flag=True, help="Show every trial step by step.")
@option("--save", FILE, None, "FILE.rrd", "Write the recording and open no viewer.")
@option(
    "--screenshot",
    FILE,
    None,
    "FILE.png",
    "Write a picture of the viewer at the last behavior, and open no window.",
)
@click.option("--web", is_flag=True, help="Serve a page for the browser, to this machine only.")
@click.option("--live", is_flag=True, help="Follow a run that is still writing LOG.")
def view(
    log: Path,
    number: int | None,
    every: bool,
    save: Path | None,
    screenshot: Path | None,
    web: bool,
    live: bool,
) -> None:
    """Show a trial of LOG, a file or a run's folder, in the rerun viewer, step by step.

    The window has tabs for the trial, for its last behavior, and for the whole run. A compact log
    has no steps of most trials; for such a trial, only the tab of the run is shown, and --trial
    exits with 1. Other machines cannot reach the viewer. Its telemetry is off, but the telemetry of
    rerun's own page, which --web opens, is on.
    """
    if sum((save is not None, screenshot is not None, web)) > 1:
        raise click.UsageError("Give one of --save, --screenshot and --web.")
    if every and number is not None:
        raise click.UsageError("Give --trial N or --all.")
    if live and (number, save, screenshot) != (None, None, None):
        raise click.UsageError(
            "--live can only be combined with --web; it shows every trial as soon as it is logged."
        )
    if screenshot is not None and screenshot.suffix.lower() != ".png":
        raise click.UsageError(f"--screenshot {screenshot}: give a name that ends in .png.")
    from meal_bayes import viewer
    from meal_bayes.errors import OutputError
    from meal_bayes.trial_log import Logs
    from meal_bayes.viewer.window import check_recording_name

    if save is not None:
        check_recording_name(save)
    if screenshot is not None:
        check_output(screenshot)
    logs = None if live else Logs(log)
    last = 0
    named = number
    if number is None and not every and not live:
        number = 0
    if number is not None or screenshot is not None:
        group, row = numbered(log, number or 0)
        last = max(len(group.trials[row].steps) - 1, 0) if group.trials else 0
        if named is not None and not group.trials:
            note(
                f"{group.file} is a compact log and holds no steps of trial {named}; leave out "
                "--trial to see the run"
            )
            click.get_current_context().exit(ABSENT)
    if save is not None and logs is not None:
        if number is None:
            warn_of_size(logs)
        # rerun writes into a draft, so that a full disk leaves no half recording.
        try:
            with draft_of(save, inputs=logs.files) as draft:
                trials = _record(log, logs, draft, number)
        except RuntimeError as fault:  # the only kind that rerun knows
            raise OutputError(f"{save} cannot be written: {fault}; give another place.") from fault
        say(f"{save}: {trials} trials, {save.stat().st_size:,} bytes")
    elif screenshot is not None and logs is not None:
        with tempfile.TemporaryDirectory(prefix="meal_bayes-") as folder:
            # rerun shows the file's name
            recording = Path(folder, f"{log.resolve().name.partition('.')[0]}.rrd")
            _record(log, logs, recording, number)
            write_whole(screenshot, viewer.take_picture(recording, row=last))
        say(f"{screenshot}: {screenshot.stat().st_size:,} bytes")
    else:  # a window or a page, to which trials are sent, so that no file remains
        with viewer.Viewer(web=web) as window:
            window.wait_until_ready()
            if web:
                say(f"open {window.address}\nthe page is rerun's own; Ctrl-C ends it")
            if logs is None:
                _follow(log, window)
            else:
                _record(log, logs, window.url, number)
            window.wait()


def warn_of_size(logs: "Logs") -> None:
    """Say that a recording of every step of a run takes long and is large."""
    size = sum(file.stat().st_size for file in logs.files)
    if size > _LARGE:
        note(
            f"warning: every step of {size / 1e6:,.0f} MB of logs takes long to write, and the "
            "recording will be two to eight times as large; --trial N writes the steps of one trial"
        )


def _record(log: Path, logs: "Logs", to: "Target", number: int | None) -> int:
    """Send the recording, print what could not be read, and return how many trials were sent."""
    from meal_bayes.viewer import send_recording

    def entries() -> "Iterator[Trial | TrialOutcomes]":
        for group in logs.begun():
            advance(logs.files.index(group.file), len(logs.files))
            yield from group.trials or [group.outcomes]  # which a compact log consists of

    with progress("reading", "files") as advance:
        trials = send_recording(entries(), to, logs.header, name=log.resolve().name, only=number)
    for problem in logs.problems:
        note(f"warning: {problem}; {trials} trials are shown")
    return trials


def _follow(log: Path, viewer: "Viewer") -> None:
    from meal_bayes.viewer import follow

    if not log.exists():
        note(f"waiting for {log} ...")
    follower = follow(
        log,
        viewer.url,
        watching=lambda: viewer.running,
        on_trials=lambda trials: note(f"{trials} trials"),
    )
    for problem in follower.problems:
        note(f"warning: {problem}; the whole trials before it are shown")
    if viewer.running:
        note("the run has ended; close the viewer, or press Ctrl-C")

"""The log of one trial with a robot: every step is on disk before the next behavior."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from meal_bayes.agents import Recorder, Trial
from meal_bayes.trial_log import TrialWriter


def next_log(folder: Path | None, domain: str, object_name: str) -> Path | None:
    """Return a path that no log has, such as logs/kitchen/00012-blue_cup.mcap."""
    if folder is None:
        return None
    own = folder / _file_name(domain)
    taken = [int(p.name[:5]) for p in own.glob("[0-9][0-9][0-9][0-9][0-9]-*.mcap*")]
    return own / f"{max(taken, default=-1) + 1:05d}-{_file_name(object_name)}.mcap"


def logged(
    path: str | Path | None, header: Mapping[str, object], run: Callable[[Recorder | None], Trial]
) -> Trial:
    """Run a trial that is logged as it happens; what ends it early is raised after that.

    Parameters
    ----------
    path : of the log; None logs nothing.
    header : what the run is.
    run : runs the trial, and tells the recorder of it.
    """
    if path is None:
        return run(None)
    failure: BaseException | None = None
    trial: Trial | None = None
    with TrialWriter(path, header) as log:
        try:
            trial = run(log)
        except BaseException as fault:
            failure = fault
    if failure is not None:
        failure.add_note(f"the trial, as far as it went: meal-bayes log show {path}")
        raise failure
    assert trial is not None
    return trial


def _file_name(text: str) -> str:
    return re.sub(r"[^\w.-]+", "_", text)[:60]

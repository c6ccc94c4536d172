"""Torn files: report what is wrong, recover the whole trials."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.names import recovered_name
from meal_bayes.trial_log.reader import Scan, find_log
from meal_bayes.trial_log.schema import SUFFIX
from meal_bayes.trial_log.writer import write_trials
from meal_bayes.trials import Trial, TrialOutcomes


@dataclass(frozen=True, slots=True)
class LogReport:
    """Result of a check."""

    path: Path
    trials: int  # that can be read back
    steps: int  # of those
    whole: bool  # nothing is missing, nothing was changed
    problems: tuple[str, ...]


def check_log(path: str | Path) -> LogReport:
    """Read a file to its end and report its contents and faults; damage does not raise."""
    scan = Scan(find_log(path), tolerant=True)
    for _ in scan.entries():
        pass
    read = scan.builder.read
    return LogReport(scan.path, read.trials, read.steps, not scan.problems, tuple(scan.problems))


def salvage(path: str | Path) -> Iterator[Trial | TrialOutcomes]:
    """Read every whole trial of a file, torn or not; the faults between them are passed over.

    Of a compact log it yields the outcomes of many trials each. A trial that was under way when the
    file ends comes last, as far as it went, with `ended`. Errors are as for `read_trials`, but only
    a file without a header and a trial is corrupt.
    """
    return _salvage(Scan(find_log(path), tolerant=True))


def recover_log(path: str | Path, out: str | Path | None = None) -> Path:
    """Write the trials of a torn file, as `salvage` reads them, into a new file; return its name.

    The new file is `<stem>.recovered.mcap` beside the torn one, or `out`; its header is the old one
    with `recovered_from`. The torn file stays as it is. Readers of the folder use the recovered
    file only where the log itself and its drafts are gone.

    Raises
    ------
    LogError
        `out` exists; and as for `salvage`.
    """
    scan = Scan(find_log(path), tolerant=True)
    out = recovered_name(scan.path) if out is None else Path(out)
    if out.exists():
        raise LogError(f"{out} exists already; remove it or name another file to recover into.")
    trials = _salvage(scan)
    first = next(trials, None)
    if first is None:
        raise LogCorruptError(f"{scan.path} holds no whole trial, so there is nothing to recover.")
    header = {**(scan.builder.header or {}), "recovered_from": scan.path.name}
    write_trials(out, itertools.chain([first], trials), header=header)
    return out


def _salvage(scan: Scan) -> Iterator[Trial | TrialOutcomes]:
    yield from scan.entries()
    unfinished = scan.unfinished()
    if unfinished is not None:
        yield unfinished
    elif scan.builder.header is None and not scan.builder.read.trials:
        raise LogCorruptError(
            f"{scan.path} holds nothing of a trial log: {scan.problems[0]}; expected a {SUFFIX} "
            "file that meal_bayes wrote."
        )

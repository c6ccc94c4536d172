"""What to do with a torn file: say what is wrong, save the whole trials."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from meal_bayes.agents.trial import Trial
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.reader import Scan, find_log
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX
from meal_bayes.trial_log.writer import TrialWriter


@dataclass(frozen=True, slots=True)
class LogReport:
    """What a check found."""

    path: Path
    trials: int  # that can be read back
    steps: int  # of those
    whole: bool  # nothing is missing, nothing was changed
    problems: tuple[str, ...]


def check_log(path: str | Path) -> LogReport:
    """Read a file to its end and say what is there and what is wrong; damage does not raise.

    Raises
    ------
    LogError : there is no such file.
    LogVersionError : the file has another format version.
    """
    scan = Scan(find_log(path), tolerant=True)
    for _ in scan.trials():
        pass
    built = scan.builder
    return LogReport(scan.path, built.trials, built.steps, not scan.problems, tuple(scan.problems))


def salvage(path: str | Path) -> Iterator[Trial]:
    """Read every whole trial of a file, torn or not; the faults between them are passed over.

    A trial that was under way when the file ends comes last, as far as it went, with `ended`.

    Raises
    ------
    LogError : there is no such file.
    LogCorruptError : the file holds neither a header nor a trial that can be read.
    LogVersionError : the file has another format version.
    """
    return _salvage(Scan(find_log(path), tolerant=True))


def recover_log(path: str | Path, out: str | Path | None = None) -> Path:
    """Write the trials of a torn file, as `salvage` reads them, into a new whole file.

    Return its name.

    The new file stands beside the torn one as `<stem>.recovered.mcap` unless `out` says otherwise;
    its header is the old one with `recovered_from`. The torn file stays as it is.

    Raises
    ------
    LogError : there is no such file, or `out` exists.
    LogCorruptError : no trial can be saved.
    LogVersionError : the file has another format version.
    """
    scan = Scan(find_log(path), tolerant=True)
    stem = scan.path.name.removesuffix(ACTIVE).removesuffix(SUFFIX)
    out = scan.path.with_name(f"{stem}.recovered{SUFFIX}") if out is None else Path(out)
    if out.exists():
        raise LogError(f"{out} exists already; remove it or name another file to recover into.")
    trials = _salvage(scan)
    first = next(trials, None)
    if first is None:
        raise LogCorruptError(f"{scan.path} holds no whole trial, so there is nothing to recover.")
    header = {**(scan.builder.header or {}), "recovered_from": scan.path.name}
    # Under a name of its own: <out>.active may be the very file that is being read.
    draft = out.with_name(f"{out.stem}.draft{SUFFIX}")
    with TrialWriter(draft, header) as log:
        log.write(first)
        for trial in trials:
            log.write(trial)
    return draft.replace(out)


def _salvage(scan: Scan) -> Iterator[Trial]:
    yield from scan.trials()
    unfinished = scan.unfinished()
    if unfinished is not None:
        yield unfinished
    elif scan.builder.header is None and not scan.builder.trials:
        raise LogCorruptError(
            f"{scan.path} holds nothing of a trial log: {scan.problems[0]}; expected a {SUFFIX} "
            "file that meal_bayes wrote."
        )

"""The log of one trial with a robot: every step is on disk before the next behavior."""

import contextlib
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

from meal_bayes.agents import Recorder, Trial
from meal_bayes.errors import LogError
from meal_bayes.trial_log import TrialWriter

_NUMBERED = re.compile(r"(\d{5,})-.*\.mcap")  # a log, or a draft of one
_RESERVED = re.compile(r"\.(\d{5,})\.reserved")


@contextlib.contextmanager
def next_log(folder: Path | None, domain: str, object_name: str) -> Iterator[Path | None]:
    """Yield a path such as logs/kitchen/00012-blue_cup.mcap, reserved for one trial.

    While the block runs, no other process or thread gets the number. A reservation that a
    killed process left is passed over.
    """
    if folder is None:
        yield None
        return
    own = folder / _file_name(domain)
    number, reserved = _reserve(own)
    try:
        yield own / f"{number:05d}-{_file_name(object_name)}.mcap"
    finally:
        reserved.unlink(missing_ok=True)


def _reserve(folder: Path) -> tuple[int, Path]:
    """Create the file that reserves the next number; only one process can."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        while True:
            number = max(_numbers(folder, _NUMBERED) | _numbers(folder, _RESERVED), default=-1) + 1
            reserved = folder / f".{number:05d}.reserved"
            with contextlib.suppress(FileExistsError):
                reserved.touch(exist_ok=False)
                if number not in _numbers(folder, _NUMBERED):  # since we looked
                    return number, reserved
                reserved.unlink()
    except OSError as fault:
        raise LogError(f"{folder} cannot be written: {fault.strerror or fault}.") from fault


def _numbers(folder: Path, pattern: re.Pattern[str]) -> set[int]:
    return {int(found[1]) for path in folder.iterdir() if (found := pattern.match(path.name))}


def logged(
    path: str | Path | None, header: Mapping[str, object], run: Callable[[Recorder | None], Trial]
) -> Trial:
    """Run a trial that is logged as it happens; what ends it early is raised after that.

    Parameters
    ----------
    path : of the log; None logs nothing.
    header : what the run is.
    run : runs the trial with a recorder.
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

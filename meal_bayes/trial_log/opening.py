"""A log that is opened to be read: each fault becomes ours, and says what to do about the file."""

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from meal_bayes.errors import LogCorruptError, LogError, LogVersionError
from meal_bayes.files import checked_path, command_line
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.container import FAULTS, fault_text, read_records
from meal_bayes.trial_log.decode import TrialBuilder
from meal_bayes.trial_log.foreign import ForeignFileError, check_size
from meal_bayes.trial_log.names import log_files


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """Open a file; every fault met inside becomes ours, with the file's name."""
    try:
        with _open(path) as file:
            yield file
    except LogVersionError as fault:
        raise LogVersionError(f"{path} was {fault}.") from fault
    except FAULTS as fault:
        raise LogCorruptError(_torn_text(path, fault)) from fault
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault}.") from fault


def _open(path: Path) -> BinaryIO:
    """Open a file; one that another process has renamed since it was found, by its new name."""
    try:
        return path.open("rb")
    except FileNotFoundError:
        return find_log(path).open("rb")


def find_log(path: str | Path) -> Path:
    """Return the log of a name, or what holds most of it where it is not there."""
    if checked_path("The log", path).is_dir():
        raise LogError(f"{path} is a folder, and no log; name one of its files.")
    return log_files(path)[0]


def _torn_text(path: Path, fault: Exception) -> str:
    """Say what is wrong with a file, or whose it is, and what to do."""
    try:
        return f"{path}: {fault_text(fault)}; {_mend_text(path, has_run=_has_run(path))}"
    except ForeignFileError as foreign:
        return f"{foreign.of(path)}."


def way_out(path: Path) -> str:
    """Say what to do about a torn file, whosever it is."""
    has_run = False
    with contextlib.suppress(ForeignFileError):
        has_run = _has_run(path)
    return _mend_text(path, has_run=has_run)


def _mend_text(path: Path, *, has_run: bool) -> str:
    """Say what to do about a file: where nothing of a run is left, nothing can be saved."""
    if has_run:
        return f"save its whole trials with: {command_line('meal-bayes log recover', path)}"
    return f"expected a {schema.SUFFIX} file that meal_bayes wrote"


def _has_run(path: Path) -> bool:
    """Return whether a torn file begins as a log of ours; `ForeignFileError` where it is none."""
    check_size(path, path.stat().st_size)
    builder = TrialBuilder()
    try:
        with path.open("rb") as file:
            for record in read_records(file):
                next(builder.records(record), None)
                if builder.ours or builder.header is not None:
                    return True
    except ForeignFileError:
        raise
    except (*FAULTS, LogError):
        pass  # what came before it tells whose it is
    builder.check_topics()
    return False

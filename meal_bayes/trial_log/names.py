"""Names of log files: whole, being written, recovered.

A log that is being written is a draft of a unique name, such as `run.w4711-a3f9c2.mcap.active` of
`run.mcap`, so that no two processes ever write into one file.
"""

import contextlib
import os
import re
import secrets
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path

from meal_bayes.errors import LogError
from meal_bayes.files import checked_path, file_name, hold
from meal_bayes.trial_log.schema import ACTIVE, FEEDBACK_FORM, SUFFIX

RECOVERED = ".recovered"
FEEDBACK = ".feedback"  # ends the stem of a log of feedback
FORM_ENDINGS = {FEEDBACK: FEEDBACK_FORM}
_FEEDBACK_FOLDER = "feedback"  # beside the logs of trials
_TIME = "%Y%m%d-%H%M%S-%f"
_DATED = re.compile(r"(\d{8}-\d{6}-\d{6})-")
_TICK = timedelta(microseconds=1)
_chosen_last = [""]  # time of the last name that this process has chosen
_DRAFT = r"(\.w\d+-[0-9a-f]{6})?"
_ENDINGS = re.compile(rf"{_DRAFT}(\.recovered)?{_DRAFT}$")  # what is recovered has drafts, too


def new_draft(path: Path) -> Path:
    """Choose a name for a log that is to become `path`."""
    return path.with_name(f"{path.stem}.w{os.getpid()}-{secrets.token_hex(3)}{SUFFIX}{ACTIVE}")


def dated_name(name: str, *folders: Path) -> str:
    """Choose a name for a log by the time (UTC) and an object's name; no other log has it.

    It is such as 20260131-142507-381904-blue_cup-a3f9c2, without an ending. Names stand in the
    order in which they are chosen, after all of the folders, too: where the clock was set back,
    the time is the next after the latest.
    """
    begun = datetime.now(UTC).replace(tzinfo=None)
    with contextlib.suppress(ValueError, OverflowError):  # of other files, whose digits are no time
        latest = max(_times_in(folders), default=_chosen_last[0])
        begun = max(begun, datetime.strptime(max(latest, _chosen_last[0]), _TIME) + _TICK)
    _chosen_last[0] = f"{begun:{_TIME}}"
    return f"{_chosen_last[0]}-{file_name(name)}-{secrets.token_hex(3)}"


def begun_text(path: Path) -> str:
    """Return when (UTC) what a log holds began, by its name of `dated_name`; "" of other names.

    >>> begun_text(Path("20260131-142507-381904-blue_cup-a3f9c2.mcap"))
    '2026-01-31 14:25:07'
    """
    dated = _DATED.match(path.name)
    if dated is not None:
        with contextlib.suppress(ValueError):  # of another file, whose digits are no time
            begun = datetime.strptime(dated[1], _TIME).replace(tzinfo=UTC)
            return f"{begun:%Y-%m-%d %H:%M:%S}"
    return ""


def _times_in(folders: Iterable[Path]) -> Iterator[str]:
    """Return the times that names in folders begin with."""
    for folder in filter(Path.is_dir, folders):
        for file in folder.iterdir():
            dated = _DATED.match(file.name)
            if dated is not None:
                yield dated[1]


def named_form(path: Path) -> str:
    """Return the form that the name of a log, or of a draft, is kept for; "" where trials are."""
    return FORM_ENDINGS.get(Path(stem_of(path)).suffix, "")


def feedback_files(folder: Path) -> list[Path]:
    """Find the whole logs of feedback on a folder's trials, in the order they were written."""
    return sorted((folder / _FEEDBACK_FOLDER).glob(f"*{FEEDBACK}{SUFFIX}"))


def feedback_of(folder: Path) -> list[Path]:
    """Find the whole logs of feedback that may be of a folder's trials, in their order.

    Trials of `Learner.find` stand in a folder of their own, below that of other trials.
    """
    files = [*feedback_files(folder), *feedback_files(folder.parent)]
    return sorted(files, key=lambda file: file.name)  # a name begins with the time


def feedback_name(folder: Path, name: str) -> Path:
    """Choose a name for a log of feedback on a trial of a folder, by its object's name.

    It is later than all that are read with it.
    """
    own_folder = folder / _FEEDBACK_FOLDER
    begun = dated_name(name, own_folder, folder.parent / _FEEDBACK_FOLDER)
    return own_folder / f"{begun}{FEEDBACK}{SUFFIX}"


def timing_of(path: Path) -> Path:
    """Name the table of seconds beside a log."""
    return path.with_suffix(".timing.csv")


def stem_of(path: Path) -> str:
    """Return what a log, its drafts and its recovered file have in common.

    >>> stem_of(Path("run.mcap")), stem_of(Path("run.w4711-a3f9c2.mcap.active"))
    ('run', 'run')
    """
    return _ENDINGS.sub("", path.name.removesuffix(ACTIVE).removesuffix(SUFFIX), count=1)


def drafts_of(path: Path) -> list[Path]:
    """Find the drafts of a log, the newest first; those of its recovered file are none."""
    drafts = dict[Path, float]()
    for file in path.parent.glob(f"*{SUFFIX}{ACTIVE}"):
        if stem_of(file) == path.stem and not _is_recovered(file):
            with contextlib.suppress(FileNotFoundError):  # it has got its name meanwhile
                drafts[file] = -file.stat().st_mtime
    return sorted(drafts, key=drafts.__getitem__)


def remove_drafts(path: str | Path) -> None:
    """Remove the drafts of a log that no process is writing any more."""
    for draft in drafts_of(checked_path("The log", path)):
        with contextlib.suppress(FileNotFoundError), draft.open("rb") as file:
            if hold(file):
                draft.unlink(missing_ok=True)


def log_files(path: str | Path) -> list[Path]:
    """Find the logs of a run: the file itself, or all of a folder in order of their names.

    Each log is found once: as the whole file; if there is none, as its largest draft; if there is
    none either, as what was recovered of it. So is a file that is not there: of a draft that was
    found a moment ago, another process may have ended the trial. Logs of feedback
    hold no trials, and are not found.

    Raises
    ------
    LogError
        There is no such file or folder, or it holds no log.
    """
    path = checked_path("The log", path)
    if path.is_file():
        return [path]
    if path.is_dir():
        file_of_log = _wholest(path.rglob(f"*{SUFFIX}*"))
        logs = sorted(file for log, file in file_of_log.items() if not named_form(log))
        if not logs:
            raise LogError(f"{path} holds no log (*{SUFFIX}).")
        return logs
    stem = stem_of(path) if path.name.endswith(ACTIVE) else path.stem
    wholest = _wholest(path.parent.glob(f"*{SUFFIX}*")).get(path.with_name(stem))
    if wholest is None:
        raise LogError(f"There is no log {path}; expected a {SUFFIX} file, or a folder of them.")
    return [wholest]


def _wholest(files: Iterable[Path]) -> dict[Path, Path]:
    """Return by log the file that holds most of it."""
    best = dict[Path, tuple[int, int, Path]]()  # how whole, bytes, file
    for file in files:
        if file.name.endswith((SUFFIX, SUFFIX + ACTIVE)) and file.is_file():
            with contextlib.suppress(FileNotFoundError):  # a draft that was renamed meanwhile
                candidate = (_wholeness(file), file.stat().st_size, file)
                log = file.with_name(stem_of(file))
                best[log] = max(best.get(log, candidate), candidate)
    return {log: file for log, (_, _, file) in best.items()}


def _wholeness(file: Path) -> int:
    """Return 2 of a log that was finished, 1 of a draft, 0 of what was recovered."""
    if _is_recovered(file):
        return 0
    return 1 if file.name.endswith(ACTIVE) else 2


def _is_recovered(file: Path) -> bool:
    """Return whether a file is what was recovered of a log, or a draft of that."""
    return RECOVERED in file.name.removeprefix(stem_of(file))

"""Searches read back: the log of each, and those of the objects that it explored beside it."""

import contextlib
from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

from meal_bayes.errors import LogCorruptError, LogError, QueryError
from meal_bayes.files import checked_path
from meal_bayes.trial_log.feedback import FeedbackIndex
from meal_bayes.trial_log.names import TURNS, drafts_of, explored_name, feedback_of, search_files
from meal_bayes.trial_log.reader import Scan, read_trials, readable_feedback, salvage
from meal_bayes.trial_log.schema import ACTIVE
from meal_bayes.trials import Search, Trial
from meal_bayes.trials.text import UNFINISHED


def search_of(path: str | Path) -> Path | None:
    """Return the log of a search, by its name or as the one of its folder; None of what is none."""
    files = search_files(checked_path("The log", path), below=False)
    return files[0] if files else None


def read_search(path: str | Path) -> Search:
    """Read a search from its folder: which objects it turned to, all trials, and what it claimed.

    It is equal to what was written. One that is under way, or whose process died, is read as far as
    it went, and says so in `ended`.

    Parameters
    ----------
    path : str or Path
        The folder, or the search's log in it.

    Raises
    ------
    LogError
        There is no search, or not the log of an object that it explored.
    LogCorruptError
        A log is torn or changed, or one of another search.
    LogVersionError
        A log has another format version.
    """
    file = search_of(path)
    if file is None:
        raise LogError(f"{path} holds no search; give the folder of one, which has {TURNS}.")
    drafts = [file, *drafts_of(file.with_name(TURNS))] if file.name.endswith(ACTIVE) else []
    scan = Scan(file, tolerant=bool(drafts))
    deque(scan.entries(), maxlen=0)
    record = scan.builder.search
    trials = dict[str, Trial]()
    for number, name in enumerate(record.explored, start=1):
        log = file.with_name(explored_name(number, name))
        versions = list(_furthest(log)) if drafts else list(read_trials(log))
        if versions:
            trials[name] = max(versions, key=lambda trial: len(trial.steps))
    try:
        return record.search(trials, UNFINISHED)
    except LogCorruptError as fault:
        raise LogCorruptError(f"{file}: {fault}.") from None


def unfinished_text(folder: Path) -> str:
    """Say of a search without its answer how it goes on."""
    return (
        f"{folder}: the search is not over; where its process died, "
        f"Learner.resume_find({str(folder)!r}) goes on with it"
    )


def _furthest(log: Path) -> Iterator[Trial]:
    """Yield what a log and each of its drafts hold of its trial."""
    for file in (log, *drafts_of(log)):
        with contextlib.suppress(LogError):  # it is not there, or its process died at once
            yield from (trial for trial in salvage(file) if isinstance(trial, Trial))


def searches_in(path: Path, on_fault: Callable[[str], object]) -> Iterator[tuple[Path, Search]]:
    """Yield the searches of a file or folder, with the truth that was told since; note faults."""
    for file in search_files(path):
        try:
            search = read_search(file)
            feedback = FeedbackIndex(readable_feedback(feedback_of(file.parent), on_fault))
            trials = {name: feedback.judged(trial) for name, trial in search.trials.items()}
        except (LogError, QueryError) as fault:
            on_fault(str(fault))
        else:
            yield file, replace(search, trials=trials)

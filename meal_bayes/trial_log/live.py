"""The log of one trial that is under way, and what a killed process left of it."""

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from meal_bayes.errors import LogError
from meal_bayes.files import hold
from meal_bayes.trial_log.names import dated_name, drafts_of, remove_drafts, stem_of
from meal_bayes.trial_log.reader import read_header, salvage
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX
from meal_bayes.trial_log.writer import TrialWriter
from meal_bayes.trials import Trial


class LiveLog(TrialWriter):
    """A log of one trial alone: open when it is made, closed when the trial ends.

    In a folder it is called such as logs/kitchen/20260131-142507-381904-blue_cup-a3f9c2.mcap, by
    the time (UTC) and the object's `name`; no other process or thread has this name.
    """

    def __init__(
        self,
        place: Path,
        header: Mapping[str, object],
        name: str = "",
        *,
        resumed: "Interrupted | None" = None,
    ) -> None:
        self._resumed = resumed  # the draft that it goes on from, held until this is whole
        if place.suffix != SUFFIX:
            place /= f"{dated_name(name)}{SUFFIX}"
        super().__init__(place, header)
        self.__enter__()

    def end(self, trial: Trial) -> None:
        """Write the outcome, and give the whole log its name."""
        super().end(trial)
        self.__exit__(None, None, None)
        if self._resumed is not None:
            self._resumed.release()
        remove_drafts(self.path)  # of processes that were killed in this trial


class NotBrokenOff(LogError):
    """A trial that another process drives, or that is over."""


class Interrupted:
    """A trial that a killed process left in the draft of a log, held by this process alone.

    Attributes
    ----------
    trial : Trial
        As far as it went.
    path : Path
        The name that its log gets.
    header : dict
        Of the log.
    """

    def __init__(self, draft: Path) -> None:
        try:
            self._file = draft.open("rb")
        except OSError:  # never there, or ended by another process a moment ago
            raise LogError(f"There is no trial {draft} that was broken off.") from None
        if not hold(self._file):
            self._file.close()
            # Whoever began it may be dead, and another have resumed it.
            who = re.search(r"\.w(\d+)-", draft.name)
            by = f" (process {who[1]} began it)" if who else ""
            raise NotBrokenOff(
                f"{draft} is under way in another process{by}: one process drives a robot at a "
                "time. Wait for it, or end it, and resume again."
            )
        self.path = _log_of(draft)
        # Only now, as whoever held it until then may have brought it to its end.
        if self.path != draft and self.path.is_file():
            self.release()
            raise NotBrokenOff(f"{self.path} is whole: its trial is over, nothing to resume.")
        try:
            self.header: dict[str, Any] = read_header(draft)
            trials = list(salvage(draft))
        except LogError:
            self.release()
            raise
        last = trials[-1] if trials else None
        begun = isinstance(self.header.get("begun"), dict)
        if not isinstance(last, Trial) or not last.ended or not begun:
            self.release()
            kind = NotBrokenOff if isinstance(last, Trial) and not last.ended else LogError
            raise kind(f"{draft} holds no trial that was broken off; there is nothing to resume.")
        self.trial = last

    def release(self) -> None:
        """Let others have the draft."""
        self._file.close()


def _log_of(file: Path) -> Path:
    """Return the name that a draft gets when it is whole."""
    return file.with_name(stem_of(file) + SUFFIX)


def _furthest(file: Path) -> Interrupted:
    """Return the trial of a log as far as any of its drafts holds it; each resumption has one."""
    held = list[Interrupted]()
    faults = list[LogError]()
    for draft in drafts_of(_log_of(file)) or [file]:
        try:
            held.append(Interrupted(draft))
        except LogError as fault:
            faults.append(fault)
    held.sort(key=lambda broken: len(broken.trial.steps))
    elsewhere = [fault for fault in faults if isinstance(fault, NotBrokenOff)]
    for broken in held if elsewhere else held[:-1]:
        broken.release()
    if elsewhere or not held:
        raise (elsewhere or faults)[0]
    return held[-1]


def interrupted(place: Path) -> Interrupted:
    """Return the trial that a killed process left of a log, or alone in a folder.

    Any of its drafts names the log.

    Raises
    ------
    LogError
        There is none, or there are several in the folder; another process drives it.
    """
    if place.is_file() and not place.name.endswith(ACTIVE):
        return Interrupted(place)
    if not place.is_dir():
        return _furthest(place)
    drafts = list[Interrupted]()
    for log in sorted({_log_of(draft) for draft in place.rglob(f"*{ACTIVE}")}):
        with contextlib.suppress(LogError):  # it is under way, or over, or holds no trial
            drafts.append(_furthest(log))
    if len(drafts) == 1:
        return drafts[0]
    for draft in drafts:
        draft.release()
    if not drafts:
        raise LogError(f"{place} holds no trial that was broken off; there is nothing to resume.")
    listed = "; ".join(
        f"{draft.trial.task.name} of {draft.trial.task.object_name}, "
        f"begun {stem_of(draft.path)[:15]}: resume({str(draft.path)!r})"
        for draft in drafts
    )
    raise LogError(f"{place} holds {len(drafts)} trials that were broken off: {listed}.")

"""The log of a trial that is under way, and what a killed process left of it."""

import contextlib
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.files import hold
from meal_bayes.trial_log.file import (
    ACTIVE,
    SUFFIX,
    TrialWriter,
    drafts_of,
    named_form,
    read_header,
    remove_drafts,
    salvage,
    stem_of,
)
from meal_bayes.trial_log.folder import begun_text, dated_name, time_of
from meal_bayes.trials import Trial
from meal_bayes.untrusted import open_regular


class LiveLog(TrialWriter):
    """A log of one trial alone: open when it is made, closed when the trial ends.

    In a folder it is called such as logs/kitchen/20260131-142507-381904-blue_cup-a3f9c2.mcap, by
    the time (UTC) and the object's `name`; no other process or thread has this name, and none that
    was begun before stands behind it.

    `resumed` is the draft that it goes on from, held until this log is whole.

    A `LogError` where a file has its name, or a draft of it holds a trial that is not over.
    """

    way_out = "give another name"

    def __init__(
        self,
        path: Path,
        header: Mapping[str, object],
        name: str = "",
        *,
        resumed: "Interrupted | None" = None,
    ) -> None:
        self._named_here = path.suffix.lower() not in (SUFFIX, ACTIVE)
        if self._named_here:  # as no other log, so that it has no drafts either
            path /= f"{dated_name(name, path)}{SUFFIX}"
        # What was broken off goes on under its own name; its file then holds the same steps.
        goes_on = resumed is not None and path == resumed.file == resumed.path
        super().__init__(path, header, overwrite=goes_on)
        self._resumed = resumed
        if resumed is None and not self._named_here:
            self._check_drafts()
        self.__enter__()

    def _check_drafts(self) -> None:
        """Refuse a name under which a trial is under way, or was broken off."""
        for draft in drafts_of(self.path):
            with contextlib.suppress(FileNotFoundError), draft.open("rb") as file:
                if not hold(file):
                    raise LogError(f"{self.path} is being written ({draft}); {self.way_out}.")
                with contextlib.suppress(LogCorruptError):  # nothing in it can be read
                    if next(salvage(draft), None) is not None:
                        raise LogError(
                            f"{self.path} contains an interrupted trial: "
                            f"Learner.resume({str(draft)!r}) continues it; or {self.way_out}."
                        )

    def end(self, trial: Trial, *, sync: bool = False) -> None:
        """Write the outcome, give the whole log its name, and remove drafts of dead processes."""
        try:
            super().end(trial, sync=sync)
        except BaseException as fault:
            self.__exit__(type(fault), fault, None)  # the draft stays, as far as it was written
            raise
        self.__exit__(None, None, None)
        if self._resumed is not None:
            self._resumed.release()
        if not self._named_here:
            remove_drafts(self.path)


class NotBrokenOff(LogError):
    """A trial that another process drives, or that is over."""


class OpenHere(NotBrokenOff):
    """A trial whose session in this process is not over."""


class Interrupted:
    """A trial that a killed process left in the draft of a log, held by this process alone.

    Attributes
    ----------
    path : Path
        The name that the log gets.
    file : Path
        The draft; or the log itself, where a fault ended the trial.
    header : dict
        The header of the log.
    trial : Trial
        The trial, as far as it went; its `ended` says what ended it.
    time : str
        When it began, as of `time_of`; where the name has no time, when the draft was last written.

    Raises
    ------
    LogError
        The draft is not there, is held by another process, or holds no trial that was broken off.
    """

    def __init__(self, draft: Path) -> None:
        try:
            self._file = open_regular(draft)
        except OSError:  # never there, or ended by another process a moment ago
            raise LogError(f"There is no interrupted trial {draft}.") from None
        if not hold(self._file):
            self._file.close()
            # Whoever began it may be dead, and another have resumed it.
            who = re.search(r"\.w(\d+)-", draft.name)
            if who is not None and int(who[1]) == os.getpid():
                raise OpenHere(
                    f"{draft} is open in this process. Go on with its session, or end the trial by "
                    "the session's cancel()."
                )
            by = f" (process {who[1]} began it)" if who else ""
            raise NotBrokenOff(
                f"{draft} is in progress in another process{by}, and only one process may drive a "
                f"robot. Wait for it, or end it, and resume again."
            )
        self.path = _log_of(draft)
        self.file = draft
        self.time = time_of(self.path) or time_of(draft)
        try:
            self.header: dict[str, Any] = read_header(draft)
            self.trial = self._read(draft)
        except LogError:
            self.release()
            raise

    def _read(self, draft: Path) -> Trial:
        """Return the trial of the draft, which has to be one that was broken off."""
        # Whoever held the draft until now may have brought the trial to its end.
        if self.path != draft and self.path.is_file():
            raise NotBrokenOff(
                f"{self.path} is complete: its trial is over, and there is nothing to resume."
            )
        last = next(reversed(list(salvage(draft))), None)
        if not isinstance(last, Trial) or not isinstance(self.header.get("begun"), dict):
            raise LogError(f"{draft} contains no interrupted trial; there is nothing to resume.")
        if not last.ended:
            raise NotBrokenOff(f"The trial of {draft} is over; there is nothing to resume.")
        return last

    def __str__(self) -> str:
        """Return what was asked, of which object, and when."""
        begun = begun_text(self.path)
        since = f", begun {begun} UTC" if begun else ""
        return f"{self.trial.task.name} of {self.trial.task.object_name}{since}"

    def release(self) -> None:
        """Let others have the draft."""
        self._file.close()


def _log_of(file: Path) -> Path:
    """Return the name that a draft gets when it is whole."""
    return file.with_name(stem_of(file) + SUFFIX)


def _furthest(file: Path) -> Interrupted:
    """Return what any of a log's drafts holds most of; each resumption has one."""
    readable = list[Interrupted]()
    faults = list[LogError]()
    for draft in drafts_of(_log_of(file)) or [file]:
        try:
            readable.append(Interrupted(draft))
        except LogError as fault:
            faults.append(fault)
    readable.sort(key=lambda broken: len(broken.trial.steps))
    elsewhere = [fault for fault in faults if isinstance(fault, NotBrokenOff)]
    elsewhere.sort(key=lambda fault: not isinstance(fault, OpenHere))
    for broken in readable if elsewhere else readable[:-1]:
        broken.release()
    if elsewhere or not readable:
        raise (elsewhere or faults)[0]
    return readable[-1]


def _ended_last(folder: Path) -> str:
    """Return a message about the latest log of a folder if an error ended its trial."""
    logs = [log for log in folder.rglob(f"*{SUFFIX}") if not named_form(log)]
    for latest in sorted(logs, key=lambda log: log.stat().st_mtime)[-1:]:
        with contextlib.suppress(LogError):
            broken = Interrupted(latest)
            broken.release()
            return (
                f" The latest, {broken}, was ended ({broken.trial.ended}): "
                f"resume({str(latest)!r}) continues it."
            )
    return ""


@contextlib.contextmanager
def resuming(path: Path) -> Iterator[Interrupted]:
    """Hold what `interrupted` returns, and let others have it where resuming fails."""
    broken = interrupted(path)
    try:
        yield broken
    except BaseException:
        broken.release()
        raise


def end_broken(path: Path) -> tuple[Trial, Interrupted]:
    """End an interrupted trial and complete its log; return the trial, and what was interrupted."""
    with resuming(path) as broken:
        trial = broken.trial
        log = LiveLog(broken.path, broken.header, trial.task.object_name, resumed=broken)
        log.begin(replace(trial, steps=(), report=None, ended=""))
        for step in trial.steps:
            log.step(step)
        trial = replace(trial, ended="" if trial.report is not None else "cancelled")
        log.end(trial)
        return trial, broken


def interrupted(path: Path) -> Interrupted:
    """Return the trial that a killed process left of a log, or alone in a folder.

    Any of its drafts names the log.

    Raises
    ------
    LogError
        There is none, or there are several in the folder; another process drives it.
    """
    if path.is_file() and not path.name.endswith(ACTIVE):
        return Interrupted(path)
    if not path.is_dir():
        return _furthest(path)
    drafts = list[Interrupted]()
    here: OpenHere | None = None
    logs = {_log_of(draft) for draft in path.rglob(f"*{ACTIVE}")}
    for log in sorted(log for log in logs if not named_form(log)):
        try:
            drafts.append(_furthest(log))
        except OpenHere as fault:
            here = fault
        except LogError:  # it is under way elsewhere, or over, or holds no trial
            pass
    if len(drafts) == 1:
        return drafts[0]
    for draft in drafts:
        draft.release()
    if here is not None and not drafts:
        raise here
    if not drafts:
        raise LogError(
            f"{path} contains no interrupted trial; there is nothing to resume."
            + _ended_last(path)
            + " The file of a learner does not contain the folder of its logs: name the folder if "
            "it is another one."
        )
    listed = "; ".join(f"{draft}: resume({str(draft.path)!r})" for draft in drafts)
    raise LogError(f"{path} holds {len(drafts)} interrupted trials: {listed}.")

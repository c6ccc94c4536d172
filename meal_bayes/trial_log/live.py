"""The log of a trial, or of a search, that is under way, and what a killed process left of it."""

import contextlib
import re
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.files import alone_in, hold
from meal_bayes.trial_log import names, schema
from meal_bayes.trial_log.encode import Packed, TrialEncoder
from meal_bayes.trial_log.reader import read_header, salvage
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX
from meal_bayes.trial_log.search_record import pack_claim, pack_search, pack_turn
from meal_bayes.trial_log.searches import read_search
from meal_bayes.trial_log.writer import TrialWriter
from meal_bayes.trials import Search, Session, Trial


class _Live(TrialWriter):
    """A log that is open from when it is made until what it records ends.

    `resumed` is the draft that it goes on from, held until this is whole.
    """

    def __init__(
        self, path: Path, header: Mapping[str, object], form: str, resumed: "BrokenOff | None"
    ) -> None:
        super().__init__(path, header, form)
        self._resumed = resumed

    def _close(self) -> None:
        """Give the whole log its name, and remove drafts of processes that were killed."""
        self.__exit__(None, None, None)
        if self._resumed is not None:
            self._resumed.release()
        names.remove_drafts(self.path)


class LiveLog(_Live):
    """A log of one trial alone: open when it is made, closed when the trial ends.

    In a folder it is called such as logs/kitchen/20260131-142507-381904-blue_cup-a3f9c2.mcap, by
    the time (UTC) and the object's `name`; no other process or thread has this name, and none that
    was begun before stands behind it.
    """

    def __init__(
        self,
        path: Path,
        header: Mapping[str, object],
        name: str = "",
        *,
        resumed: "Interrupted | None" = None,
    ) -> None:
        if path.suffix != SUFFIX:
            path /= f"{names.dated_name(name, path)}{SUFFIX}"
        super().__init__(path, header, schema.FULL, resumed)
        self.__enter__()

    def end(self, trial: Trial) -> None:
        """Write the outcome, and give the whole log its name."""
        try:
            super().end(trial)
        except BaseException as fault:
            self.__exit__(type(fault), fault, None)  # the draft stays, as far as it was written
            raise
        self._close()


class SearchLog(_Live):
    """The log of a search, in a folder of its own: each turn as it happens, and the answer.

    Parameters
    ----------
    folder : Path
        Of the search alone, beside its log for those of the objects that it explores.
    explore : Callable[[str, Session, Path], None]
        Records the trial of an object from now on, in a log of this name.

    Raises
    ------
    LogError
        The folder holds logs, and the search does not go on from one of them.
    """

    def __init__(
        self,
        folder: Path,
        header: Mapping[str, object],
        explore: Callable[[str, Session, Path], None],
        *,
        resumed: "InterruptedSearch | None" = None,
    ) -> None:
        super().__init__(folder / names.TURNS, header, schema.SEARCH_FORM, resumed)
        self._explore = explore
        self._explored = 0
        with alone_in(folder):  # of two searches that begin in it, one is refused
            if resumed is None:
                check_alone(folder)
            self.__enter__()

    def begin_search(self, search: Search) -> None:
        """Write what is searched for, and how each object's trial begins."""
        self._put([Packed(schema.SEARCH, 0, pack_search(search))])
        for number, trial in enumerate(search.trials.values()):
            start = replace(trial, steps=(), report=None, ended="")
            self._put(TrialEncoder(number, self._momdps).begin(start), sync=True)

    def turn(self, number: int, name: str, state: str) -> None:
        """Write the next turn to disk."""
        time = schema.log_time(number, 0)
        self._put([Packed(schema.TURN, time, pack_turn(number, name, state))], sync=True)

    def explore(self, name: str, session: Session) -> None:
        """Record an object's trial from now on, in the next log of the folder."""
        self._explored += 1
        self._explore(name, session, self.path.with_name(names.explored_name(self._explored, name)))

    def end_search(self, search: Search) -> None:
        """Write the answer, and give the whole log its name."""
        time = schema.log_time(len(search.turns), 0)
        self._put([Packed(schema.CLAIM, time, pack_claim(search))], sync=True)
        self._close()


def check_alone(folder: Path) -> None:
    """Refuse a folder that holds logs, but for a search whose process died before it began.

    Raises
    ------
    LogError
        It holds others.
    """
    logs = set(folder.glob(f"*{SUFFIX}*"))
    for draft in names.drafts_of(folder / names.TURNS):
        try:
            InterruptedSearch(draft).release()
        except NotBrokenOff:
            continue
        except LogError:
            if all(map(names.named_form, logs)):  # nothing was explored
                logs.remove(draft)
                draft.unlink(missing_ok=True)
    if logs:
        raise LogError(
            f"{folder} holds logs already, and a search has a folder of its own: name another. A "
            "search that was broken off goes on by Learner.resume_find(folder)."
        )


class NotBrokenOff(LogError):
    """A trial or a search that another process drives, or that is over."""


class BrokenOff(ABC):
    """What a killed process left in the draft of a log, held by this process alone.

    Attributes
    ----------
    path : Path
        The name that the log gets.
    header : dict
        Of the log.
    length : int
        How far it went, by which drafts of one log are compared: steps, or turns.
    text : str
        What it is, in a list of several.
    """

    length: int
    text: str
    why: str  # what ended it; empty where its process died
    noun = "trial"
    nouns = "trials"
    form = ""  # that names of such logs are kept for

    def __init__(self, draft: Path) -> None:
        try:
            self._file = draft.open("rb")
        except OSError:  # never there, or ended by another process a moment ago
            raise LogError(f"There is no {self.noun} {draft} that was broken off.") from None
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
            raise NotBrokenOff(f"{self.path} is whole: its {self.noun} is over, nothing to resume.")
        try:
            self.header: dict[str, Any] = read_header(draft)
            over = self._read(draft)
        except LogError as fault:
            self.release()
            if isinstance(fault, LogCorruptError) and self.form:
                raise LogError(
                    f"{draft} ends before the search began; begin it anew in this folder."
                ) from None
            raise
        if over:
            self.release()
            raise NotBrokenOff(f"The {self.noun} of {draft} is over; there is nothing to resume.")
        if over is None or not isinstance(self.header.get("begun"), dict):
            self.release()
            raise LogError(
                f"{draft} holds no {self.noun} that was broken off; there is nothing to resume."
            )

    @abstractmethod
    def _read(self, draft: Path) -> bool | None:
        """Read what the draft holds; return whether it is over, None where it holds nothing."""

    def release(self) -> None:
        """Let others have the draft."""
        self._file.close()


class Interrupted(BrokenOff):
    """A trial that a killed process left in the draft of a log, `trial`, as far as it went."""

    def _read(self, draft: Path) -> bool | None:
        trials = list(salvage(draft))
        last = trials[-1] if trials else None
        if not isinstance(last, Trial):
            return None
        self.trial = last
        self.length = len(last.steps)
        self.why = last.ended
        begun = names.begun_text(draft)
        since = f", begun {begun} UTC" if begun else ""
        self.text = f"{last.task.name} of {last.task.object_name}{since}"
        return not last.ended


class InterruptedSearch(BrokenOff):
    """A search that a killed process left in the draft of its log, `search`, as far as it went."""

    noun = "search"
    nouns = "searches"
    form = schema.SEARCH_FORM

    def _read(self, draft: Path) -> bool | None:
        self.search = read_search(draft)
        self.length = len(self.search.turns)
        self.why = self.search.ended
        self.text = f"{self.search.question} in {draft.parent.name}"
        return not self.search.ended


Broken = TypeVar("Broken", bound=BrokenOff)


def _log_of(file: Path) -> Path:
    """Return the name that a draft gets when it is whole."""
    return file.with_name(names.stem_of(file) + SUFFIX)


def _furthest(file: Path, kind: type[Broken]) -> Broken:
    """Return what any of a log's drafts holds most of; each resumption has one."""
    readable = list[Broken]()
    faults = list[LogError]()
    for draft in names.drafts_of(_log_of(file)) or [file]:
        try:
            readable.append(kind(draft))
        except LogError as fault:
            faults.append(fault)
    readable.sort(key=lambda broken: broken.length)
    elsewhere = [fault for fault in faults if isinstance(fault, NotBrokenOff)]
    for broken in readable if elsewhere else readable[:-1]:
        broken.release()
    if elsewhere or not readable:
        raise (elsewhere or faults)[0]
    return readable[-1]


def _ended_last(folder: Path, kind: type[BrokenOff]) -> str:
    """Say of the latest log of a folder that it was ended by a fault, and goes on by name."""
    logs = [log for log in folder.rglob(f"*{SUFFIX}") if names.named_form(log) == kind.form]
    for latest in sorted(logs, key=lambda log: log.stat().st_mtime)[-1:]:
        with contextlib.suppress(LogError):
            broken = kind(latest)
            broken.release()
            by = f"resume_find({str(latest.parent)!r})" if kind.form else f"resume({str(latest)!r})"
            return f" The latest, {broken.text}, was ended ({broken.why}): {by} goes on with it."
    return ""


@contextlib.contextmanager
def resuming(path: Path, kind: type[Broken]) -> Iterator[Broken]:
    """Hold what `interrupted` returns, and let others have it where resuming fails."""
    broken = interrupted(path, kind)
    try:
        yield broken
    except BaseException:
        broken.release()
        raise


def interrupted(path: Path, kind: type[Broken]) -> Broken:
    """Return the trial, or the search, that a killed process left of a log, or alone in a folder.

    Any of its drafts names the log.

    Raises
    ------
    LogError
        There is none, or there are several in the folder; another process drives it.
    """
    if path.is_file() and not path.name.endswith(ACTIVE):
        return kind(path)
    if not path.is_dir():
        return _furthest(path, kind)
    drafts = list[Broken]()
    logs = {_log_of(draft) for draft in path.rglob(f"*{ACTIVE}")}
    for log in sorted(log for log in logs if names.named_form(log) == kind.form):
        with contextlib.suppress(LogError):  # it is under way, or over, or holds no trial
            drafts.append(_furthest(log, kind))
    if len(drafts) == 1:
        return drafts[0]
    for draft in drafts:
        draft.release()
    if not drafts:
        search = not kind.form and any(map(names.named_form, logs))
        raise LogError(
            f"{path} holds no {kind.noun} that was broken off; there is nothing to resume."
            + (" A search goes on by Learner.resume_find()." if search else "")
            + _ended_last(path, kind)
            + " A learner's file does not keep where its logs are: name their folder if it is "
            "another."
        )
    call = "resume_find" if kind.form else "resume"
    listed = "; ".join(f"{draft.text}: {call}({str(draft.path)!r})" for draft in drafts)
    raise LogError(f"{path} holds {len(drafts)} {kind.nouns} that were broken off: {listed}.")

"""The log of one trial with a robot: every step is on disk before the next behavior is named."""

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path

from meal_bayes.errors import LogError
from meal_bayes.files import file_name
from meal_bayes.learner.experience import Key
from meal_bayes.trial_log import TrialWriter, read_header, remove_drafts, salvage
from meal_bayes.trial_log.names import drafts_of, stem_of
from meal_bayes.trials import Step, Trial

_NUMBERED = re.compile(r"(\d{5,})-.*\.mcap")  # a log, or a draft of one
_RESERVED = re.compile(r"\.(\d{5,})\.reserved")


class LiveLog:
    """Records one trial into a log of its own: opened when the trial begins, closed when it ends.

    In a folder it is called such as logs/kitchen/00012-blue_cup.mcap, by the object's `name`; no
    other process or thread gets the number, and a reservation that a killed process left is passed
    over.
    """

    def __init__(self, place: Path, header: Mapping[str, object], name: str = "") -> None:
        self.path, self._header, self._name = place, header, name
        self._reserved: Path | None = None

    def begin(self, trial: Trial) -> None:
        """Open the log, and write the start of the trial."""
        if self.path.suffix != ".mcap":
            number, self._reserved = _reserve(self.path)
            self.path /= f"{number:05d}-{file_name(self._name)}.mcap"
        self._writer = TrialWriter(self.path, self._header)
        self._writer.__enter__()
        self._writer.begin(trial)

    def step(self, step: Step) -> None:
        """Write the next step."""
        self._writer.step(step)

    def end(self, trial: Trial) -> None:
        """Write the outcome, and give the whole log its name."""
        try:
            self._writer.end(trial)
            self._writer.__exit__(None, None, None)
            remove_drafts(self.path)  # of processes that were killed in this trial
        finally:
            if self._reserved is not None:
                self._reserved.unlink(missing_ok=True)


def interrupted(log: Path) -> tuple[Trial, Key, LiveLog]:
    """Return the trial that a killed process left in a log, its streams' key, and a new log."""
    draft = next((path for path in [log, *drafts_of(log)] if path.is_file()), log)
    header, trials = read_header(draft), list(salvage(draft))
    streams, last = header.get("streams"), trials[-1] if trials else None
    if not isinstance(last, Trial) or not last.ended or not isinstance(streams, list):
        raise LogError(f"{draft} holds no trial that was broken off; there is nothing to resume.")
    return last, tuple(streams), LiveLog(draft.with_name(stem_of(draft) + ".mcap"), header)


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

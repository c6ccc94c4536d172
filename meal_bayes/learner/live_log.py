"""The log of one trial with a robot: every step is on disk before the next behavior is named."""

import contextlib
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from meal_bayes.errors import LogError
from meal_bayes.files import file_name
from meal_bayes.trial_log import TrialWriter, read_header, remove_drafts, salvage
from meal_bayes.trial_log.names import drafts_of, stem_of
from meal_bayes.trials import Trial

_NUMBERED = re.compile(r"(\d{5,})-.*\.mcap")  # a log, or a draft of one
_RESERVED = re.compile(r"\.(\d{5,})\.reserved")


class LiveLog(TrialWriter):
    """A log of one trial alone: open when it is made, closed when the trial ends.

    In a folder it is called such as logs/kitchen/00012-blue_cup.mcap, by the object's `name`; no
    other process or thread gets the number, and a reservation that a killed process left is passed
    over.
    """

    def __init__(self, place: Path, header: Mapping[str, object], name: str = "") -> None:
        self._reserved: Path | None = None
        if place.suffix != ".mcap":
            number, self._reserved = _reserve(place)
            place /= f"{number:05d}-{file_name(name)}.mcap"
        super().__init__(place, header)
        self.__enter__()

    def end(self, trial: Trial) -> None:
        """Write the outcome, and give the whole log its name."""
        try:
            super().end(trial)
            self.__exit__(None, None, None)
            remove_drafts(self.path)  # of processes that were killed in this trial
        finally:
            if self._reserved is not None:
                self._reserved.unlink(missing_ok=True)


def interrupted(log: Path) -> tuple[Trial, Path, dict[str, Any]]:
    """Return the trial that a killed process left in a log, the name of that, and its header."""
    draft = next((path for path in [log, *drafts_of(log)] if path.is_file()), log)
    header, trials = read_header(draft), list(salvage(draft))
    last = trials[-1] if trials else None
    if not isinstance(last, Trial) or not last.ended or not isinstance(header.get("streams"), list):
        raise LogError(f"{draft} holds no trial that was broken off; there is nothing to resume.")
    return last, draft.with_name(stem_of(draft) + ".mcap"), header


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

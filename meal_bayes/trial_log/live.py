"""The log of one trial that is under way, and what a killed process left of it."""

import secrets
from collections.abc import Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from meal_bayes.errors import LogError
from meal_bayes.files import file_name
from meal_bayes.trial_log.names import drafts_of, remove_drafts, stem_of
from meal_bayes.trial_log.reader import read_header, salvage
from meal_bayes.trial_log.writer import TrialWriter
from meal_bayes.trials import Trial


class LiveLog(TrialWriter):
    """A log of one trial alone: open when it is made, closed when the trial ends.

    In a folder it is called such as logs/kitchen/20260131-142507-381904-blue_cup-a3f9c2.mcap, by
    the time (UTC) and the object's `name`; no other process or thread has this name.
    """

    def __init__(self, place: Path, header: Mapping[str, object], name: str = "") -> None:
        if place.suffix != ".mcap":
            begun = datetime.now(UTC).strftime("%Y%m%d-%H%M%S-%f")
            place /= f"{begun}-{file_name(name)}-{secrets.token_hex(3)}.mcap"
        super().__init__(place, header)
        self.__enter__()

    def end(self, trial: Trial) -> None:
        """Write the outcome, and give the whole log its name."""
        super().end(trial)
        self.__exit__(None, None, None)
        remove_drafts(self.path)  # of processes that were killed in this trial


def interrupted(log: Path) -> tuple[Trial, Path, dict[str, Any]]:
    """Return the trial that a killed process left in a log, the name of that, and its header."""
    draft = next((path for path in [log, *drafts_of(log)] if path.is_file()), log)
    header = read_header(draft)
    trials = list(salvage(draft))
    last = trials[-1] if trials else None
    if not isinstance(last, Trial) or not last.ended or not isinstance(header.get("begun"), dict):
        raise LogError(f"{draft} holds no trial that was broken off; there is nothing to resume.")
    return last, draft.with_name(stem_of(draft) + ".mcap"), header

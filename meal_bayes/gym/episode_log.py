"""The log of the episodes of one Gymnasium environment: one file, opened at the first of them."""

import os
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from meal_bayes.trial_log.file import SUFFIX, TrialWriter
from meal_bayes.trial_log.folder import dated_name
from meal_bayes.trials import Session, Trial

LEFT = "left before the answer"  # `Trial.ended` of such an episode
EXTERNAL = "external"  # agent of an episode in which somebody else chose an action


class EpisodeLog:
    """Writes each episode with at least one step into one log when the episode ends or is left.

    The file is a draft until `close`. Every episode that was written before can be read after the
    process was killed. A copy of this object writes a file of its own, and so does the child of a
    fork.

    Parameters
    ----------
    folder : Path | None
        Folder of the log; None logs nothing.
    name : str
        Part of the name of the file.
    header : Mapping[str, object]
        Description of the environment in JSON values.
    """

    def __init__(self, folder: Path | None, name: str, header: Mapping[str, object]) -> None:
        self._folder = folder
        self._name = name
        self._header = header
        self._writer: TrialWriter | None = None
        self._process = os.getpid()
        self._session: Session | None = None  # of the episode that is not written yet
        self._seed = 0
        self.external = False  # whether somebody else than the agent chose an action

    def __getstate__(self) -> dict[str, Any]:
        """Return the state of a copy, which has no file yet."""
        return {**vars(self), "_writer": None}

    def begin(self, session: Session, seed: int) -> None:
        """Begin an episode, whose draws follow from the seed; nothing is written yet."""
        self._session = session
        self._seed = seed
        self.external = False

    def stepped(self, *, by_agent: bool) -> None:
        """Note a step, also one that was not legal; write the episode if it is over.

        `by_agent` says whether the agent of the environment chose the action.
        """
        self.external |= not by_agent
        if self._process != os.getpid():  # a fork: the file is the parent's
            self._process, self._writer = os.getpid(), None
        if self._session is not None and self._session.over:
            self._write(self._session)

    def leave(self, why: str = LEFT) -> None:
        """End the episode that is under way, and write it if it has a step."""
        session = self._session
        self._session = None
        if session is None or self._process != os.getpid():
            return
        session.cancel(why)
        if session.steps:
            self._write(session)

    def close(self) -> None:
        """Leave the episode that is under way, and give the file its name."""
        self.leave()
        writer, self._writer = self._writer, None
        if writer is not None and self._process == os.getpid():
            writer.__exit__(None, None, None)

    def trial(self, session: Session) -> Trial:
        """Return the trial of an episode so far, with who chose the actions."""
        trial = session.trial
        return replace(trial, agent=EXTERNAL) if self.external else trial

    def _write(self, session: Session) -> None:
        self._session = None
        if self._folder is None:
            return
        if self._writer is None:
            path = self._folder / f"{dated_name(self._name, self._folder)}{SUFFIX}"
            self._writer = TrialWriter(path, self._header).__enter__()
        trial = self.trial(session)
        # With the seed, from which all draws follow, no two different episodes have equal keys.
        key = (*trial.task.key, "seed", self._seed)
        self._writer.write(replace(trial, task=replace(trial.task, key=key)))

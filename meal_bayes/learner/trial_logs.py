"""Where a learner logs: its folder, and the folder in which the log of each trial lies."""

import os
from collections.abc import Mapping
from pathlib import Path

from meal_bayes.errors import SettingsError
from meal_bayes.files import file_name, lasting_path
from meal_bayes.seeds import Key
from meal_bayes.trial_log.file import SUFFIX
from meal_bayes.trial_log.folder import dated_name
from meal_bayes.trials import Trial


class TrialLogs:
    """Says where trials and what people tell of them are logged; None: nowhere.

    Parameters
    ----------
    logs : str or Path, optional
        Folder of the logs of robots.
    name : str
        Of the robot's domain: its folder in that one.
    """

    def __init__(self, logs: str | Path | None, name: str) -> None:
        self._folder = None if logs is None else lasting_path("logs", logs) / file_name(name)
        self._folder_of_trial: dict[Key, Path] = {}

    def log_path(self, log: str | Path | None) -> Path | None:
        """Return the log or folder that a caller names, or else the learner's folder."""
        return self._folder if log is None else lasting_path("log", log)

    def interrupted(self, log: str | Path | None, remedy: str) -> Path:
        """Return where to look for what was broken off; `SettingsError`, with a remedy, if nowhere.

        Parameters
        ----------
        log : str or Path, optional
            That a caller names.
        remedy : str
            "give resume() the trial's log".
        """
        path = self.log_path(log)
        if path is None:
            raise SettingsError(f"This learner has no folder of logs; {remedy}.")
        return path

    def folder_of_find(self, log: str | Path | None) -> Path | None:
        """Return the folder for the logs of `find`; `SettingsError` where it cannot be one."""
        path = self.log_path(log)
        if path is None:
            return None
        if log is None:
            return path / dated_name("find", path)
        if path.suffix == SUFFIX or path.is_file():
            raise SettingsError(f"find() writes a log for each object; give a folder, not {path}.")
        return path

    def note(self, folders: Mapping[Key, Path]) -> None:
        """Note the folders in which the logs of some trials lie, by the trials' keys."""
        self._folder_of_trial |= folders

    def told_folder(self, trial: Trial | str) -> Path | None:
        """Return where to log what is told: beside the trial's log if that can be written."""
        if isinstance(trial, Trial):
            beside = self._folder_of_trial.get(trial.task.key)
            if beside is not None and os.access(beside, os.W_OK):
                return beside
        return self._folder

"""Folders of a learner's logs, and the folder that contains the log of each trial."""

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
    """Paths of the logs of trials and labels.

    Parameters
    ----------
    logs : str or Path, optional
        Folder of logs; with None, nothing is logged.
    name : str
        Name of the robot's domain, which is also the name of its folder in `logs`.
    """

    def __init__(self, logs: str | Path | None, name: str) -> None:
        self._folder = None if logs is None else lasting_path("logs", logs) / file_name(name)
        self._folder_of_trial: dict[Key, Path] = {}

    def log_path(self, log: str | Path | None) -> Path | None:
        """Return the log or folder that a caller names, or else the learner's folder."""
        return self._folder if log is None else lasting_path("log", log)

    def interrupted(self, log: str | Path | None, remedy: str) -> Path:
        """Return the path of the logs of interrupted trials; raise `SettingsError` without one.

        Parameters
        ----------
        log : str or Path, optional
            Log or folder that the caller gives.
        remedy : str
            Last part of the error message, such as "give resume() the trial's log".
        """
        path = self.log_path(log)
        if path is None:
            raise SettingsError(f"This learner has no folder of logs; {remedy}.")
        return path

    def folder_of_find(self, log: str | Path | None) -> Path | None:
        """Return the folder for the logs of `find`; raise `SettingsError` if it is a file."""
        path = self.log_path(log)
        if path is None:
            return None
        if log is None:
            return path / dated_name("find", path)
        if path.suffix == SUFFIX or path.is_file():
            raise SettingsError(f"find() writes a log for each object; give a folder, not {path}.")
        return path

    def note(self, folders: Mapping[Key, Path]) -> None:
        """Store the folders of the logs of some trials, by the keys of the trials."""
        self._folder_of_trial |= folders

    def has_logged(self, trial: Key) -> bool:
        """Return whether there is a log of a trial, by its key; also of a test."""
        return trial in self._folder_of_trial

    def told_folder(self, trial: Trial | str) -> Path | None:
        """Return the folder for labels: that of the trial's log if it is writable."""
        if isinstance(trial, Trial):
            beside = self._folder_of_trial.get(trial.task.key)
            if beside is not None and os.access(beside, os.W_OK):
                return beside
        return self._folder

"""The logs of a run, read as far as they can be: what a viewer or a report wants."""

import contextlib
import filecmp
import json
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.names import log_files, stem_of
from meal_bayes.trial_log.reader import Scan, grouped, read_header, without_steps
from meal_bayes.trial_log.schema import ACTIVE
from meal_bayes.trials import Trial, TrialOutcomes

# Settings that choose trials of a run, or the form of their log, and change none.
_APART = ("agents", "repeats", "first", "log")
_LATER = ("versions", "recovered_from")  # entries of a header that are no setting


class Group(NamedTuple):
    """Trials that stand next to each other in a file."""

    header: dict[str, object]
    file: Path
    places: Sequence[int]  # of each trial in the file
    outcomes: TrialOutcomes
    trials: tuple[Trial, ...]  # none of a compact log


class Logs:
    """One or more logs, damaged ones included: faults are noted, whole trials are read.

    A unit that several files hold, such as a draft and a later run of it, is read once.

    Parameters
    ----------
    paths : str | Path
        Files, or folders of them.

    Raises
    ------
    LogError
        A path that is not there, or a folder without logs.
    """

    def __init__(self, *paths: str | Path) -> None:
        files = {file.resolve(): file for path in paths for file in log_files(path)}
        self.files: Sequence[Path] = list(files.values())
        self.problems: list[str] = []  # grows while trials are read

    @property
    def header(self) -> dict[str, object]:
        """What the run was, as the first file with a header says; empty where none has one."""
        return next((header for header in self._headers if header), {})

    @cached_property
    def _headers(self) -> list[dict[str, object]]:
        headers: list[dict[str, object]] = [{} for _ in self.files]
        for file, header in zip(self.files, headers, strict=True):
            with contextlib.suppress(LogCorruptError):
                header.update(read_header(file))
        return headers

    def groups(self) -> Iterator[Group]:
        """Yield the trials of all files in groups, each trial once.

        Raises
        ------
        LogError
            Files of several data sets, or of different runs with equal settings.
        LogVersionError
            A file of another format version.
        """
        for file, header in self._distinct():
            scan = Scan(file, tolerant=True)
            for place, outcomes, trials in grouped(scan):
                places = range(place, place + len(outcomes))
                yield Group(header, file, places, outcomes, trials)
            if file.name.endswith(ACTIVE):
                why = f" ({scan.problems[0]})" if scan.problems else ""
                self.problems.append(f"{file} was not finished by its writer{why}")
            else:
                self.problems += [f"{file}: {problem}" for problem in scan.problems]

    def trials(self) -> Iterator[Trial]:
        """Yield the trials of all files; compact logs, which hold no steps, are noted.

        Raises
        ------
        LogCorruptError
            There is not one trial that can be read, in files that are damaged.
        LogError
            There is no trial in them, though they are sound; and as for `groups`.
        LogVersionError
            A file of another format version.
        """
        full, compact = False, list[Path]()
        for group in self.groups():
            yield from group.trials
            if group.trials:
                full = True
            elif group.file not in compact:
                compact.append(group.file)
        if compact and not full:
            raise LogError(without_steps(compact[0]))
        if compact:
            such = f"{len(compact)} compact logs, such as {compact[0]}"
            self.problems.append(f"{such}, have no steps")
        elif not full:
            self.complain_of_nothing()

    def complain_of_nothing(self) -> None:
        """Raise the error of logs without a trial."""
        if self.problems:
            raise LogCorruptError(f"Not one trial can be read: {self.problems[0]}.")
        raise LogError(f"{self.files[0]} holds no trial yet.")

    def _distinct(self) -> list[tuple[Path, dict[str, object]]]:
        """Return the files but for copies; check that they are of one data set, and of one run."""
        first, units = dict[str, Path](), dict[tuple[str, str, str], Path]()
        files = []
        for file, header in zip(self.files, self._headers, strict=True):
            config = header.get("config")
            if isinstance(config, dict):
                settings = {name: value for name, value in header.items() if name not in _LATER}
                settings["config"] = {k: v for k, v in config.items() if k not in _APART}
                text = json.dumps(settings, sort_keys=True, default=str)
                other = units.setdefault((text, file.parent.name, stem_of(file)), file)
                if other is not file:
                    if filecmp.cmp(file, other, shallow=False):
                        continue
                    raise LogError(
                        f"{other} and {file} hold different trials under equal settings, as other "
                        "code or other recordings make them; name the logs of one run."
                    )
            files.append((file, header))
            name = config.get("dataset") if isinstance(config, dict) else None
            name = name or header.get("data")  # objects are known by their numbers in it
            if isinstance(name, str):
                first.setdefault(name, file)
        if len(first) > 1:
            named = ", ".join(f"{name} (such as {file})" for name, file in first.items())
            raise LogError(f"These logs are of {len(first)} data sets: {named}; name one's logs.")
        return files

"""The logs of a run, read as far as they can be: what a viewer or a report wants."""

import contextlib
import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.names import log_files
from meal_bayes.trial_log.reader import Scan, grouped, read_header, without_steps
from meal_bayes.trial_log.schema import ACTIVE
from meal_bayes.trials import Trial, TrialOutcomes

# Settings that choose trials of a run, or the form of their log, and change none.
_APART = ("agents", "repeats", "first", "log")
_LATER = ("versions", "recovered_from", "labels")  # entries of a header that are no setting


class Group(NamedTuple):
    """Trials that stand next to each other in a file."""

    header: dict[str, object]
    file: Path
    places: tuple[int, ...]  # of each trial in the file
    outcomes: TrialOutcomes
    trials: tuple[Trial, ...]  # none of a compact log


class Logs:
    """One or more logs, damaged ones included: faults are noted, whole trials are read.

    A trial that several files hold, such as a draft and a later run of the same unit, is read once.

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
        self._check_data_sets()
        seen: dict[bytes, tuple[bytes, Path]] = {}
        for file, header in zip(self.files, self._headers, strict=True):
            yield from self._read(file, header, seen)

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

    def _check_data_sets(self) -> None:
        """Check that the files are of one data set, as objects are known by their numbers."""
        first: dict[str, Path] = {}
        for file, header in zip(self.files, self._headers, strict=True):
            config = header.get("config")
            name = config.get("dataset") if isinstance(config, dict) else None
            name = name or header.get("data")
            if isinstance(name, str):
                first.setdefault(name, file)
        if len(first) > 1:
            named = ", ".join(f"{name} (such as {file})" for name, file in first.items())
            raise LogError(f"These logs are of {len(first)} data sets: {named}; name one's logs.")

    def _read(
        self, file: Path, header: dict[str, object], seen: dict[bytes, tuple[bytes, Path]]
    ) -> Iterator[Group]:
        """Read a file's trials that no file before has."""
        scan, run = Scan(file, tolerant=True), run_digest(header)
        settled = "config" in header  # then equal tasks make equal trials
        times = Counter[bytes]()  # a file may hold equal trials, which are different ones
        for place, outcomes, trials in grouped(scan):
            new = list[int]()
            for row, (task, content) in enumerate(outcome_digests(outcomes)):
                identity = run + (task if settled else content)
                times[identity] += 1
                identity += str(times[identity]).encode()
                held = seen.setdefault(identity, (content, file))
                if held[0] != content:
                    raise LogError(
                        f"{held[1]} and {file} hold different trials of one task under equal "
                        "settings, as other code or other recordings make them; name the logs of "
                        "one run."
                    )
                if held[1] is file:
                    new.append(row)
            if new:
                unseen = outcomes.rows(new) if len(new) < len(outcomes) else outcomes
                places = tuple(place + row for row in new)
                yield Group(header, file, places, unseen, tuple(trials[i] for i in new if trials))
        if file.name.endswith(ACTIVE):
            why = f" ({scan.problems[0]})" if scan.problems else ""
            self.problems.append(f"{file} was not finished by its writer{why}")
        else:
            self.problems += [f"{file}: {problem}" for problem in scan.problems]


def outcome_digests(outcomes: TrialOutcomes) -> Iterator[tuple[bytes, bytes]]:
    """Yield digests of each trial's task and of what came of it, whatever file it is in."""
    numbers = np.column_stack(
        [outcomes.positive, outcomes.cost, outcomes.reward, outcomes.steps, outcomes.truth,
         outcomes.report]
    )  # fmt: skip
    asked = outcomes.attribute != ""
    single = np.ones((len(outcomes), 3), np.bool_)
    kept = np.column_stack([asked, single, asked, asked])
    names = (outcomes.agent, outcomes.key, outcomes.object_name, outcomes.ended, outcomes.attribute)
    texts = zip(*(column.tolist() for column in names), strict=True)
    for values, mask, (agent, key, name, ended, asked_names) in zip(
        numbers, kept, texts, strict=True
    ):
        task = f"{agent}\0{key}"
        content = "\0".join([task, name, ended, *filter(None, asked_names)])
        yield _digest(task.encode()), _digest(content.encode() + values[mask].tobytes())


def _digest(content: bytes) -> bytes:
    return hashlib.blake2b(content, digest_size=16).digest()


def run_digest(header: dict[str, object]) -> bytes:
    """Compute a digest of the run's settings and of the log's place in it."""
    settings = {name: value for name, value in header.items() if name not in _LATER}
    if isinstance(config := settings.get("config"), dict):
        settings["config"] = {name: value for name, value in config.items() if name not in _APART}
    text = json.dumps(settings, sort_keys=True, default=str)
    return _digest(text.encode())

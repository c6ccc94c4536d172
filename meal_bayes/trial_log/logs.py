"""The logs of a run, read as far as they can be: what a viewer or a report wants."""

import hashlib
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import cached_property
from pathlib import Path

from meal_bayes.agents.trial import Trial
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.trial_log.names import drafts_of, is_log, is_recovered, stem_of
from meal_bayes.trial_log.reader import Scan, read_header
from meal_bayes.trial_log.schema import ACTIVE, SUFFIX

_APART = ("agents", "repeats", "first")  # settings that choose trials of a run and change none
_LATER = ("versions", "recovered_from", "told")  # entries of a header that are no setting


def log_files(path: str | Path) -> list[Path]:
    """Find the logs of a run: the file itself, or all of a folder in order of their names.

    A file that is still being written is among them, under the name it has. A recovered file is
    left out where what it was recovered from is there.

    Raises
    ------
    LogError : there is no such file or folder, or it holds no log.
    """
    path = Path(path)
    if path.is_dir():
        found = sorted(file for file in path.rglob("*") if is_log(file) and file.is_file())
        if not found:
            raise LogError(f"{path} holds no log (*{SUFFIX}).")
        sources = {file.with_name(stem_of(file)) for file in found if not is_recovered(file)}
        return [
            file
            for file in found
            if not (is_recovered(file) and file.with_name(stem_of(file)) in sources)
        ]
    for one in (path, *drafts_of(path)):
        if one.is_file():
            return [one]
    raise LogError(f"There is no log {path}; expected a {SUFFIX} file, or a folder of them.")


class Logs:
    """One or more logs, damaged ones included: faults are noted, whole trials are given.

    A trial that several files hold, such as a draft and what a later run made of the same unit, is
    given once.

    Parameters
    ----------
    paths : files, or folders of them.

    Raises
    ------
    LogError : a path that is not there, or a folder without logs.
    """

    def __init__(self, *paths: str | Path) -> None:
        found = {file.resolve(): file for path in paths for file in log_files(path)}
        self.files: Sequence[Path] = list(found.values())
        self.problems: list[str] = []  # grows while trials are read

    @property
    def header(self) -> dict[str, object]:
        """What the run was, as the first file with a header says; empty where none has one."""
        return next((header for header in self._headers if header), {})

    @cached_property
    def _headers(self) -> list[dict[str, object]]:
        return list(map(_header, self.files))

    def parts(self) -> Iterator[tuple[dict[str, object], Iterator[tuple[int, Trial]]]]:
        """Yield for each file its header and its trials, each with its number in the file.

        Raises
        ------
        LogError : files of several data sets, or of different runs with equal settings.
        LogVersionError : a file of another format version.
        """
        self._check_data_sets()
        seen: dict[bytes, tuple[bytes, Path]] = {}
        for file, header in zip(self.files, self._headers, strict=True):
            yield header, self._read(file, header, seen)

    def trials(self) -> Iterator[Trial]:
        """Yield the trials of all files.

        Raises
        ------
        LogCorruptError : there is not one trial that can be read, in files that are damaged.
        LogError : there is no trial in them, though they are sound; and as for `parts`.
        LogVersionError : a file of another format version.
        """
        found = False
        for _, trials in self.parts():
            for _, trial in trials:
                found = True
                yield trial
        if not found:
            self.complain_of_nothing()

    def complain_of_nothing(self) -> None:
        """Raise the error of logs without a trial."""
        if self.problems:
            raise LogCorruptError(f"Not one trial can be read: {self.problems[0]}.")
        raise LogError(f"{self.files[0]} holds no trial yet.")

    def _check_data_sets(self) -> None:
        """Check that the files tell of one data set, as objects are known by their numbers."""
        found: dict[str, Path] = {}
        for file, header in zip(self.files, self._headers, strict=True):
            config = header.get("config")
            name = config.get("dataset") if isinstance(config, dict) else None
            name = name or header.get("data")
            if isinstance(name, str):
                found.setdefault(name, file)
        if len(found) > 1:
            told = ", ".join(f"{name} (such as {file})" for name, file in found.items())
            raise LogError(f"These logs are of {len(found)} data sets: {told}; name one's logs.")

    def _read(
        self, file: Path, header: dict[str, object], seen: dict[bytes, tuple[bytes, Path]]
    ) -> Iterator[tuple[int, Trial]]:
        """Read a file's trials that no file before has."""
        scan, run = Scan(file, tolerant=True), run_digest(header)
        settled = "config" in header  # then equal tasks make equal trials
        times = Counter[bytes]()  # a file may hold equal trials, which are different ones
        for number, trial in enumerate(scan.trials()):
            content = trial_digest(trial)
            task = repr((trial.agent, trial.task.key)).encode() if settled else content
            identity = run + task
            times[identity] += 1
            identity += str(times[identity]).encode()
            if identity not in seen:
                seen[identity] = content, file
                yield number, trial
            elif (held := seen[identity])[0] != content:
                raise LogError(
                    f"{held[1]} and {file} hold different trials of one task under equal settings, "
                    "as other code or other recordings make them; name the logs of one run."
                )
        if file.name.endswith(ACTIVE):
            why = f" ({scan.problems[0]})" if scan.problems else ""
            self.problems.append(f"{file} was not finished by its writer{why}")
        else:
            self.problems += [f"{file}: {problem}" for problem in scan.problems]


def trial_digest(trial: Trial) -> bytes:
    """Digest what happened in a trial; equal trials have equal ones, whatever file they are in."""
    parts: list[object] = [trial.agent, trial.task.name, trial.task.key, trial.task.object_name]
    parts += [trial.truth.tolist(), None if trial.report is None else trial.report.tolist()]
    for step in trial.steps:
        seen = None if step.observation is None else step.observation.tolist()
        parts += [
            step.decision.action,
            step.next_x,
            seen,
            step.reward,
            step.belief.positive.tolist(),
        ]
    return hashlib.blake2b(repr(parts).encode(), digest_size=16).digest()


def run_digest(header: dict[str, object]) -> bytes:
    """Digest what a log tells of the run and of its own place in it."""
    told = {name: value for name, value in header.items() if name not in _LATER}
    if isinstance(config := told.get("config"), dict):
        told["config"] = {name: value for name, value in config.items() if name not in _APART}
    text = json.dumps(told, sort_keys=True, default=str)
    return hashlib.blake2b(text.encode(), digest_size=16).digest()


def _header(file: Path) -> dict[str, object]:
    try:
        return read_header(file)
    except LogCorruptError:
        return {}

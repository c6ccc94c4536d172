"""The logs of a folder: their names, what people told of their trials, and how all are read.

`Logs` reads a run's logs as far as they can be read; `Follower` reads them while they are written.
"""

import contextlib
import filecmp
import itertools
import json
import os
import re
import secrets
import warnings
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from datetime import UTC, datetime, timedelta
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mcap.records import DataEnd

from meal_bayes.arrays import Bools
from meal_bayes.digests import checksum_of
from meal_bayes.errors import LogCorruptError, LogError, LogVersionError, QueryError
from meal_bayes.files import checked_path, command_line, file_name
from meal_bayes.seeds import Key
from meal_bayes.trial_log.feedback import Change, Feedback, FeedbackIndex
from meal_bayes.trial_log.file import (
    ACTIVE,
    CUT_SHORT,
    FAULTS,
    FEEDBACK_FORM,
    FULL,
    SUFFIX,
    TORN,
    ForeignFileError,
    Scan,
    TrialBuilder,
    TrialWriter,
    fault_text,
    find_log,
    grouped,
    named_form,
    read_header,
    read_records,
    stem_of,
    wholest,
)
from meal_bayes.trials import Trial, TrialOutcomes
from meal_bayes.untrusted import open_regular

ASK = "Learner.ask"  # command of the logs of trials with a robot
LIVE = "live"  # in the keys of such trials, before what no other trial has
_FEEDBACK_FOLDER = "feedback"  # beside the logs of trials
_FEEDBACK = f".feedback{SUFFIX}"  # ends the names of its logs
_CHANGE = "learner"  # in such names, in place of an object: of changes of a learner
_TIME = "%Y%m%d-%H%M%S-%f"
_DATED = re.compile(r"(\d{8}-\d{6}-\d{6})-")
_TICK = timedelta(microseconds=1)
_chosen_last = [""]  # time of the last name that this process has chosen
# Settings that choose trials of a run, or the form of their log, and change none.
_APART = ("agents", "repeats", "first", "log")
_NAMED = 10  # copies that a warning names
_LATER = ("versions", "recovered_from")  # entries of a header that are no setting


def dated_name(name: str, *folders: Path) -> str:
    """Choose a unique name for a log by the time (UTC) and the name of an object.

    An example is 20260131-142507-381904-blue_cup-a3f9c2; it has no ending. The names sort in the
    order in which they are chosen, and behind all names in `folders`: if the clock was set back,
    the time is one microsecond after the latest time.
    """
    begun = datetime.now(UTC).replace(tzinfo=None)
    with contextlib.suppress(ValueError, OverflowError):  # of other files, whose digits are no time
        latest = max(_times_in(folders, f"{begun:{_TIME}}"), default=_chosen_last[0])
        begun = max(begun, datetime.strptime(max(latest, _chosen_last[0]), _TIME) + _TICK)
    _chosen_last[0] = f"{begun:{_TIME}}"
    return f"{_chosen_last[0]}-{file_name(name)}-{secrets.token_hex(3)}"


def present_time() -> str:
    """Return the present time (UTC) as in a name of `dated_name`, not before the last name."""
    return max(f"{datetime.now(UTC):{_TIME}}", _chosen_last[0])


def time_of(log: Path) -> str:
    """Return the time in a name of `dated_name`; for other names, when the file was last changed.

    If there is no such file, return "".
    """
    dated = _DATED.match(log.name)
    if dated is not None:
        return dated[1]
    with contextlib.suppress(OSError):  # another process has renamed it
        return f"{datetime.fromtimestamp(log.stat().st_mtime, UTC):{_TIME}}"
    return ""


def begun_text(path: Path) -> str:
    """Return the time (UTC) in a name that `dated_name` chose; "" for other names.

    >>> begun_text(Path("20260131-142507-381904-blue_cup-a3f9c2.mcap"))
    '2026-01-31 14:25:07'
    """
    dated = _DATED.match(path.name)
    if dated is not None:
        with contextlib.suppress(ValueError):  # of another file, whose digits are no time
            begun = datetime.strptime(dated[1], _TIME).replace(tzinfo=UTC)
            return f"{begun:%Y-%m-%d %H:%M:%S}"
    return ""


def _times_in(folders: Iterable[Path], since: str) -> Iterator[str]:
    """Return the times that names in folders begin with, if they are not before a time."""
    for folder in filter(Path.is_dir, folders):
        for name in os.listdir(folder):  # noqa: PTH208  fast where there are thousands
            if name >= since and (dated := _DATED.match(name)) is not None:
                yield dated[1]


def log_files(path: str | Path, *, feedback: bool = False) -> list[Path]:
    """Find the logs of a run: the file itself, or all logs of a folder in the order of their names.

    Each log is found once: as the complete file; without this, as its largest draft; without
    drafts, as its recovered file. The path of a log that does not exist is looked up in the same
    way (`find_log`). Hidden files and folders, such as `._run.mcap`, are skipped. Logs of feedback
    contain no trials, and are found in a folder only with `feedback`.

    Raises
    ------
    LogError
        There is no such file or folder, or it holds no log.
    """
    path = checked_path("The log", path)
    if not path.is_dir():
        return [find_log(path)]
    file_of_log = wholest(_shown(path.rglob(f"*{SUFFIX}*"), path))
    logs = sorted(file for log, file in file_of_log.items() if feedback or not named_form(log))
    if not logs:
        raise LogError(f"{path} holds no log (*{SUFFIX}).")
    return logs


def _shown(files: Iterable[Path], folder: Path) -> Iterator[Path]:
    """Yield the files of a folder that neither are hidden nor lie in a hidden folder below it."""
    for file in files:
        if not any(part.startswith(".") for part in file.relative_to(folder).parts):
            yield file


def feedback_files(folder: Path) -> list[Path]:
    """Find the whole logs of feedback in a folder, in the order in which they were written."""
    own_folder = folder / _FEEDBACK_FOLDER
    return sorted(_shown(own_folder.glob(f"*{_FEEDBACK}"), own_folder))


def feedback_of(folder: Path) -> list[Path]:
    """Find the whole logs of feedback in a folder and in the folder above it, in their order.

    Trials of `Learner.find` are in a folder below that of other trials.
    """
    files = [*feedback_files(folder), *feedback_files(folder.parent)]
    return sorted(files, key=lambda file: file.name)  # a name begins with the time


def feedback_name(folder: Path, name: str) -> Path:
    """Choose a path for a log of feedback, by the name of the object.

    The time in the name is later than in all logs of feedback that are read with it.
    """
    own_folder = folder / _FEEDBACK_FOLDER
    begun = dated_name(name, own_folder, folder.parent / _FEEDBACK_FOLDER)
    return own_folder / f"{begun}{_FEEDBACK}"


def write_feedback(
    folder: Path, feedback: Feedback | Change, *, header: Mapping[str, object]
) -> Path:
    """Write labels or a change of the learner into a new log of a folder; return its path.

    When the function returns, the log is complete on disk. Several processes may write at once.

    Parameters
    ----------
    folder : Path
        Folder with the logs of trials.
    feedback : Feedback | Change
        Labels of a trial or of an object, or a change of the learner.
    header : Mapping[str, object]
        Description of the run in JSON values.

    Raises
    ------
    LogError
        The file cannot be written.

    Examples
    --------
    >>> import tempfile
    >>> folder = Path(tempfile.mkdtemp())
    >>> path = write_feedback(folder, Feedback("mug", {"heavy": 1}), header={})
    >>> read_feedback(path)[0].text
    'heavy'
    """
    name = feedback.object_name if isinstance(feedback, Feedback) else _CHANGE
    path = feedback_name(folder, name)
    with TrialWriter(path, header, FEEDBACK_FORM) as log:
        log.write_feedback(feedback)
    return path


def read_feedback(path: str | Path) -> list[Feedback | Change]:
    """Read a log of feedback, or all such logs of a folder, and return the entries in order.

    Entries are labels that people gave, and changes of a learner (such as a refit or another
    agent). Errors are those of `read_trials`. For a folder, the list may be empty.
    """
    log = checked_path("The log", path)
    files = feedback_files(log) if log.is_dir() else [log]
    entries = list[Feedback | Change]()
    for file in files:
        scan = Scan(file)
        deque(scan.entries(), maxlen=0)
        entries += scan.builder.feedback
    return entries


def readable_feedback(
    files: Iterable[Path], on_fault: Callable[[str], object]
) -> Iterator[Feedback | Change]:
    """Yield what people told, in the order of the files; call `on_fault` for a torn file."""
    for file in files:
        try:
            yield from read_feedback(file)
        except LogError as fault:
            on_fault(str(fault))


def read_trials(path: str | Path) -> Iterator[Trial]:
    """Read the trials of a log, or of all logs in a folder, in the order of the files' names.

    The trials that are read are equal to those that were written. Each trial is checked before it
    is yielded, and each file is checked as a whole after its last trial. If several files of a
    folder contain the same trial, it is yielded once, and a warning names the copies. Use `Logs` to
    read as much as possible of damaged logs.

    Raises
    ------
    LogError
        The file or the folder does not exist.
    LogCorruptError
        The file is unfinished, damaged, or was changed.
    LogVersionError
        The file has another format version.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> import meal_bayes
    >>> with TemporaryDirectory() as folder:
    ...     log = Path(folder, "trial.mcap")
    ...     trial = meal_bayes.ask(
    ...         "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", log=log
    ...     )
    ...     (again,) = meal_bayes.read_trials(log)
    >>> again.success
    True
    """
    log = checked_path("The log", path)
    if not log.is_dir():
        return _trials(Scan(log))
    return _trials_once([Scan(file) for file in log_files(log)])


def _trials(scan: "Scan") -> Iterator[Trial]:
    for entry in scan.entries():
        if isinstance(entry, TrialOutcomes):
            raise LogError(
                f"{scan.path} is a compact log: outcomes without steps; see them with: "
                + command_line("meal-bayes report", scan.path)
            )
        yield entry


def _trials_once(scans: Sequence["Scan"]) -> Iterator[Trial]:
    copies = Copies([(scan.path, read_header(scan.path)) for scan in scans])
    for scan in scans:
        for trial in _trials(scan):
            if not copies.are_files or copies.new_rows(scan.path, TrialOutcomes.of([trial])).all():
                yield trial
    if copies.of:
        warnings.warn(copies.text, stacklevel=2)


def _run_text(header: Mapping[str, object]) -> str:
    """Return by what a run is told from others: all settings that change its trials."""
    settings = {name: value for name, value in header.items() if name not in _LATER}
    config = header.get("config")
    if isinstance(config, dict):
        settings["config"] = {name: value for name, value in config.items() if name not in _APART}
    return json.dumps(settings, sort_keys=True)


def _is_live(header: Mapping[str, object]) -> bool:
    """Return whether a log holds a trial with a robot, whose key no other trial has."""
    streams = header.get("streams")
    return of_learner(header) and isinstance(streams, list) and streams[1:2] == [LIVE]


def _identities(run: str, outcomes: TrialOutcomes) -> Iterator[int]:
    """Yield what tells trials of a run from others: agent, key, and all that came out."""
    reals = (outcomes.cost, outcomes.reward, outcomes.certainty)
    columns = [column.tolist() for column in (outcomes.agent, outcomes.key, outcomes.steps)]
    # By their bits, as NaN is the same here.
    columns += [np.ascontiguousarray(real).view(np.int64).tolist() for real in reals]
    for values in zip(*columns, strict=True):
        yield hash((run, *values))


class Copies:
    """Tells trials that several files hold from trials that are alike, so that each counts once.

    A trial with a robot has a key that no other trial has; of its files the one that goes furthest
    counts. Any other trial is that of another file where the settings of the run, the agent, the
    key of the task and all that came out of it are equal: what is drawn follows from these.

    Parameters
    ----------
    files : Sequence[tuple[Path, Mapping[str, object]]]
        Logs with their headers, in the order in which they are read.

    Attributes
    ----------
    of : dict[Path, Path]
        By file that holds trials of another one: that other file. It grows while rows are asked.
    shorter : set[Path]
        Files of a trial with a robot that another file holds, as far as it went or further.
    are_files : bool
        Whether any of the files may hold trials of another one.
    """

    def __init__(self, files: Sequence[tuple[Path, Mapping[str, object]]]) -> None:
        self.of = dict[Path, Path]()
        self._run = {file: _run_text(header) for file, header in files}
        self._files_of_run = Counter(self._run.values())
        self.are_files = len(self._files_of_run) < len(files)
        self._seen = dict[int, Path]()  # by the hash of what identifies a trial
        self.shorter = set[Path]()
        best = dict[Key, tuple[tuple[bool, int, bool], Path]]()
        for file, header in files:
            if self._files_of_run[self._run[file]] > 1 and _is_live(header):
                self._keep_furthest(file, best)

    def _keep_furthest(
        self, file: Path, best: dict[Key, tuple[tuple[bool, int, bool], Path]]
    ) -> None:
        trial: Trial | TrialOutcomes | None = None
        with contextlib.suppress(LogError):  # told where it is read
            trial = next(iter(Scan(file, tolerant=True).entries(unfinished=True)), None)
        if not isinstance(trial, Trial):
            return
        merit = (trial.ended == "", len(trial.steps), not file.name.endswith(ACTIVE))
        key = trial.task.key
        if key not in best:
            best[key] = merit, file
            return
        before, other = best[key]
        kept, copy = (file, other) if merit > before else (other, file)
        best[key] = max(merit, before), kept
        self.shorter.add(copy)
        self.of = {name: kept if name_of == copy else name_of for name, name_of in self.of.items()}
        self.of[copy] = kept

    def new_rows(self, file: Path, outcomes: TrialOutcomes) -> Bools:
        """Return which trials of a file no file before it holds, (n,)."""
        new = np.ones(len(outcomes), bool)
        run = self._run[file]
        if file in self.shorter:
            return ~new
        if self._files_of_run[run] < 2:
            return new
        for row, identity in enumerate(_identities(run, outcomes)):
            first = self._seen.setdefault(identity, file)
            if first != file:
                new[row] = False
                self.of.setdefault(file, first)
        return new

    @property
    def text(self) -> str:
        """Name the copies; "" where there are none."""
        pairs = [f"{copy} (of {first})" for copy, first in self.of.items()]
        if not pairs:
            return ""
        more = f", and {len(pairs) - _NAMED} more" if len(pairs) > _NAMED else ""
        return (
            f"Files hold trials of other files, and each trial counts once: "
            f"{', '.join(pairs[:_NAMED])}{more}"
        )


class Group(NamedTuple):
    """Consecutive trials of a file."""

    header: dict[str, object]
    file: Path
    numbers: Sequence[int]  # of each trial in the file
    outcomes: TrialOutcomes
    trials: tuple[Trial, ...]  # none of a compact log


def _content(data_set: str) -> str:
    """Return by what a data set is told from others: a table's file by what it holds."""
    path = Path(data_set)
    is_table = path.suffix == ".npz" and path.is_file()
    return checksum_of(path) if is_table else data_set


def of_learner(header: Mapping[str, object]) -> bool:
    """Return whether a log holds a trial that a learner has begun."""
    return isinstance(header.get("begun"), dict)


def going_on_text(log: Path) -> str:
    """Return a message that says how to continue a learner's unfinished trial."""
    return (
        f"{log}: the trial is not over; if its process has died, Learner.resume({str(log)!r}) "
        "continues it"
    )


def _rows(group: Group, chosen: Bools) -> Group:
    """Return some trials of a group, by a mask."""
    return group._replace(
        numbers=list(itertools.compress(group.numbers, chosen)),
        outcomes=group.outcomes.rows(chosen),
        trials=tuple(itertools.compress(group.trials, chosen)),
    )


class Logs:
    """Reader of one or more logs, also damaged ones: it notes faults and reads complete trials.

    If several files contain the same unit, such as a draft and a later run, the unit is read once.
    If files with other names contain copies of a trial, the trial is read once, and `copies` names
    these files. The truth of a trial includes labels that people gave after the trial. These labels
    are in logs of feedback in the folder of the trial and in the folder above it.

    Parameters
    ----------
    paths : str | Path
        Log files, or folders of log files.

    Raises
    ------
    LogError
        A path does not exist, a folder contains no log, or no path is given.
    """

    def __init__(self, *paths: str | Path) -> None:
        if not paths:
            raise LogError("No log was named; give files, or folders of them.")
        files = {file.resolve(): file for path in paths for file in log_files(path)}
        self.files: Sequence[Path] = list(files.values())
        self.problems: list[str] = []  # grows while trials are read
        self.unfinished: list[str] = []  # those of drafts, which another process may be writing
        self.copies = ""  # names the files whose trials others hold; whole once trials are read
        self._feedback: dict[Path, FeedbackIndex] = {}  # by folder

    @property
    def header(self) -> dict[str, object]:
        """Description of the run from the first file that has a header; empty if none has one."""
        return next((header for header in self._headers if header), {})

    @cached_property
    def _headers(self) -> list[dict[str, object]]:
        headers = list[dict[str, object]]()
        for file in self.files:
            headers.append({})
            with contextlib.suppress(LogCorruptError):
                headers[-1] = read_header(file)
        return headers

    def groups(self) -> Iterator[Group]:
        """Yield the trials of all files in groups, each trial once.

        Raises
        ------
        LogCorruptError
            Files are damaged, and not one trial can be read.
        LogError
            The files are not damaged, but contain no trial; or they belong to several data sets, or
            to different runs with equal settings.
        LogVersionError
            A file has another format version.
        """
        return self._groups(begun=False)

    def begun(self) -> Iterator[Group]:
        """Yield the groups, including trials that a learner began and that have not ended.

        The process of such a trial has died or is still running. Errors are those of `groups`.
        """
        return self._groups(begun=True)

    def _groups(self, *, begun: bool) -> Iterator[Group]:
        """Yield the trials in groups; with those without an outcome that a learner has begun."""
        empty = True
        copies = Copies(list(zip(self.files, self._headers, strict=True)))
        for file, header in self._distinct(copies):
            if file in copies.shorter:
                continue
            scan = Scan(file, tolerant=True)
            next_number = 0
            for outcomes, trials in grouped(scan, unfinished=begun and of_learner(header)):
                empty = False
                first_number = next_number
                next_number = next_number + len(outcomes)
                group = Group(header, scan.path, range(first_number, next_number), outcomes, trials)
                new = copies.new_rows(file, outcomes)
                if not new.all():
                    group = _rows(group, new)
                if new.any():
                    yield self._judged(group)
            if scan.path.name.endswith(ACTIVE):
                self._note_draft(scan.path, header, scan.problems)
            elif scan.foreign is not None:
                self.problems.append(scan.foreign.of(file))
            else:
                self.problems += [f"{file}: {problem}" for problem in scan.problems]
        self.copies = copies.text
        if empty and self.problems:
            raise LogCorruptError(f"Not one trial can be read: {self.problems[0]}.")
        if empty and named_form(self.files[0]) == FEEDBACK_FORM:
            raise LogError(
                f"{self.files[0]} contains labels of trials; name one of the trials' logs."
            )
        if empty:
            raise LogError(f"{self.files[0]} contains no trial yet.")

    def trials(self) -> Iterator[Trial]:
        """Yield all trials whose steps are in the files; errors are those of `groups`."""
        for group in self.groups():
            yield from group.trials

    def _note_draft(self, draft: Path, header: Mapping[str, object], faults: list[str]) -> None:
        """Note what another process may be writing, and what is damaged in it."""
        fault = next(iter(faults), "")
        damaged = fault not in ("", CUT_SHORT)
        problem = f"{draft} was not finished by its writer{f' ({fault})' if fault else ''}"
        if of_learner(header):
            problem = going_on_text(draft)
        if damaged:
            self.problems.append(f"{draft}: {fault}")
        self.unfinished.append(problem)
        self.problems.append(problem)

    def _judged(self, group: Group) -> Group:
        """Return a group with the truth that was told of its trials when they were over."""
        feedback = self.feedback_in(group.file.parent)
        trials = list[Trial]()
        for number, trial in zip(group.numbers, group.trials, strict=False):
            try:
                trials.append(feedback.judged(trial))
            except QueryError as fault:
                trials.append(trial)
                self.problems.append(f"{group.file}: what was told of trial {number}: {fault}")
        if all(new is old for new, old in zip(trials, group.trials, strict=False)):
            return group
        return group._replace(outcomes=TrialOutcomes.of(trials), trials=tuple(trials))

    def feedback_in(self, folder: Path) -> FeedbackIndex:
        """Return the feedback on the trials of a folder, as far as it can be read."""
        if folder not in self._feedback:
            files = feedback_of(folder)
            self._feedback[folder] = FeedbackIndex(readable_feedback(files, self.problems.append))
        return self._feedback[folder]

    def told(self) -> list[tuple[str, Feedback | Change]]:
        """Return labels and changes from all folders, in order, each with the name of its log."""
        folders = {file.parent for file in self.files}
        feedback_logs = (file for folder in folders for file in feedback_of(folder))
        files = {file.resolve(): file for file in feedback_logs}.values()
        entries = list[tuple[str, Feedback | Change]]()
        for file in sorted(files, key=lambda file: file.name):  # which begins with the time
            feedback_of_file = readable_feedback([file], self.problems.append)
            entries += [(file.name, feedback) for feedback in feedback_of_file]
        return entries

    def _distinct(self, copies: Copies) -> list[tuple[Path, dict[str, object]]]:
        """Return the files but for copies; check that they are of one data set, and of one run."""
        data_files = dict[str, Path]()
        units = dict[tuple[str, str, str], Path]()
        files = []
        for file, header in zip(self.files, self._headers, strict=True):
            config = header.get("config")
            config = config if isinstance(config, dict) else {}
            if config and not _is_live(header):
                name = (_run_text(header), file.parent.name, stem_of(file))
                other = units.setdefault(name, file)
                if other is not file:
                    if filecmp.cmp(file, other, shallow=False):
                        copies.of[file] = other
                        continue
                    raise LogError(
                        f"{other} and {file} contain different trials with equal settings, made "
                        f"by other code or from other recordings; name the logs of one run."
                    )
            files.append((file, header))
            # Objects are known by their numbers in a data set, so trials of two do not mix.
            data = config.get("dataset") or header.get("data")
            if isinstance(data, str):
                data_files.setdefault(data, file)
        if len(data_files) > 1 and len(set(map(_content, data_files))) > 1:
            listing = ", ".join(f"{name} (such as {file})" for name, file in data_files.items())
            raise LogError(
                f"These logs belong to {len(data_files)} data sets: {listing}; name the logs of "
                "one data set."
            )
        return files


class Follower:
    """Reader that follows a growing file, or every file of a folder, from the beginning.

    `poll` yields the trials that were written since the last call. A file that gets its final name
    while it is read stays open, so no trial is missed or read twice. A trial that was read from an
    earlier draft or from a copy is not yielded again. A damaged file is noted in `problems` and no
    longer followed. A compact log, which contains no steps, is skipped.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = checked_path("The log", path)
        self.problems: list[str] = []
        self._tails: dict[tuple[int, int], _Tail] = {}  # by device and inode, whatever its name
        self._yielded = Counter[Path]()  # trials of each log
        self._log_of = dict[int | Key, Path]()  # by what tells a trial from others

    @property
    def header(self) -> dict[str, object] | None:
        """The header of the first file, once it is there."""
        headers = (tail.builder.header for tail in self._tails.values())
        return next((header for header in headers if header is not None), None)

    @property
    def finished(self) -> bool:
        """Whether every file that was found has ended."""
        return bool(self._tails) and all(tail.file.closed for tail in self._tails.values())

    def poll(self) -> Iterator[Trial]:
        """Yield the complete trials that were written since the last call."""
        with contextlib.suppress(LogError, FileNotFoundError):  # to come, gone, or renamed since
            for path in log_files(self.path):
                state = path.stat()
                if (state.st_dev, state.st_ino) not in self._tails:
                    self._tails[state.st_dev, state.st_ino] = _Tail(path)
        for tail in self._tails.values():
            try:
                for trial in tail.poll():
                    if tail.builder.read.trials > self._yielded[tail.name]:
                        self._yielded[tail.name] += 1
                        if self._is_new(trial, tail):
                            yield trial
            except LogVersionError as fault:
                tail.file.close()
                raise LogVersionError(f"{tail.name} was {fault}.") from fault
            except ForeignFileError as fault:
                tail.file.close()
                self.problems.append(fault.of(tail.name))
            except FAULTS as fault:
                tail.file.close()
                self.problems.append(f"{tail.name}: {fault_text(fault)}")

    def _is_new(self, trial: Trial, tail: "_Tail") -> bool:
        """Return whether no other log held a trial; see `Copies`."""
        header = tail.builder.header or {}
        identity: int | Key = trial.task.key
        if not _is_live(header):
            (identity,) = _identities(_run_text(header), TrialOutcomes.of([trial]))
        return self._log_of.setdefault(identity, tail.name) == tail.name

    def close(self) -> None:
        """Close all files."""
        for tail in self._tails.values():
            tail.file.close()


class _Tail:
    """One file that grows; it is closed when it has ended."""

    def __init__(self, path: Path) -> None:
        self.name = path.with_name(f"{stem_of(path)}{SUFFIX}")  # the one that is meant
        self.builder = TrialBuilder()
        self.file = open_regular(path)
        self._offset = 0  # behind the last whole record

    def poll(self) -> Iterator[Trial]:
        """Yield the trials of the records that are whole by now."""
        if self.file.closed:
            return
        self.file.seek(self._offset)
        try:
            for record in read_records(self.file, begin=self._offset):
                self._offset = self.file.tell()
                for entry in self.builder.records(record):
                    if isinstance(entry, Trial):
                        yield entry
                if isinstance(record, DataEnd) or self.builder.form != FULL:
                    return self.file.close()  # without steps there is nothing to follow
        except TORN:
            if not os.fstat(self.file.fileno()).st_nlink:  # a draft that was given up
                self.file.close()

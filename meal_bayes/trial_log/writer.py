"""Trials -> one MCAP file, flushed after every trial (or every few).

It is a draft of a unique name, which gets its own when it is whole.
"""

import contextlib
import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from mcap.writer import Writer

from meal_bayes.errors import LogError, OutputError, SettingsError
from meal_bayes.files import checked_path, hold, make_folder, replace_whole, write_whole
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.encode import End, Packed, TrialEncoder, encode_outcomes
from meal_bayes.trial_log.feedback import Feedback
from meal_bayes.trial_log.names import FORM_ENDINGS, feedback_name, named_form, new_draft, timing_of
from meal_bayes.trial_log.schema import FORMAT_VERSION, SUFFIX
from meal_bayes.trials import Step, Trial, TrialOutcomes
from meal_bayes.trials.outcomes import check_trials
from meal_bayes.untrusted import read_json
from meal_bayes.version import package_version

ROWS = 250  # trials in a message of the compact form


class TrialWriter:
    """Writes trials into one log, `path`, which exists only once the file is whole.

    Until then the file is a draft, `active_path`, of a name that no other writer has. Seconds of
    wall-clock time go into `<stem>.timing.csv` beside the whole file, so that two equal runs write
    equal logs. Where the `with` block ends by an exception, the draft stays.

    When `write` returns, the trial has left the process, and `salvage` reads it whatever happens
    next. It is a `Recorder` as well: a trial that comes step by step is on disk step by step.

    Parameters
    ----------
    path : str | Path
        Ends in .mcap; missing folders are made, a file of that name is replaced.
    header : Mapping[str, object]
        What the run was, in JSON values: config, seed, git. `versions` is filled in.
    form : str
        "full", "compact" or "feedback".
    """

    def __init__(
        self, path: str | Path, header: Mapping[str, object], form: str = schema.FULL
    ) -> None:
        self.path = checked_path("The log", path)
        self._form = form
        if self.path.suffix != SUFFIX:
            raise SettingsError(f"A log's name ends in {SUFFIX}; found {self.path.name!r}.")
        if named_form(self.path) != (form if form in FORM_ENDINGS.values() else ""):
            reserved = " and ".join(f"{ending}{SUFFIX}" for ending in FORM_ENDINGS)
            raise SettingsError(
                f"Names that end in {reserved} are of feedback alone; found "
                f"{self.path.name!r}. Choose another."
            )
        self.active_path = new_draft(self.path)  # its name while it is being written
        versions = {"meal_bayes": package_version(), "numpy": np.__version__}
        versions["python"] = platform.python_version()
        self.header = {"versions": versions, **header}
        self._text = _json(self.header)
        self._seconds: dict[int, float] = {}  # by trial
        self._open = False  # also where a write was broken off: what follows could not be read
        self._begun = False  # a trial was begun and has no end yet
        self._momdps = schema.Momdps()  # numbers in the file, by digest
        self.written = End()

    def __reduce__(self) -> str | tuple[Any, ...]:
        raise LogError(
            f"{self.path} is being written, and a copy would write it too; copy between trials, or "
            "without logs (logs=None)."
        )

    def __enter__(self) -> Self:
        with self._faults_named():
            make_folder(self.path.parent)
            if self.path.exists() and not self.path.is_file():
                raise OSError(f"{self.path} is no file")
            self._file: BinaryIO = self.active_path.open("xb")
            hold(self._file)  # nobody else resumes or removes it while this process lives
            self._mcap: Any = Writer(self._file, enable_data_crcs=True)
            self._mcap.start(profile=schema.PROFILES[self._form])
            self._channels = {
                topic: self._mcap.register_channel(
                    topic, "protobuf", self._mcap.register_schema(name, "protobuf", data)
                )
                for topic, name, data in schema.channels(self._form)
            }
            flat = {
                name: value if isinstance(value, str) else _json(value)
                for name, value in sorted(self.header.items())
            }
            # What the run was: metadata and an attachment for other tools, /run for ours.
            self._mcap.add_metadata("run", {"format_version": str(FORMAT_VERSION), **flat})
            config = _json(self.header.get("config", self.header))
            self._mcap.add_attachment(0, 0, "config.json", "application/json", config.encode())
        self._open = True
        run = schema.RunMessage(format_version=FORMAT_VERSION, header=self._text)
        self._put([Packed(schema.RUN, 0, run.SerializeToString())])
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        whole = kind is None and self._open and not self._begun
        self._open = False
        with self._faults_named():
            with self._file:
                if whole:
                    end = _json(self.written._asdict()).encode()
                    self._mcap.add_attachment(0, 0, schema.END, "application/json", end)
                    self._mcap.finish()
            if whole:
                rows = [f"{number},{seconds:.6f}\n" for number, seconds in self._seconds.items()]
                if rows:
                    table = "".join(["trial,seconds\n", *rows])
                    write_whole(timing_of(self.path), table, expected=True)
                else:
                    timing_of(self.path).unlink(missing_ok=True)
                replace_whole(self.active_path, self.path)  # last: with it the log is there

    def _put(self, messages: Iterable[Packed], *, sync: bool = False) -> None:
        """Write messages; when this returns they have left the process, or (sync) are on disk."""
        if not self._open:
            raise LogError(f"{self.path} is not open; write inside the `with` block of its writer.")
        with self._faults_named():
            packed = list(messages)  # nothing is written where one of them cannot be
            # Broken off in the middle, what follows could not be read: the writer stays closed.
            self._open = False
            for topic, time, data, momdp in packed:
                channel = self._channels[topic]
                self._mcap.add_message(channel, log_time=time, publish_time=time, data=data)
                if momdp is not None:
                    self._momdps.add(*momdp, len(data))
            self._mcap.flush()
            if sync:
                self._file.flush()
                os.fsync(self._file.fileno())
            self._open = True

    @contextlib.contextmanager
    def _faults_named(self) -> Iterator[None]:
        """Turn errors of system and trial into ours, which name the file or the trial."""
        trials = self.written.trials
        try:
            yield
        except OSError as fault:
            draft = f" ({trials} trials are kept in {self.active_path})" if trials else ""
            reason = fault.strerror or fault
            raise LogError(f"{self.path} cannot be written: {reason}{draft}.") from fault
        except OutputError as fault:  # of the folder
            raise LogError(str(fault)) from fault
        except (SettingsError, TypeError, ValueError, OverflowError) as fault:
            # the next one, which no message can hold
            raise LogError(f"Trial {trials} cannot be logged: {fault}.") from fault

    def write(self, trial: Trial, *, seconds: float | None = None) -> None:
        """Append one trial, and to the timing table the wall-clock seconds it took.

        Raises
        ------
        LogError
            The trial's arrays do not fit each other, and the file stays as it was; or the disk is
            full, and the trials before stay in the draft.
        """
        self._put(self._next_encoder().whole(trial))
        self._count(trial, seconds)

    def write_outcomes(self, outcomes: TrialOutcomes, seconds: Iterator[float]) -> None:
        """Append outcomes to a compact log, and the wall-clock seconds of each trial."""
        for begin in range(0, len(outcomes), ROWS):
            rows = outcomes.rows(slice(begin, begin + ROWS))
            number = self.written.trials
            data = encode_outcomes(rows, number)
            self._put([Packed(schema.OUTCOMES, schema.log_time(number, 0), data)])
            self._seconds.update(zip(range(number, number + len(rows)), seconds, strict=False))
            self.written = self.written.after(rows)

    def write_feedback(self, feedback: Feedback) -> None:
        """Write what a person told to disk, into a log of feedback."""
        self._put([Packed(schema.FEEDBACK, 0, feedback.packed())], sync=True)

    def begin(self, trial: Trial) -> None:
        """Write the start of a trial to disk; its steps follow one by one, then its end."""
        self._encoder = self._next_encoder()
        self._put(self._encoder.begin(trial), sync=True)
        self._begun = True

    def step(self, step: Step) -> None:
        """Write the next step of the trial that was begun to disk."""
        self._put(self._encoder.step(step), sync=True)

    def end(self, trial: Trial) -> None:
        """Write the outcome of the trial that was begun to disk."""
        self._put(self._encoder.end(trial), sync=True)
        self._begun = False
        self._count(trial)

    def _next_encoder(self) -> TrialEncoder:
        if self._begun:
            raise LogError(f"{self.path} is not open for another trial: one has no end yet.")
        return TrialEncoder(self.written.trials, self._momdps)

    def _count(self, trial: Trial, seconds: float | None = None) -> None:
        if seconds is not None:
            self._seconds[self.written.trials] = seconds
        self.written = self.written.after(trial)


def write_trials(
    path: str | Path,
    trials: Iterable[Trial | TrialOutcomes],
    *,
    header: Mapping[str, object],
    seconds: Sequence[float] = (),
) -> None:
    """Write trials into one log, with the seconds of the first of them.

    Parameters
    ----------
    trials : Iterable[Trial | TrialOutcomes]
        Whole ones make a full log, outcomes a compact one: columns, 250 trials in a message.

    Examples
    --------
    >>> import meal_bayes
    >>> trial = meal_bayes.ask(
    ... "heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", logs=None
    ... )
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     log = Path(folder, "trials.mcap")
    ...     meal_bayes.write_trials(log, [trial], header={})
    ...     (again,) = meal_bayes.read_trials(log)
    >>> again == trial
    True
    """
    check_trials(trials)
    entries = iter(trials)
    times = iter(seconds)
    first = next(entries, None)
    form = schema.COMPACT if isinstance(first, TrialOutcomes) else schema.FULL
    with TrialWriter(path, header, form) as log:
        for entry in chain([] if first is None else [first], entries):
            if isinstance(entry, TrialOutcomes):
                log.write_outcomes(entry, times)
            else:
                log.write(entry, seconds=next(times, None))


def write_feedback(folder: Path, feedback: Feedback, *, header: Mapping[str, object]) -> Path:
    """Write what a person told of a folder's trial into a log of its own; return its path.

    The log is whole on disk when this returns, or not there; no two processes write into one.
    """
    path = feedback_name(folder, feedback.object_name)
    with TrialWriter(path, header, schema.FEEDBACK_FORM) as log:
        log.write_feedback(feedback)
    return path


def read_seconds(path: str | Path) -> list[float]:
    """Read the wall-clock seconds of a log's trials; none where no whole table is beside it."""
    log = checked_path("The log", path)
    try:
        rows = timing_of(log).read_text(encoding="utf-8").splitlines()[1:]
        return [float(row.split(",")[1]) for row in rows]
    except (FileNotFoundError, IndexError, ValueError):
        return []


def _json(value: object) -> str:
    if isinstance(value, Mapping) and not all(isinstance(name, str) for name in value):
        raise SettingsError(f"Names in a log's header must be text; found {list(value)}.")
    try:
        text = json.dumps(value, sort_keys=True, allow_nan=False)
        read_json(text)  # a reader must take it
    except (TypeError, ValueError) as fault:
        raise SettingsError(
            f"A log's header holds JSON values (text, finite numbers, lists, tables); {fault}."
        ) from fault
    return text

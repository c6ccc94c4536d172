"""Trials -> one MCAP file, flushed after every trial (or every few).

It is a draft of a unique name, which gets its own when it is whole.
"""

import contextlib
import hashlib
import itertools
import json
import os
import platform
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Self

import numpy as np
from mcap.writer import Writer

from meal_bayes.errors import LogError, SettingsError
from meal_bayes.files import replace_whole, write_whole
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.encode import End, Packed, TrialEncoder, encode_momdp, encode_outcomes
from meal_bayes.trial_log.names import new_draft, timing_of
from meal_bayes.trial_log.schema import FORMAT_VERSION, SUFFIX
from meal_bayes.trials import Step, Trial, TrialOutcomes
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
        "full" or "compact".
    """

    def __init__(
        self, path: str | Path, header: Mapping[str, object], form: str = schema.FULL
    ) -> None:
        self.path, self._form = Path(path), form
        if self.path.suffix != SUFFIX:
            raise SettingsError(f"A log's name ends in {SUFFIX}; found {self.path.name!r}.")
        self.active_path = new_draft(self.path)  # its name while it is being written
        versions = {"meal_bayes": package_version(), "numpy": np.__version__}
        versions["python"] = platform.python_version()
        self.header = {"versions": versions, **header}
        self._text = _json(self.header)
        self._file: BinaryIO | None = None
        self._seconds: list[float | None] = []  # of each trial
        self.written = End()
        self.begun = False  # a trial was begun and has no end yet
        self._torn = False  # a write was broken off: what follows could not be read
        self._momdps = 0
        self._known: dict[bytes, schema.Known] = {}  # numbers in the file, by content
        self._last: Trial | None = None  # that was packed with a MOMDP of its own
        self._momdp = self._content = b""  # its MOMDP and counts, and a digest of them

    def __enter__(self) -> Self:
        with self._faults_named():
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if self.path.exists() and not self.path.is_file():
                raise OSError(f"{self.path} is no file")
            self._file = self.active_path.open("xb")
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
        run = schema.RunMessage(format_version=FORMAT_VERSION, header=self._text)
        self.put([Packed(schema.RUN, 0, run.SerializeToString())])
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._file is None:
            return
        whole = kind is None and not self._torn and not self.begun
        with self._faults_named(), contextlib.ExitStack() as stack:
            stack.callback(setattr, self, "_file", None)
            stack.enter_context(self._file)
            if whole:
                end = _json(self.written._asdict()).encode()
                self._mcap.add_attachment(0, 0, schema.END, "application/json", end)
                self._mcap.finish()
        if whole:
            timed = ((k, taken) for k, taken in enumerate(self._seconds) if taken is not None)
            rows = [f"{number},{taken:.6f}\n" for number, taken in timed]
            with self._faults_named():
                if rows:
                    write_whole(timing_of(self.path), "".join(["trial,seconds\n", *rows]))
                else:
                    timing_of(self.path).unlink(missing_ok=True)
                replace_whole(self.active_path, self.path)  # last: with it the log is there

    def put(self, packed: list[Packed], *, sync: bool = False) -> None:
        """Write messages; when this returns they have left the process, or (sync) are on disk."""
        self.check_open()
        self._torn = True
        with self._faults_named():
            for topic, time, data in packed:
                channel = self._channels[topic]
                self._mcap.add_message(channel, log_time=time, publish_time=time, data=data)
                if topic == schema.MOMDPS:  # the oldest are forgotten as the reader does
                    self._known[self._content] = schema.Known(self._momdps, len(data))
                    self._momdps += 1
                    schema.forget_oldest(self._known)
            self._mcap.flush()
            if sync and self._file is not None:
                self._file.flush()
                os.fsync(self._file.fileno())
        self._torn = False

    def check_open(self) -> None:
        """Raise where nothing can be written."""
        if self._file is None or self._torn:
            raise LogError(f"{self.path} is not open; write inside the `with` block of its writer.")

    @contextlib.contextmanager
    def _faults_named(self) -> Iterator[None]:
        """Turn errors of system and trial into ours, which name the file or the trial."""
        try:
            yield
        except OSError as fault:
            trials = self.written.trials
            draft = f" ({trials} trials are kept in {self.active_path})" * (trials > 0)
            why = fault.strerror or fault
            raise LogError(f"{self.path} cannot be written: {why}{draft}.") from fault
        except (SettingsError, TypeError, ValueError, OverflowError) as fault:
            trial = self.written.trials  # which no message can hold
            raise LogError(f"Trial {trial} cannot be logged: {fault}.") from fault

    def write(self, trial: Trial, *, seconds: float | None = None) -> None:
        """Append one trial, and to the timing table the wall-clock seconds it took.

        Raises
        ------
        LogError
            The trial's arrays do not fit each other, and the file stays as it was; or the disk is
            full, and the trials before stay in the draft.
        """
        with self._faults_named():
            packed = self._place(trial) + self._encoder.whole(trial)
        self.put(packed)
        self.written = self.written.after(trial)
        self._seconds.append(seconds)

    def write_outcomes(self, outcomes: TrialOutcomes, seconds: Iterator[float | None]) -> None:
        """Append outcomes to a compact log, and the wall-clock seconds of each trial."""
        for begin in range(0, len(outcomes), ROWS):
            rows, number = outcomes.rows(slice(begin, begin + ROWS)), self.written.trials
            packed = Packed(
                schema.OUTCOMES, schema.log_time(number, 0), encode_outcomes(rows, number)
            )
            self.put([packed])
            self._seconds += itertools.islice(seconds, len(rows))
            self.written = self.written.after(rows)

    def begin(self, trial: Trial) -> None:
        """Write the start of a trial to disk; its steps follow one by one, then its end."""
        with self._faults_named():
            packed = self._place(trial) + self._encoder.begin(trial)
        self.begun = True
        self.put(packed, sync=True)

    def step(self, step: Step) -> None:
        """Write the next step of the trial that was begun to disk."""
        with self._faults_named():
            packed = self._encoder.step(step)
        self.put(packed, sync=True)

    def end(self, trial: Trial) -> None:
        """Write the outcome of the trial that was begun to disk."""
        with self._faults_named():
            packed = self._encoder.end(trial)
        self.put(packed, sync=True)
        self.begun = False
        self.written = self.written.after(trial)
        self._seconds.append(None)

    def _place(self, trial: Trial) -> list[Packed]:
        """Create the encoder of the next trial, and pack its MOMDP where that is new."""
        self.check_open()
        if self.begun:
            raise LogError(f"{self.path} is not open for another trial: one has no end yet.")
        last = self._last
        if (
            last is None
            or last.momdp is not trial.momdp
            or not np.array_equal(last.counts, trial.counts)  # type: ignore[arg-type]  # or None
        ):
            self._last, self._momdp = trial, encode_momdp(trial)
            self._content = hashlib.blake2b(self._momdp, digest_size=16).digest()
        number, known = self.written.trials, self._known.get(self._content)
        self._encoder = TrialEncoder(number, known.value if known else self._momdps)
        if known is not None:
            return []
        momdp = schema.MomdpMessage(id=self._momdps).SerializeToString() + self._momdp
        return [Packed(schema.MOMDPS, schema.log_time(number, 0), momdp)]


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
    """
    entries, times = iter(trials), itertools.chain(seconds, itertools.repeat(None))
    first = next(entries, None)
    entries = itertools.chain([] if first is None else [first], entries)
    form = schema.COMPACT if isinstance(first, TrialOutcomes) else schema.FULL
    with TrialWriter(path, header, form) as log:
        for entry in entries:
            if isinstance(entry, TrialOutcomes):
                log.write_outcomes(entry, times)
            else:
                log.write(entry, seconds=next(times))


def read_seconds(path: str | Path) -> list[float]:
    """Read the wall-clock seconds of a log's trials; none where no whole table is beside it."""
    try:
        rows = timing_of(Path(path)).read_text(encoding="utf-8").splitlines()[1:]
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

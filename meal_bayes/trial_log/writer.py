"""Trials -> one MCAP file, flushed after every trial and named when whole."""

import json
import os
import platform
from collections.abc import Callable, Iterable, Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO, NamedTuple, Self, TextIO, TypeVar

import numpy as np
from mcap.writer import Writer

from meal_bayes.agents.trial import Step, Trial
from meal_bayes.errors import LogError, SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.trial_log.encode import Packed, TrialEncoder, digest, encode_momdp, numbered
from meal_bayes.trial_log.picture import ConfusionPictures
from meal_bayes.trial_log.schema import (
    ACTIVE,
    END,
    FORMAT_VERSION,
    MESSAGE_LIMIT,
    MOMDP_MEMORY,
    MOMDPS,
    PROFILE,
    RUN,
    SUFFIX,
    RunMessage,
    channels,
    log_time,
)

Value = TypeVar("Value")
Result = TypeVar("Result")


class _Placed(NamedTuple):
    """A MOMDP of the file."""

    number: int
    digest: bytes
    content: bytes  # digest of what it says, whatever its number


class TrialWriter:
    """Writes trials into `path`, which exists only once the file is whole.

    Until then the file is called `<path>.active`; when `write` returns, the trial has left the
    process, and `salvage` reads it whatever happens next. It is a `Recorder` as well: a trial
    that is told step by step is on disk step by step. Seconds of wall-clock time go into
    `<stem>.timing.csv` beside the file, so that two equal runs write equal logs. Where the `with`
    block ends by an exception, the file keeps the name that says it is unfinished.

    Parameters
    ----------
    path : ends in .mcap; missing folders are made, a file of that name is replaced.
    header : what the run was, in JSON values: config, seed, git. `versions` is filled in.
    """

    def __init__(self, path: str | Path, header: Mapping[str, object]) -> None:
        self.path = Path(path)
        if self.path.suffix != SUFFIX:
            raise SettingsError(f"A log's name ends in {SUFFIX}; found {self.path.name!r}.")
        self.header = {"versions": _versions(), **header}
        self._text = _json(self.header)
        self._file: BinaryIO | None = None
        self._timing: TextIO | None = None
        self._trials = self._steps = self._momdps = 0
        self._chain = b""
        self._pictures = ConfusionPictures()
        self._known: dict[bytes, _Placed] = {}  # by content, the newest MOMDP_MEMORY
        self._last: tuple[MOMDP, _Placed] | None = None
        self._open = False  # a trial was begun and has no end yet
        self._torn = False  # a write was broken off: what follows could not be read

    @property
    def active_path(self) -> Path:
        """The file's name while it is being written."""
        return self.path.with_name(self.path.name + ACTIVE)

    @property
    def timing_path(self) -> Path:
        """The table of seconds."""
        return self.path.with_name(self.path.stem + ".timing.csv")

    def __enter__(self) -> Self:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self.timing_path.unlink(missing_ok=True)
            self._file = self.active_path.open("wb")
        except OSError as fault:
            raise LogError(f"{self.path} cannot be written: {fault}.") from fault
        self._mcap: Any = Writer(self._file, enable_data_crcs=True)
        self._mcap.start(profile=PROFILE)
        self._channels = {
            topic: self._mcap.register_channel(
                topic, "protobuf", self._mcap.register_schema(name, "protobuf", data)
            )
            for topic, name, data in channels()
        }
        self._describe()
        return self

    def write(self, trial: Trial, *, seconds: float | None = None) -> None:
        """Append one trial, and to the timing table the wall-clock seconds it took.

        Raises
        ------
        LogError : the trial's arrays do not fit each other; the file stays as it was.
        """
        packed = self._place_trial(trial)
        packed += self._packed(self._encoder.whole, trial)
        self._put(packed)
        self._close(trial, packed[-1], seconds)

    def begin(self, trial: Trial) -> None:
        """Put the start of a trial on disk; its steps follow one by one, then its end."""
        packed = self._place_trial(trial)
        packed += self._packed(self._encoder.begin, trial)
        self._open = True
        self._put(packed, sync=True)

    def step(self, step: Step) -> None:
        """Put the next step of the trial that was begun on disk."""
        self._put(self._packed(self._encoder.step, step), sync=True)

    def end(self, trial: Trial) -> None:
        """Put the outcome of the trial that was begun on disk."""
        packed = self._packed(self._encoder.end, trial)
        self._put(packed, sync=True)
        self._open = False
        self._close(trial, packed[-1], None)

    def _place_trial(self, trial: Trial) -> list[Packed]:
        """Make the encoder of the next trial, and pack its MOMDP where that is new."""
        if self._file is None or self._torn or self._open:
            raise LogError(f"{self.path} is not open; write inside `with TrialWriter(...) as log`.")
        number = self._trials
        placed, momdp = self._packed(self._place, trial.momdp)
        self._placed = placed
        self._encoder = TrialEncoder(number, placed.number, placed.digest, self._pictures)
        return [Packed(MOMDPS, log_time(number, 0), momdp)] if momdp else []

    def _packed(self, pack: Callable[[Value], Result], value: Value) -> Result:
        try:
            return pack(value)
        except (TypeError, ValueError, OverflowError) as fault:
            raise LogError(f"Trial {self._trials} cannot be logged: {fault}.") from fault

    def _put(self, packed: list[Packed], *, sync: bool = False) -> None:
        """Write messages; when this returns they have left the process, or (sync) are on disk."""
        if self._file is None or self._torn:
            raise LogError(f"{self.path} is not open; write inside `with TrialWriter(...) as log`.")
        self._torn = True
        for message in packed:
            self._add(message.topic, message.time, message.data)
        self._mcap.flush()
        if sync:
            self._file.flush()
            os.fsync(self._file.fileno())
        self._torn = False

    def _close(self, trial: Trial, outcome: Packed, seconds: float | None) -> None:
        number = self._trials
        self._remember(trial.momdp, self._placed)
        self._trials, self._steps = number + 1, self._steps + len(trial.steps)
        self._chain = digest((self._chain, outcome.data))
        if seconds is not None:
            self._note_seconds(number, seconds)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        fault: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._file is None:
            return
        whole = kind is None and not self._torn and not self._open
        try:
            if whole:
                self._finish(self._file)
        finally:
            self._file.close()
            self._file = None
            if self._timing is not None:
                self._timing.close()
                self._timing = None
        if whole:
            self.active_path.replace(self.path)

    def _describe(self) -> None:
        """Write what the run was: metadata and an attachment for other tools, /run for ours."""
        flat = {
            name: value if isinstance(value, str) else _json(value)
            for name, value in sorted(self.header.items())
        }
        self._mcap.add_metadata("run", {"format_version": str(FORMAT_VERSION), **flat})
        config = _json(self.header.get("config", self.header))
        self._mcap.add_attachment(0, 0, "config.json", "application/json", config.encode())
        run = RunMessage(format_version=FORMAT_VERSION, header=self._text)
        self._add(RUN, 0, run.SerializeToString())
        self._mcap.flush()

    def _finish(self, file: BinaryIO) -> None:
        end = {"trials": self._trials, "steps": self._steps, "digest": self._chain.hex()}
        self._mcap.add_metadata(END, {name: str(value) for name, value in end.items()})
        self._mcap.finish()
        file.flush()
        os.fsync(file.fileno())  # the whole name must not stand on half a file

    def _add(self, topic: str, time: int, data: bytes) -> None:
        self._mcap.add_message(self._channels[topic], log_time=time, publish_time=time, data=data)

    def _place(self, momdp: MOMDP) -> tuple[_Placed, bytes]:
        """Find a MOMDP in the file, or number and pack it as the next."""
        if self._last is not None and self._last[0] is momdp:
            return self._last[1], b""
        packed = encode_momdp(momdp)
        content = digest((packed,))
        if content in self._known:
            return self._known[content], b""
        data = numbered(self._momdps, packed)
        return _Placed(self._momdps, digest((data,)), content), data

    def _remember(self, momdp: MOMDP, placed: _Placed) -> None:
        self._last = momdp, placed
        if placed.content not in self._known:
            self._known[placed.content] = placed
            self._momdps += 1
            if len(self._known) > MOMDP_MEMORY:
                del self._known[next(iter(self._known))]

    def _note_seconds(self, number: int, seconds: float) -> None:
        if self._timing is None:
            self._timing = self.timing_path.open("w", encoding="utf-8")
            self._timing.write("trial,seconds\n")
        self._timing.write(f"{number},{seconds:.6f}\n")
        self._timing.flush()


def write_trials(
    path: str | Path, trials: Iterable[Trial], *, header: Mapping[str, object]
) -> None:
    """Write trials into one log (see `TrialWriter`)."""
    with TrialWriter(path, header) as log:
        for trial in trials:
            log.write(trial)


def _versions() -> dict[str, str]:
    try:
        own = version("meal-bayes")
    except PackageNotFoundError:  # run from a folder, not installed
        own = "unknown"
    return {"meal_bayes": own, "numpy": np.__version__, "python": platform.python_version()}


def _json(value: object) -> str:
    if isinstance(value, Mapping) and not all(isinstance(name, str) for name in value):
        raise SettingsError(f"Names in a log's header must be text; found {list(value)}.")
    try:
        text = json.dumps(value, sort_keys=True, allow_nan=False)
    except (TypeError, ValueError) as fault:
        raise SettingsError(
            f"A log's header holds JSON values (text, finite numbers, lists, tables); {fault}."
        ) from fault
    if len(text) > MESSAGE_LIMIT // 2:
        raise SettingsError(f"A log's header of {len(text)} bytes; at most {MESSAGE_LIMIT // 2}.")
    return text

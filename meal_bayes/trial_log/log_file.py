"""A log under way: a draft of a unique name, which gets its own when it is whole."""

import contextlib
import json
import os
import platform
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO, Self, TextIO

import numpy as np
from mcap.writer import Writer

from meal_bayes.errors import LogError, SettingsError
from meal_bayes.files import replace_whole
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.encode import End, Packed
from meal_bayes.trial_log.names import new_draft, timing_of
from meal_bayes.trial_log.schema import FORMAT_VERSION, SUFFIX
from meal_bayes.untrusted import read_json
from meal_bayes.version import package_version


class LogFile:
    """Writes a log into `path`, which exists only once the file is whole.

    Until then the file is a draft, `active_path`, of a name that no other writer has. Seconds of
    wall-clock time go into `<stem>.timing.csv` beside the file, so that two equal runs write equal
    logs. Where the `with` block ends by an exception, the draft stays.

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
        self._timing: TextIO | None = None
        self.written = End()
        self.begun = False  # a trial was begun and has no end yet
        self._torn = False  # a write was broken off: what follows could not be read

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
            self._describe()
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if self._file is None:
            return
        whole = kind is None and not self._torn and not self.begun
        with self._faults_named(), contextlib.ExitStack() as stack:
            stack.callback(setattr, self, "_file", None)
            stack.enter_context(self._file)
            stack.callback(lambda: self._timing is None or self._timing.close())
            if whole:
                end = _json(self.written._asdict()).encode()
                self._mcap.add_attachment(0, 0, schema.END, "application/json", end)
                self._mcap.finish()
        if whole:
            with self._faults_named():
                if self._timing is None:
                    timing_of(self.path).unlink(missing_ok=True)
                else:
                    replace_whole(timing_of(self.active_path), timing_of(self.path))
                replace_whole(self.active_path, self.path)  # last: with it the log is there

    def put(
        self, packed: list[Packed], *, seconds: Sequence[float | None] = (), sync: bool = False
    ) -> None:
        """Write messages; when this returns they have left the process, or (sync) are on disk."""
        self.check_open()
        self._torn = True
        with self._faults_named():
            for message in packed:
                self._add(message)
            self._mcap.flush()
            for number, taken in enumerate(seconds, start=self.written.trials):
                if taken is not None:
                    if self._timing is None:
                        self._timing = timing_of(self.active_path).open("x", encoding="utf-8")
                        self._timing.write("trial,seconds\n")
                    self._timing.write(f"{number},{taken:.6f}\n")
                    self._timing.flush()
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
        """Turn the system's errors into ours, which name the file."""
        try:
            yield
        except OSError as fault:
            trials = self.written.trials
            kept = f" ({trials} trials are kept in {self.active_path})" * (trials > 0)
            why = fault.strerror or fault
            raise LogError(f"{self.path} cannot be written: {why}{kept}.") from fault

    def _describe(self) -> None:
        """Write what the run was: metadata and an attachment for other tools, /run for ours."""
        flat = {
            name: value if isinstance(value, str) else _json(value)
            for name, value in sorted(self.header.items())
        }
        self._mcap.add_metadata("run", {"format_version": str(FORMAT_VERSION), **flat})
        config = _json(self.header.get("config", self.header))
        self._mcap.add_attachment(0, 0, "config.json", "application/json", config.encode())
        run = schema.RunMessage(format_version=FORMAT_VERSION, header=self._text)
        self._add(Packed(schema.RUN, 0, run.SerializeToString()))
        self._mcap.flush()

    def _add(self, message: Packed) -> None:
        topic, time, data = message
        self._mcap.add_message(self._channels[topic], log_time=time, publish_time=time, data=data)


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

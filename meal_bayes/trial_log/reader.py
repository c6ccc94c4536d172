"""MCAP -> trials, every byte checked; and the short way to what a file is."""

import contextlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Channel, Header, Metadata, Statistics

from meal_bayes.agents.trial import Trial
from meal_bayes.errors import LogCorruptError, LogError, LogVersionError
from meal_bayes.trial_log.container import (
    FAULTS,
    Record,
    chunk_messages,
    read_records,
    read_summary,
)
from meal_bayes.trial_log.decode import TrialBuilder, decode_header
from meal_bayes.trial_log.schema import (
    ACTIVE,
    END,
    FORMAT_VERSION,
    MOMDPS,
    OUTCOME,
    PROFILE,
    RUN,
    STEP,
    SUFFIX,
    channels,
)

_PROBLEMS = 20  # that are told of one file


@dataclass(frozen=True, slots=True)
class LogInfo:
    """What a whole log holds, read without its trials."""

    path: Path
    size: int  # bytes
    format_version: int
    trials: int
    steps: int
    momdps: int
    header: dict[str, object]


def read_trials(path: str | Path) -> Iterator[Trial]:
    """Read the trials of a whole log one by one, equal to what was written.

    Each trial is checked before it is given out, the file as a whole when the last one has been.

    Raises
    ------
    LogError : there is no such file.
    LogCorruptError : the file is unfinished, torn or changed.
    LogVersionError : the file has another format version.
    """
    path = find_log(path)
    if path.name.endswith(ACTIVE):
        raise LogCorruptError(f"{path} was not finished by its writer; {_way_out(path)}")
    return Scan(path).trials()


def read_header(path: str | Path) -> dict[str, object]:
    """Read what the run was (config, seed, versions), also from a torn file; errors as above."""
    path = find_log(path)
    with opened(path) as (file, size):
        return _header(read_records(file, size))


def log_info(path: str | Path) -> LogInfo:
    """Read what a whole log holds from its first and last records alone; errors as above."""
    path = find_log(path)
    with opened(path) as (file, size):
        header = _header(read_records(file, size))
        topics, counts = dict[int, str](), dict[str, int]()
        for record in read_summary(file, size):
            if record.opcode == Opcode.CHANNEL:
                channel = Channel.read(_stream(record))
                topics[channel.id] = channel.topic
            elif record.opcode == Opcode.STATISTICS:
                found = Statistics.read(_stream(record)).channel_message_counts
                counts = {topics[number]: count for number, count in found.items()}
    return LogInfo(
        path,
        size,
        FORMAT_VERSION,
        trials=counts.get(OUTCOME, 0),
        steps=counts.get(STEP, 0),
        momdps=counts.get(MOMDPS, 0),
        header=header,
    )


class Scan:
    """One reading of a file; a tolerant one notes the faults and goes on behind them."""

    def __init__(self, path: Path, *, tolerant: bool = False) -> None:
        self.path = path
        self.problems: list[str] = []
        self.builder = TrialBuilder()
        self._tolerant = tolerant
        # Where the first chunk is lost, the others still mean what this format says they mean.
        names = (topic for topic, _, _ in channels()) if tolerant else ()
        self._channels = dict(enumerate(names, start=1))
        self._end: dict[str, str] = {}

    def trials(self) -> Iterator[Trial]:
        """Yield every whole trial."""
        with opened(self.path) as (file, size):
            records = read_records(file, size)
            while (record := self._next(records)) is not None:
                yield from self._read(record)
            self._check_end()

    def unfinished(self) -> Trial | None:
        """Return the trial that was under way when the file ends, once all has been read."""
        try:
            return self.builder.unfinished()
        except FAULTS as fault:
            self._note(fault)
            return None

    def _next(self, records: Iterator[Record]) -> Record | None:
        try:
            return next(records, None)
        except FAULTS as fault:
            self._note(fault)
            return None

    def _read(self, record: Record) -> Iterator[Trial]:
        try:
            if record.opcode == Opcode.CHUNK:
                for topic, data in chunk_messages(record.content, self._channels):
                    trial = self.builder.add(topic, data)
                    if trial is not None:
                        yield trial
            elif record.opcode == Opcode.METADATA:
                metadata = Metadata.read(_stream(record))
                self._end = metadata.metadata if metadata.name == END else self._end
            elif record.opcode == Opcode.HEADER:
                _check_profile(record)
        except FAULTS as fault:
            self.builder.drop()
            self._note(fault)

    def _check_end(self) -> None:
        try:
            if self.builder.header is None:
                raise LogCorruptError("the header of the run is missing")
            self.builder.check_end(self._end)
        except FAULTS as fault:
            self._note(fault)

    def _note(self, fault: Exception) -> None:
        if not self._tolerant:
            raise fault
        if len(self.problems) < _PROBLEMS:
            self.problems.append(_said(fault))


@contextlib.contextmanager
def opened(path: Path) -> Iterator[tuple[BinaryIO, int]]:
    """Open a file with its size; every fault met inside becomes ours, with the file's name."""
    try:
        with path.open("rb") as file:
            yield file, os.fstat(file.fileno()).st_size
    except LogVersionError as fault:
        raise LogVersionError(f"{path} was {fault}.") from fault
    except FAULTS as fault:
        raise LogCorruptError(f"{path}: {_said(fault)}; {_way_out(path)}") from fault
    except OSError as fault:
        raise LogError(f"{path} cannot be read: {fault}.") from fault


def find_log(path: str | Path) -> Path:
    """Check that there is a file, and say where it may be."""
    path = Path(path)
    if path.is_file():
        return path
    active = path.with_name(path.name + ACTIVE)
    if active.is_file():
        raise LogError(f"There is no {path}, but its unfinished {active.name}; {_way_out(active)}")
    raise LogError(f"There is no log {path}; expected the name of a {SUFFIX} file.")


def _way_out(path: Path) -> str:
    return f"save its whole trials with: meal-bayes log recover {path}"


def _said(fault: Exception) -> str:
    return str(fault) if isinstance(fault, LogError) else f"{type(fault).__name__}: {fault}"


def _stream(record: Record) -> ReadDataStream:
    return ReadDataStream(BytesIO(record.content))


def _check_profile(record: Record) -> None:
    profile = Header.read(_stream(record)).profile
    if profile != PROFILE:
        raise LogCorruptError(f"an MCAP file of another kind ({profile!r}, expected {PROFILE!r})")


def _header(records: Iterator[Record]) -> dict[str, object]:
    for record in records:
        if record.opcode == Opcode.HEADER:
            _check_profile(record)
        elif record.opcode == Opcode.CHUNK:
            topic, data = next(chunk_messages(record.content, {}), ("", b""))
            if topic == RUN:
                return decode_header(data)
            break
    raise LogCorruptError("the header of the run is missing")

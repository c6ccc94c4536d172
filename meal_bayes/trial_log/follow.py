"""Logs that are still being written: trials as they land, from a file or a run's whole folder."""

import contextlib
import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

from mcap.records import DataEnd

from meal_bayes.errors import LogError, LogVersionError
from meal_bayes.trial_log.container import FAULTS, TORN, fault_text, read_records
from meal_bayes.trial_log.decode import TrialBuilder
from meal_bayes.trial_log.names import log_files, stem_of
from meal_bayes.trial_log.schema import FULL, SUFFIX
from meal_bayes.trials import Trial


class Follower:
    """Follows a file, or every file of a folder, from its beginning on.

    `poll` yields what has been flushed since the last call. A file that gets its final name while
    it is read stays open, so nothing of it is missed or read twice; what an earlier draft of a log
    held is not yielded again. A damaged file is noted in `problems` and followed no further; a
    compact log, which holds no steps, is passed over.
    """

    def __init__(self, path: str | Path) -> None:
        self.path = Path(path)
        self.problems: list[str] = []
        self._tails: dict[tuple[int, int], _Tail] = {}  # by device and inode, whatever its name
        self._yielded = Counter[Path]()  # trials of each log

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
        """Yield the whole trials that have come since the last call."""
        try:
            files = log_files(self.path)
        except LogError:  # not there yet, or not any more: what was opened is still read
            files = []
        for path in files:
            with contextlib.suppress(FileNotFoundError):  # it got its name since
                state = path.stat()
                if (state.st_dev, state.st_ino) not in self._tails:
                    self._tails[state.st_dev, state.st_ino] = _Tail(path)
        for tail in self._tails.values():
            try:
                for trial in tail.poll():
                    if tail.builder.read.trials > self._yielded[tail.name]:
                        self._yielded[tail.name] += 1
                        yield trial
            except LogVersionError as fault:
                tail.file.close()
                raise LogVersionError(f"{tail.name} was {fault}.") from fault
            except FAULTS as fault:
                tail.file.close()
                self.problems.append(f"{tail.name}: {fault_text(fault)}")

    def close(self) -> None:
        """Close all files."""
        for tail in self._tails.values():
            tail.file.close()


class _Tail:
    """One file that grows; it is closed when it has ended."""

    def __init__(self, path: Path) -> None:
        self.name = path.with_name(f"{stem_of(path)}{SUFFIX}")  # the one that is meant
        self.builder, self.file = TrialBuilder(), path.open("rb")
        self._at = 0  # behind the last whole record

    def poll(self) -> Iterator[Trial]:
        """Yield the trials of the records that are whole by now."""
        if self.file.closed:
            return
        self.file.seek(self._at)
        try:
            for record in read_records(self.file, begin=self._at):
                self._at = self.file.tell()
                for entry in self.builder.records(record):
                    if isinstance(entry, Trial):
                        yield entry
                if isinstance(record, DataEnd) or self.builder.form != FULL:
                    return self.file.close()  # without steps there is nothing to follow
        except TORN:
            if not os.fstat(self.file.fileno()).st_nlink:  # a draft that was given up
                self.file.close()

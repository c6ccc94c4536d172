"""A recording that grows while others read it, in a file without a name."""

import os
import tempfile
import threading

_POLL = 1.0  # s between checks whether the recording has ended


class Feed:
    """Bytes that one thread appends and many read from the beginning, waiting for more."""

    def __init__(self) -> None:
        self._file = tempfile.TemporaryFile()  # noqa: SIM115  closed by `close`
        self._size, self._ended = 0, False
        self._changed = threading.Condition()

    @property
    def size(self) -> int:
        """Bytes so far."""
        return self._size

    def append(self, data: bytes) -> None:
        """Add bytes to the end."""
        with self._changed:
            if self._ended:
                return
            self._file.seek(0, os.SEEK_END)
            self._file.write(data)
            self._file.flush()
            self._size += len(data)
            self._changed.notify_all()

    def end(self) -> None:
        """Mark the end, at which readers stop."""
        with self._changed:
            self._ended = True
            self._changed.notify_all()

    def read(self, start: int, most: int) -> bytes:
        """Read what is there from `start` on, waiting for at least one byte; b"" at the end."""
        with self._changed:
            while self._size <= start and not self._ended:
                self._changed.wait(_POLL)
            if self._file.closed or self._size <= start:
                return b""
            self._file.seek(start)
            return self._file.read(most)

    def close(self) -> None:
        """End, and remove the file."""
        self.end()
        with self._changed:
            self._file.close()

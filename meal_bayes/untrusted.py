"""What others wrote, read within limits: files of bounded size, JSON of bounded depth.

Whatever a reader asks memory or time for, it asks by these numbers and never by what a file claims.
A fault is a `ValueError`; each package turns it into its own error, with the file's name.
"""

import json
import math
import os
import stat
from collections.abc import Iterator
from pathlib import Path

TEXT_LIMIT = 1 << 28  # bytes of a file of numbers: 256 MB
TABLE_LIMIT = 1 << 18  # bytes of a domain's TOML
LINE_LIMIT = 10_000  # characters of a line of it
JSON_LIMIT = 4 << 20  # bytes of one JSON text
DEPTH_LIMIT = 32  # lists and tables inside each other
LARGEST = 1e6  # s: rewards, costs and shaping; beyond it a search may not come to an end
NAME_LIMIT = 1000  # attributes, behaviors or states of one domain, each
LETTER_LIMIT = 200  # characters of such a name
DIAGRAM_LIMIT = 1_000_000  # entries (E,X,X) of a transition table


def read_bytes(path: Path, limit: int = TEXT_LIMIT) -> bytes:
    """Read a regular file whole, if it is not larger than the limit.

    Raises
    ------
    OSError
        The file cannot be read.
    ValueError
        It is larger, is no regular file (a pipe or device may never end), or holds zero bytes,
        which no text does: a disk that lost a part of the file leaves them.
    """
    # Not to wait for a pipe that nobody writes to.
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    with os.fdopen(number, "rb") as file:
        status = os.fstat(number)
        if stat.S_ISDIR(status.st_mode):
            raise IsADirectoryError(21, os.strerror(21), str(path))
        if not stat.S_ISREG(status.st_mode):
            raise ValueError("it is no regular file, but a pipe or a device")
        data = file.read(limit + 1) if status.st_size <= limit else b""
    if status.st_size > limit or len(data) > limit:
        raise ValueError(f"it has {status.st_size:,} bytes, more than {limit:,}")
    if b"\0" in data:
        raise ValueError(f"it has a zero byte at {data.index(0)}, and text has none")
    return data


def read_json(text: str | bytes) -> object:
    """Read JSON that others wrote.

    Raises
    ------
    ValueError
        No JSON, too large or nested too deeply, a number that is not finite, text that is no
        Unicode (a surrogate alone).

    Examples
    --------
    >>> read_json('{"seed": 3}')
    {'seed': 3}
    >>> read_json("[" * 50_000 + "]" * 50_000)
    Traceback (most recent call last):
    ValueError: JSON is nested more than 32 deep
    """
    if len(text) > JSON_LIMIT:
        raise ValueError(f"JSON of {len(text):,} characters, more than {JSON_LIMIT:,}")
    try:
        value: object = json.loads(text)
        for level in levels(value):
            for leaf in level:
                if isinstance(leaf, float) and not math.isfinite(leaf):
                    raise ValueError(f"JSON holds {leaf}, which is no number")
                if isinstance(leaf, str):
                    leaf.encode()  # UnicodeEncodeError, a ValueError, of a surrogate alone
    except RecursionError:
        raise ValueError(f"JSON is nested more than {DEPTH_LIMIT} deep") from None
    return value


def levels(value: object) -> Iterator[list[object]]:
    """Yield the values of every depth of lists and tables.

    Raises
    ------
    RecursionError
        They are nested more than `DEPTH_LIMIT` deep. Parsers raise it too, but at a depth that any
        library may change (`sys.setrecursionlimit`).
    """
    level, depth = [value], 0
    while level:
        yield level
        tables = [entry for entry in level if isinstance(entry, dict)]
        lists = [entry for entry in level if isinstance(entry, list)]
        if depth == DEPTH_LIMIT and (tables or lists):
            raise RecursionError
        level = [entry for entries in lists for entry in entries]
        level += [entry for table in tables for pair in table.items() for entry in pair]
        depth += 1

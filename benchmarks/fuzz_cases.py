"""One crafted file: what it is, how it is made, how it is read."""

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

HUGE = 1 << 40  # bytes of a sparse file


class Case(NamedTuple):
    """One crafted file."""

    kind: str
    told: str  # what it is
    name: str  # of the file
    make: Callable[[Path], object]
    read: Callable[[Path], object]
    frequent: bool = False  # one of many alike


def writes(data: Callable[[], bytes]) -> Any:
    """Make a file of bytes that are made when they are needed."""
    return lambda path: path.write_bytes(data())


def sparse(head: bytes, tail: bytes = b"") -> Any:
    """Make a file of a terabyte, which is all hole but for its ends."""

    def make(path: Path) -> None:
        path.write_bytes(head)
        os.truncate(path, HUGE)
        if tail:
            with path.open("r+b") as file:
                file.seek(0, os.SEEK_END)
                file.write(tail)

    return make

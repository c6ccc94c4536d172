"""What others wrote, read within limits: files of bounded size, JSON of bounded depth, arrays.

Arrays and JSON lie in a zip that `numpy.load` opens: nothing in it can make a program execute.

Whatever a reader asks memory or time for, it asks by these numbers and never by what a file claims.
A fault is a `ValueError`; each package turns it into its own error, with the file's name.
"""

import codecs
import errno
import io
import json
import lzma
import os
import stat
import struct
import unicodedata
import zipfile
import zlib
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

TEXT_LIMIT = 1 << 28  # bytes of a file of numbers: 256 MB
TABLE_LIMIT = 1 << 18  # bytes of a domain's TOML
LINE_LIMIT = 10_000  # characters of a line of it
MEMBER_LIMIT = 1 << 31  # bytes that a member of a zip may unpack to, unless its reader says less
FREE_BYTES = 64 << 20  # that any file may unpack to
UNPACKING = 256  # times its own size that a larger one may
JSON_LIMIT = 4 << 20  # bytes of one JSON text
DEPTH_LIMIT = 32  # lists and tables inside each other
LARGEST = 1e6  # s: rewards, costs and shaping; beyond it a search may not come to an end
NAME_LIMIT = 1000  # attributes, behaviors or states of one domain, each
LETTER_LIMIT = 200  # characters of such a name
_NO_LETTERS = {"Cc", "Cs", "Zl", "Zp"}  # categories of Unicode
DIAGRAM_LIMIT = 1_000_000  # entries (E,X,X) of a transition table
UNREADABLE = (  # what torn or changed bytes raise
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, KeyError, IndexError, ValueError,
    TypeError, AttributeError, EOFError, OverflowError, NotImplementedError, RuntimeError,
    SyntaxError,
)  # fmt: skip


def open_regular(path: Path) -> BinaryIO:
    """Open a file to read; an `OSError` where it is a pipe or a device, which may never end."""
    # Not to wait for a pipe that nobody writes to.
    number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    if not stat.S_ISREG(os.fstat(number).st_mode):
        os.close(number)
        raise OSError(errno.EINVAL, "it is no regular file, but a folder, a pipe or a device")
    return os.fdopen(number, "rb")


def read_bytes(path: Path, limit: int = TEXT_LIMIT) -> bytes:
    """Read a regular file whole, if it is not larger than the limit; an `OSError` or `ValueError`.

    Zero bytes, which no text has, are what a disk leaves that lost a part of the file.
    """
    with open_regular(path) as file:
        size = os.fstat(file.fileno()).st_size
        if size > limit:
            raise ValueError(f"it has {size:,} bytes, more than {limit:,}")
        data = file.read(limit)
    if data[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE):
        raise ValueError("it is UTF-16 text; save it as UTF-8")
    if b"\0" in data:
        raise ValueError(f"it has a zero byte at {data.index(0)}, and text has none")
    return data


def name_fault(name: object) -> str:
    """Return why a value cannot be a name in files, columns and logs; "" where it can.

    >>> name_fault(" red")
    'is empty, or has blanks at its ends'
    """
    if not isinstance(name, str):
        return f"is no text, but {type(name).__name__}"
    if not name or name != name.strip():
        return "is empty, or has blanks at its ends"
    if len(name) > LETTER_LIMIT:
        return f"has {len(name)} characters, more than {LETTER_LIMIT}"
    if any(unicodedata.category(letter) in _NO_LETTERS for letter in name):
        return "holds line ends, control characters or lone surrogates (bytes that are no UTF-8)"
    return ""


def read_json(text: str | bytes) -> object:
    """Read JSON that others wrote; a `ValueError` where it is too large or deep, or not finite.

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
        check_depth(value)
        # ValueErrors: of infinity and NaN; of a surrogate alone.
        json.dumps(value, allow_nan=False, ensure_ascii=False).encode()
    except RecursionError:
        raise ValueError(f"JSON is nested more than {DEPTH_LIMIT} deep") from None
    return value


def check_depth(value: object, depth: int = DEPTH_LIMIT) -> None:
    """Raise a `RecursionError` where lists and tables are inside each other more than so often.

    Parsers raise it too, but at a depth that any library may change (`sys.setrecursionlimit`).
    """
    if isinstance(value, dict | list):
        if depth == 0:
            raise RecursionError
        for entry in value.values() if isinstance(value, dict) else value:
            check_depth(entry, depth - 1)


def write_array(archive: zipfile.ZipFile, name: str, values: NDArray[Any]) -> None:
    """Write an array as the member NAME.npy."""
    buffer = io.BytesIO()
    values = np.ascontiguousarray(values)
    np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
    info = zipfile.ZipInfo(f"{name}.npy")  # of 1980, so that equal arrays give equal bytes
    archive.writestr(info, buffer.getvalue(), archive.compression, archive.compresslevel)


def read_array(
    archive: zipfile.ZipFile, name: str, dtype: str, axes: int, limit: int = MEMBER_LIMIT
) -> NDArray[Any]:
    """Read the member NAME.npy, of this dtype and number of axes; raises one of `UNREADABLE`."""
    # By hand, as `np.load` would allocate what a header claims before anything is checked.
    content = read_member(archive, f"{name}.npy", limit)
    buffer = io.BytesIO(content)
    if np.lib.format.read_magic(buffer) != (1, 0):
        raise ValueError(f"{name} is of another array format than 1.0")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(buffer)
    if kind != np.dtype(dtype) or len(shape) != axes or fortran or min(shape) < 0:
        raise ValueError(f"{name} is {kind} {shape}, expected {dtype} with {axes} axes")
    return np.frombuffer(content, dtype, offset=buffer.tell()).reshape(shape)


def check_unpacked(archive: zipfile.ZipFile, size: int) -> None:
    """Raise a `ValueError` where a zip of so many bytes claims to unpack to far more.

    Zeros compress a thousandfold: a small file may ask for gigabytes.
    """
    claimed = sum(info.file_size for info in archive.infolist())
    most = FREE_BYTES + UNPACKING * size
    if claimed > most:
        raise ValueError(f"it has {size:,} bytes and claims to unpack to {claimed:,}")


def read_member(archive: zipfile.ZipFile, name: str, limit: int = MEMBER_LIMIT) -> bytes:
    """Unpack a member of reasonable size; raises one of `UNREADABLE`."""
    # The size that the zip claims; unpacking stops there, and the checksum tells a lie.
    info = archive.getinfo(name)
    if info.file_size > limit:
        raise ValueError(f"{name} claims {info.file_size} bytes, more than {limit}")
    return archive.read(info)


def read_meta(content: bytes, version: int) -> dict[str, Any]:
    """Read a JSON table whose "format" is this version; raises a `ValueError`."""
    meta = read_json(content)
    format_ = meta.get("format") if isinstance(meta, dict) else type(meta).__name__
    if not isinstance(meta, dict) or format_ != version:
        raise ValueError(f"it has format {format_}; this version reads format {version}")
    return meta

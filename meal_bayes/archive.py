"""Arrays and JSON in a zip that `numpy.load` opens: nothing in it can make a program execute.

What a member claims to hold is checked before memory is asked for.
"""

import io
import lzma
import struct
import zipfile
import zlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.untrusted import read_json

_LARGEST = 2**31  # bytes that a member may unpack to, unless its reader says less
_EPOCH = (1980, 1, 1, 0, 0, 0)  # equal arrays give equal bytes
UNREADABLE = (  # what torn or changed bytes raise
    zipfile.BadZipFile, zlib.error, lzma.LZMAError, struct.error, KeyError, IndexError, ValueError,
    TypeError, AttributeError, EOFError, OverflowError, NotImplementedError, RuntimeError,
    SyntaxError,
)  # fmt: skip


def write_array(archive: zipfile.ZipFile, name: str, values: NDArray[Any]) -> None:
    """Write an array as the member NAME.npy."""
    buffer = io.BytesIO()
    values = np.ascontiguousarray(values)
    np.lib.format.write_array(buffer, values, version=(1, 0), allow_pickle=False)
    info = zipfile.ZipInfo(f"{name}.npy", _EPOCH)
    archive.writestr(info, buffer.getvalue(), archive.compression, archive.compresslevel)


def read_array(
    archive: zipfile.ZipFile, name: str, dtype: str, axes: int, limit: int = _LARGEST
) -> NDArray[Any]:
    """Read the member NAME.npy, of this dtype and number of axes; raises one of `UNREADABLE`."""
    content = read_member(archive, f"{name}.npy", limit)
    buffer = io.BytesIO(content)
    if np.lib.format.read_magic(buffer) != (1, 0):
        raise ValueError(f"{name} is of another array format than 1.0")
    shape, fortran, kind = np.lib.format.read_array_header_1_0(buffer)
    if kind != np.dtype(dtype) or len(shape) != axes or fortran or min(shape) < 0:
        raise ValueError(f"{name} is {kind} {shape}, expected {dtype} with {axes} axes")
    return np.frombuffer(content, dtype, offset=buffer.tell()).reshape(shape)


def read_member(archive: zipfile.ZipFile, name: str, limit: int = _LARGEST) -> bytes:
    """Unpack a member of reasonable size; raises one of `UNREADABLE`."""
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

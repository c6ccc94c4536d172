"""Digests of values, files and arrays, and the version: all by which a result is named."""

import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

_PACKAGE = Path(__file__).parent
_SOURCES = (".py", ".toml", ".npz")  # files of the package that can change a number


def digest_of(*parts: object) -> str:
    """Compute a digest of JSON values, and of the contents of files, or of all files of folders."""
    digest = hashlib.sha256()
    for part in parts:
        pieces = _contents(part) if isinstance(part, Path) else [_json(part)]
        # Each piece by its own digest, so that ("ab", "c") differs from ("a", "bc").
        for piece in pieces:
            digest.update(hashlib.sha256(piece).digest())
    return digest.hexdigest()


def _json(value: object) -> bytes:
    return json.dumps(value, sort_keys=True).encode()


def _contents(path: Path) -> list[bytes]:
    """Return name and content of a file, or of each file in a folder."""
    pieces = []
    for file in [path] if path.is_file() else sorted(path.rglob("*")):
        if file.is_file() and file.suffix != ".pyc":
            pieces.append(file.relative_to(path).as_posix().encode())
            pieces.append(file.read_bytes())
    return pieces


def checksum_of(path: Path) -> str:
    """Compute the SHA-256 of a file, as `sha256sum` prints it."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def digest_of_arrays(arrays: Mapping[Any, NDArray[Any]]) -> str:
    """Compute a digest of arrays and their names, in any order."""
    digest = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        digest.update(repr((name, values.dtype.str, values.shape)).encode())
        digest.update(np.ascontiguousarray(values).tobytes())
    return digest.hexdigest()


@lru_cache(maxsize=1)
def code_digest() -> str:
    """Compute a digest of the package's own code and tables."""
    files = [path for path in sorted(_PACKAGE.rglob("*")) if path.suffix in _SOURCES]
    names = [path.relative_to(_PACKAGE).as_posix() for path in files]
    return digest_of(names, *files)[:16]


@lru_cache(maxsize=1)  # each log names it, and it takes a millisecond
def package_version() -> str:
    """Return the version of the package, "unreleased" where it is not installed."""
    from importlib import metadata  # noqa: PLC0415  costs as much as the package's own import

    try:
        return metadata.version("meal-bayes")
    except metadata.PackageNotFoundError:
        return "unreleased"

"""Download of the public recordings: pinned commits, checksums, a cache, a mirror, offline.

Environment: ``MEAL_BAYES_DATA_DIR`` names the cache folder, ``MEAL_BAYES_DATA_URL`` a mirror (an
http address or a folder) to read from, ``MEAL_BAYES_OFFLINE=1`` forbids the network.

``SHA256SUMS`` beside this file lists every file that the shipped domains and the paper's items
need, below the mirror base. It was made in a folder mirror of the two repositories at their pinned
commits, by ``sha256sum <files> | sort -k 2 > SHA256SUMS``; ``sha256sum --check SHA256SUMS`` there
repeats it.
"""

import contextlib
import functools
import hashlib
import logging
import os
import shutil
import time
from collections.abc import Iterable
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, BinaryIO

from meal_bayes.datasets.sources import source
from meal_bayes.errors import DownloadError

if TYPE_CHECKING:
    import pooch

log = logging.getLogger("meal_bayes.datasets")

PUBLIC_BASE = "https://raw.githubusercontent.com/"
_TEMPORARY = "tmp" + 8 * "[a-z0-9_]"  # as Python's `tempfile` names files
_TORN = 3600.0  # s since it was written: who wrote it has ended
_LARGEST = 1 << 24  # bytes of a file: the largest that is published has four million
_WITHOUT = "the embedded percepts (`load_percepts`) need no download"


def cache_folder() -> Path:
    """Return the cache folder: ``MEAL_BAYES_DATA_DIR``, or the system's."""
    import pooch  # noqa: PLC0415  loaded when needed, so that the package loads NumPy only

    return Path(os.environ.get("MEAL_BAYES_DATA_DIR") or pooch.os_cache("meal_bayes"))


def registry(data: str) -> dict[str, str]:
    """Return the SHA-256 digests of a data set's files, by their path below the mirror base."""
    folder = f"{source(data).path}/"
    listed = resources.files(__package__).joinpath("SHA256SUMS").read_text(encoding="ascii")
    rows = [line.split("  ", 1) for line in listed.splitlines()]
    return {path: digest for digest, path in rows if path.startswith(folder)}


def verify(data: str) -> list[tuple[Path, str]]:
    """Compare the cached files with the registry: "ok", "missing" or "changed" each."""
    states = []
    for name, digest in registry(data).items():
        path = cache_folder() / name
        same = path.is_file() and _digest(path) == digest
        states.append((path, "ok" if same else "changed" if path.is_file() else "missing"))
    return states


def fetch(data: str) -> Path:
    """Download a data set's files into the cache, and return the cache folder.

    A file whose bytes differ from the registry is fetched anew.

    Raises
    ------
    DownloadError
        A file that cannot be downloaded, or whose bytes differ from the pinned ones.
    """
    import pooch  # noqa: PLC0415  as above

    known, folder = registry(data), cache_folder()
    base = os.environ.get("MEAL_BAYES_DATA_URL") or PUBLIC_BASE
    base = base.removeprefix("file://").rstrip("/") + "/"
    if os.environ.get("MEAL_BAYES_OFFLINE", "0") not in ("", "0"):
        _check_offline(data)
        return folder
    pooch.get_logger().setLevel("WARNING")  # it would log every file on the terminal
    _remove_torn({(folder / name).parent for name in known})
    keeper = pooch.create(path=folder, base_url=base, registry=known)
    download = functools.partial(_download, pooch.HTTPDownloader())
    for name in known:
        try:
            keeper.fetch(name, downloader=download)
        except OSError as error:
            raise DownloadError(
                f"Cannot get {base}{name} into {folder} ({' '.join(str(error).split())[:200]}); "
                "set MEAL_BAYES_DATA_URL to a mirror (an http address or a folder), or "
                f"MEAL_BAYES_DATA_DIR to a folder that can be written; {_WITHOUT}."
            ) from error
    return folder


def _remove_torn(folders: Iterable[Path]) -> None:
    """Remove what killed downloads left: pooch's temporary files, once they are an hour old."""
    for path in (path for folder in folders for path in folder.glob(_TEMPORARY)):
        with contextlib.suppress(OSError):
            if path.is_file() and time.time() - path.stat().st_mtime > _TORN:
                path.unlink()


def _download(http: "pooch.HTTPDownloader", url: str, target: str, keeper: "pooch.Pooch") -> None:
    """Download or copy one file to a temporary name, and check its bytes."""
    with Path(target).open("wb") as file:
        body = _Body(file, url)
        if url.startswith(("http://", "https://")):
            http(url, body, keeper)
        else:
            with Path(url).open("rb") as source_file:
                shutil.copyfileobj(source_file, body)
    expected = keeper.registry[url.removeprefix(keeper.base_url)]
    found = _digest(Path(target))
    if found != expected:
        raise DownloadError(
            f"{url}: found SHA-256 {found[:12]}..., expected {expected[:12]}...; the file was not "
            "kept: try again, or set MEAL_BAYES_DATA_URL to a mirror that holds the pinned "
            f"commit's files; {_WITHOUT}."
        )
    log.info("fetched %s", url)


class _Body:
    """File that refuses more bytes than a published one has, whatever a server sends."""

    def __init__(self, file: BinaryIO, url: str) -> None:
        self._file, self._url, self._left = file, url, _LARGEST

    def write(self, data: bytes) -> None:
        """Write a part of the body."""
        self._left -= len(data)
        if self._left < 0:
            raise DownloadError(
                f"{self._url}: found more than {_LARGEST:,} bytes, which no published file has; "
                "nothing was kept: set MEAL_BAYES_DATA_URL to a mirror that holds the pinned "
                f"commit's files; {_WITHOUT}."
            )
        self._file.write(data)

    def flush(self) -> None:
        """Flush the file."""
        self._file.flush()


def _check_offline(data: str) -> None:
    bad = [(path, state) for path, state in verify(data) if state != "ok"]
    if bad:
        path, state = bad[0]
        raise DownloadError(
            f"{path} is {state} ({len(bad)} files of {data} in all), and MEAL_BAYES_OFFLINE "
            "forbids the network; unset it, or set MEAL_BAYES_DATA_DIR to a folder that holds "
            f"them; {_WITHOUT}."
        )


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()

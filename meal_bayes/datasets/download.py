"""Download of the public recordings: pinned commits, checksums, a cache, a mirror, offline.

Environment: ``MEAL_BAYES_DATA_DIR`` names the cache folder, ``MEAL_BAYES_DATA_URL`` a mirror (an
http address or a folder) to read from, ``MEAL_BAYES_OFFLINE=1`` forbids the network.

``SHA256SUMS`` beside this file lists every file that the shipped domains and the paper's items
need, below the mirror base. It was made in a folder mirror of the two repositories at their pinned
commits, by ``sha256sum <files> | sort -k 2 > SHA256SUMS``; ``sha256sum --check SHA256SUMS`` there
repeats it.
"""

import hashlib
import os
import shutil
from importlib import resources
from pathlib import Path

from meal_bayes.datasets.sources import source
from meal_bayes.errors import DownloadError

PUBLIC_BASE = "https://raw.githubusercontent.com/"
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
        path, state = cache_folder() / name, "missing"
        if path.is_file():
            same = hashlib.sha256(path.read_bytes()).hexdigest() == digest
            state = "ok" if same else "changed"
        states.append((path, state))
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

    folder = cache_folder()
    base = os.environ.get("MEAL_BAYES_DATA_URL") or PUBLIC_BASE
    base = base.removeprefix("file://").rstrip("/") + "/"
    if os.environ.get("MEAL_BAYES_OFFLINE", "0") not in ("", "0"):
        bad = [(path, state) for path, state in verify(data) if state != "ok"]
        if bad:
            path, state = bad[0]
            raise DownloadError(
                f"{path} is {state} ({len(bad)} files of {data} in all), and MEAL_BAYES_OFFLINE "
                "forbids the network; unset it, or set MEAL_BAYES_DATA_DIR to a folder that holds "
                f"them; {_WITHOUT}."
            )
        return folder
    pooch.get_logger().setLevel("WARNING")  # it would log every file on the terminal
    keeper = pooch.create(path=folder, base_url=base, registry=registry(data))
    web = base.startswith(("http://", "https://"))

    def copy(url: str, target: str, _: object) -> None:
        shutil.copyfile(url, target)

    for name in keeper.registry:
        try:
            keeper.fetch(name, downloader=pooch.HTTPDownloader() if web else copy)
        except (OSError, ValueError) as error:  # ValueError: another checksum; nothing was kept
            raise DownloadError(
                f"Cannot get {base}{name} into {folder} ({' '.join(str(error).split())[:400]}); "
                "set MEAL_BAYES_DATA_URL to a mirror (an http address or a folder) of the pinned "
                "commits, or MEAL_BAYES_DATA_DIR to a folder that can be written; "
                f"{_WITHOUT}."
            ) from error
    return folder

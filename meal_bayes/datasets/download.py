"""Recordings by name; the public ones are downloaded: pinned commits, checksums, a cache, a mirror.

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
from pathlib import Path

from meal_bayes.datasets.csv_files import load_csv_folder
from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.sources import SOURCES, find_folder, source
from meal_bayes.domain import load_domain
from meal_bayes.errors import DownloadError, SettingsError

PUBLIC_BASE = "https://raw.githubusercontent.com/"
_WITHOUT = "the embedded percepts (`load_percepts`) need no download"


def load_dataset(name: str | Path, *, root: str | Path | None = None) -> Dataset:
    """Load the recordings that fit a domain.

    Parameters
    ----------
    name : str | Path
        A shipped domain, or the path of your own domain table (TOML).
    root : str | Path | None
        Folder of the files. Public data: a folder mirror or a clone of the repository; without it
        they are downloaded once and checked. Own data: the folder of CSV files.

    Raises
    ------
    SettingsError
        No such domain, or own data without `root`.
    DataError
        Files that do not hold what their layout promises.
    DownloadError
        Files that cannot be downloaded.
    """
    if str(name).endswith(".npz"):
        raise SettingsError(
            f"{name} is a percept table, which holds no recordings; give the domain (a shipped "
            "name, or the path of its TOML) and, for your own, the folder of the CSV files."
        )
    domain = load_domain(name)
    if domain.data not in SOURCES:
        if root is None:
            raise SettingsError(
                f"Domain {domain.name!r} has no public recordings (those are {list(SOURCES)}); "
                "give root=<folder of your CSV files>, or make data with make_synthetic."
            )
        return load_csv_folder(domain, Path(root))
    if root is None:
        root = fetch(domain.data)
    return SOURCES[domain.data].load(domain, find_folder(domain.data, Path(root)))


def cache_folder() -> Path:
    """Return the cache folder: ``MEAL_BAYES_DATA_DIR``, or the system's."""
    import pooch  # noqa: PLC0415  loaded when needed, so that the package loads NumPy only

    return Path(os.environ.get("MEAL_BAYES_DATA_DIR") or pooch.os_cache("meal_bayes"))


def registry(data: str) -> dict[str, str]:
    """Return the SHA-256 digests of a data set's files, by their path below the mirror base."""
    folder = f"{source(data).path}/"
    listed = Path(__file__).with_name("SHA256SUMS").read_text(encoding="ascii")
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

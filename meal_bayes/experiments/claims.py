"""Who works on what, where several processes run the same commands on one folder of logs.

A claim is a lock of the file system on a small file that names its holder. The system releases it
when the holder ends, however it ends, on this machine or another: there are no stale claims.
Results do not rest on claims, as drafts have unique names and equal units are equal files; where a
file system has no locks, two processes may do the same work twice.
"""

import contextlib
import json
import logging
import os
import platform
import time
from collections.abc import Callable, Iterable, Iterator
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import NamedTuple, TypeVar

from meal_bayes.errors import OutputError
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.files import check_folder

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

log = logging.getLogger("meal_bayes.experiments")

Work = TypeVar("Work")
Result = TypeVar("Result")

_POLL = 0.2  # s between looks at claims of others


class Holder(NamedTuple):
    """The process that holds a claim."""

    host: str
    pid: int
    since: str

    def __str__(self) -> str:
        return f"process {self.pid} on {self.host} since {self.since}"


def run_claimed(
    function: Callable[[Work], Result],
    work: Iterable[tuple[Work, Path]],
    *,
    jobs: int,
    cluster: str | None = None,
    on_note: Callable[[str], None] | None = None,
) -> Iterator[Result]:
    """Call a function on every piece of work while its claim is held; see `in_parallel`.

    What another process holds is left to the end and waited for: the function is called when that
    process is done with it, or has died, and so must look whether there is anything left to do.

    Parameters
    ----------
    work : pieces, each with the path that its claim is named after.
    on_note : called with a line that says who is waited for; logged as a warning otherwise.

    Raises
    ------
    OutputError : a folder cannot be written.
    """
    todo = list(work)
    for folder in {path.parent for _, path in todo}:
        check_folder(folder)
    noted = set[Holder]()
    while todo:
        held: list[tuple[tuple[Work, Path], Holder]] = []
        attempt, numbered = partial(_attempt, function), enumerate(todo)
        for number, holder, result in in_parallel(attempt, numbered, jobs=jobs, cluster=cluster):
            if holder is None:
                yield result[0]
            else:
                held.append((todo[number], holder))
        todo = [piece for piece, _ in held]
        for (_, path), holder in held:
            if holder not in noted:
                noted.add(holder)
                (on_note or log.warning)(f"{path} is being made by {holder}; waiting for it")
        while todo and all(_is_held(path) for _, path in todo):
            time.sleep(_POLL)


@contextlib.contextmanager
def claimed(path: Path) -> Iterator[Holder | None]:
    """Lock a path while the block runs; yield its holder where that is another process."""
    file = _file(path)
    lock = _locked(file)
    if isinstance(lock, Holder):
        yield lock
        return
    try:
        since = datetime.now(UTC).isoformat(sep=" ", timespec="seconds")
        holder = Holder(platform.node(), os.getpid(), since)
        os.ftruncate(lock, 0)
        os.pwrite(lock, json.dumps(holder._asdict()).encode(), 0)
        yield None
    finally:
        file.unlink(missing_ok=True)  # before the lock goes, as then it may be another's
        os.close(lock)


def _attempt(
    function: Callable[[Work], Result], numbered: tuple[int, tuple[Work, Path]]
) -> tuple[int, Holder | None, tuple[Result, ...]]:
    number, (work, path) = numbered
    with claimed(path) as holder:
        if holder is None:
            return number, None, (function(work),)
    return number, holder, ()


def _file(path: Path) -> Path:
    return path.with_name(f"{path.name}.claim")


def _locked(file: Path) -> int | Holder:
    """Lock a file that may be removed by its holder at any time; its descriptor, or the holder."""
    while True:
        try:
            lock = os.open(file, os.O_RDWR | os.O_CREAT, 0o666)
        except OSError as fault:
            raise OutputError(f"{file} cannot be written: {fault.strerror}.") from fault
        if not _lock(lock):
            holder = _holder(lock)
            os.close(lock)
            return holder
        with contextlib.suppress(FileNotFoundError):
            if os.path.samestat(os.fstat(lock), file.stat()):
                return lock
        os.close(lock)  # its holder removed it between our two calls


def _lock(descriptor: int) -> bool:
    try:
        if fcntl is not None:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    except OSError as fault:
        log.info("no locks on this file system (%s)", fault)
    return True


def _holder(descriptor: int) -> Holder:
    try:
        return Holder(**json.loads(os.pread(descriptor, 1000, 0)))
    except (TypeError, ValueError):  # it has not written yet who it is
        return Holder("this or another machine", 0, "just now")


def _is_held(path: Path) -> bool:
    try:
        lock = os.open(_file(path), os.O_RDWR)
    except FileNotFoundError:
        return False
    try:
        return not _lock(lock)
    finally:
        os.close(lock)

"""Units of experiments, which joblib runs as one list, and which several commands share.

A unit is locked by the file system, which releases the lock when its holder ends, however it ends,
on this machine or another: no lock is stale. Results do not rest on locks, as drafts have unique
names and equal units are equal files; where a file system has no locks, two processes may do the
same work twice.
"""

import contextlib
import dataclasses
import itertools
import logging
import os
import platform
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, Protocol

import numpy as np
from filelock import FileLock, Timeout

from meal_bayes.domain import Domain, Event, Query
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.config import OfflineConfig, OnlineConfig
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.files import check_folder
from meal_bayes.trial_log import remove_drafts
from meal_bayes.trials import Task, Trial

log = logging.getLogger("meal_bayes.experiments")

_POLL = 0.2  # s between looks at locks of others
_LOOK = 1.0  # s between reports of what is done


class Unit(Protocol):
    """A part of an experiment that one process runs from beginning to end."""

    @property
    def path(self) -> Path:
        """The log that it writes, or the folder of its logs."""

    @property
    def size(self) -> int:
        """Of how many trials or batches it consists."""

    @property
    def done(self) -> int:
        """How many of them are whole on the disk."""

    def run(self, advance: Callable[[float], None]) -> None:
        """Run what another process has not done meanwhile; `advance` by what is done."""


class Planned(NamedTuple):
    """What a run consists of, before any of it runs; several of them may run as one list."""

    config: Any  # its settings, complete: an `OfflineConfig` or an `OnlineConfig`
    folder: Path  # of its logs
    units: Sequence[Unit]
    warm_up: Callable[[], None]  # compiles what its units need


def warm_up(config: OfflineConfig | OnlineConfig, domain: Domain) -> None:
    """Compile the kernels that the agents need once, so that not every process compiles them."""
    query = Query(domain.attributes[: config.attributes])
    queries = [query]
    if isinstance(config, OfflineConfig) and config.answer != "values":
        event = Event(tuple(itertools.repeat(True, len(query))))
        about_event = dataclasses.replace(query, event=event)
        # Whether one attribute holds is its value; that it does not hold is an event.
        queries = [query, about_event] if len(query) == 1 else [about_event]
    for agent, query_to_plan in itertools.product(config.agents, queries):
        agent.warm_up(domain, query_to_plan)


def run_units(
    runs: Iterable[Planned],
    *,
    jobs: int = 1,
    on_progress: Callable[[float, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> None:
    """Run all units of some runs that are not done, as one list.

    Any number of programs may do so at a time. What another program has locked is left to the end
    and waited for, and `on_note` called with a line that says so. What units need is compiled
    once, before every process would. `on_progress` is called with (parts done, parts in all): at
    the beginning and at the end, from a thread every second, those of units under way included,
    and after an interruption with what is kept. See `in_parallel` for jobs and clusters.
    """
    if jobs < 1:
        raise SettingsError(f"jobs is {jobs}; give the number of processes, 1 or more.")
    planned = list(runs)
    units = {unit.path: unit for run in planned for unit in run.units}.values()
    total = sum(unit.size for unit in units)
    remaining = {unit.path: unit.size - unit.done for unit in units}
    kept = total - sum(remaining.values())
    report = on_progress or (lambda *_: None)
    report(kept, total)
    todo = [unit for unit in units if remaining[unit.path]]
    if not todo:
        return
    for folder in {unit.path.parent for unit in todo}:
        check_folder(folder)
    for planned_run in planned:
        if any(remaining[unit.path] for unit in planned_run.units):
            planned_run.warm_up()
    announced = set[str]()
    with TemporaryDirectory(prefix="meal_bayes-") as name:
        parts = Path(name, "parts")
        parts.touch()
        # Other machines do not see that file; of them it is known how many units ended.
        ended = [0]
        mean = (total - kept) / len(todo)

        def look() -> None:
            done = max(float(np.fromfile(parts).sum()), mean * ended[-1])
            report(min(kept + done, total), total)

        try:
            # First what nobody has locked; then what others had, once they let go of it.
            for wait in (False, True):
                run = partial(_run_locked, parts=parts, wait=wait)
                on_done = None if wait else ended.append
                locked_by_others = set[Path]()
                with _every_second(look):
                    for path, holder in in_parallel(run, todo, jobs=jobs, on_done=on_done):
                        if holder is None:
                            continue
                        locked_by_others.add(path)
                        if holder not in announced:
                            announced.add(holder)
                            waiting = f"{path} is being made by {holder}; waiting for it"
                            (on_note or log.warning)(waiting)
                todo = [unit for unit in todo if unit.path in locked_by_others]
        except KeyboardInterrupt:
            report(sum(unit.done for unit in units), total)
            raise
    report(total, total)


@contextlib.contextmanager
def _every_second(look: Callable[[], None]) -> Iterator[None]:
    """Call a function every second while the block runs, from a thread."""
    over = threading.Event()

    def keep_looking() -> None:
        while not over.wait(_LOOK):
            look()

    thread = threading.Thread(target=keep_looking, daemon=True, name="progress")
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _run_locked(unit: Unit, *, parts: Path, wait: bool) -> tuple[Path, str | None]:
    """Run a unit once nobody else holds it; return its path, and who holds it."""
    with locked(unit.path, wait=wait) as lock:
        if isinstance(lock, str):
            return unit.path, lock
        # Other machines do not have the file of what is done.
        shown = parts if parts.exists() else Path(os.devnull)
        with shown.open("ab", buffering=0) as file:

            def advance(amount: float) -> None:
                file.write(np.float64(amount).tobytes())

            unit.run(advance)
        if lock:  # else another process may still be writing its drafts
            for path in unit.path.glob("*.mcap") if unit.path.is_dir() else [unit.path]:
                remove_drafts(path)
    return unit.path, None


def timed(
    run: Callable[[Task], Trial],
    tasks: Iterable[Task],
    advance: Callable[[float], None],
    fraction: float = 1,
) -> Iterator[tuple[Trial, float]]:
    """Run trials one by one; yield each with the wall-clock s it took.

    A trial is such a fraction of what its unit counts: all of a trial, or a fraction of a batch.
    """
    for task in tasks:
        start = time.perf_counter()
        trial = run(task)
        seconds = time.perf_counter() - start
        advance(fraction)
        yield trial, seconds


@contextlib.contextmanager
def locked(path: Path, *, wait: bool = False) -> Iterator[str | bool]:
    """Lock a path while the block runs; yield who else holds it, or whether there are locks."""
    file = path.with_name(f"{path.name}.lock")
    lock = FileLock(file, fallback_to_soft=False)
    try:
        lock.acquire(blocking=wait, poll_interval=_POLL)
    except Timeout:
        holder = ""
        with contextlib.suppress(OSError):  # it is done by now
            holder = file.read_text(encoding="utf-8")
        yield holder or "another process"
        return
    except OSError as fault:
        log.info("no locks on this file system (%s)", fault)
        yield False
        return
    try:
        since = datetime.now(UTC).isoformat(sep=" ", timespec="seconds")
        holder = f"process {os.getpid()} on {platform.node()} since {since}"
        file.write_text(holder, encoding="utf-8")
        yield True
    finally:
        file.unlink(missing_ok=True)  # before the lock goes, as then it may be another's
        lock.release()

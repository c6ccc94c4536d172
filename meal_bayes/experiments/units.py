"""Units of an experiment, run by processes here or on a cluster, and shared with other commands.

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
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Protocol

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


def warm_up(config: OfflineConfig | OnlineConfig, domain: Domain) -> None:
    """Compile the kernels that the agents need, once, before every process would."""
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
    units: Sequence[Unit],
    warm_up: Callable[[], None],
    *,
    jobs: int = 1,
    cluster: str | None = None,
    on_progress: Callable[[float, int], None] | None = None,
    on_note: Callable[[str], None] | None = None,
) -> None:
    """Run all units that are not done; any number of processes may do so at a time.

    What another process has locked is left to the end and waited for, and `on_note` called with a
    line that says so. `warm_up` compiles what units need, once, before every process would;
    `on_progress` is called with (parts done, parts in all), those of units under way here included,
    after an interruption with what is kept. See `in_parallel` for jobs and cluster.
    """
    if jobs < 1:
        raise SettingsError(f"jobs is {jobs}; give the number of processes, 1 or more.")
    remaining = {unit.path: unit.size - unit.done for unit in units}
    total = sum(unit.size for unit in units)
    done = total - sum(remaining.values())
    report = on_progress or (lambda *_: None)
    report(done, total)
    todo = [unit for unit in units if remaining[unit.path]]
    if not todo:
        return
    for folder in {unit.path.parent for unit in todo}:
        check_folder(folder)
    warm_up()
    announced = set[str]()
    with TemporaryDirectory(prefix="meal_bayes-") as name:
        progress = SharedProgress(Path(name, "parts"), len(todo))

        def look() -> None:
            report(done + progress.under_way, total)

        try:
            # First what nobody has locked; then what others had, once they let go of it.
            for wait in (False, True):
                locked_by_others: list[Unit] = []
                alone = cluster is None and min(jobs, len(todo)) == 1
                run = partial(
                    _run_locked, file=progress.file, then=look if alone else None, wait=wait
                )
                for number, holder in in_parallel(
                    run, enumerate(todo), jobs=jobs, cluster=cluster, meanwhile=look
                ):
                    unit = todo[number]
                    progress.clear(number)  # it counts as a whole from here on, or not at all
                    if holder is None:
                        done += remaining[unit.path]
                        look()
                        continue
                    locked_by_others.append(unit)
                    if holder not in announced:
                        announced.add(holder)
                        waiting = f"{unit.path} is being made by {holder}; waiting for it"
                        (on_note or log.warning)(waiting)
                todo = locked_by_others
        except KeyboardInterrupt:
            report(done, total)
            raise


class SharedProgress:
    """How much of each unit under way is done, in a file that processes of this machine share."""

    def __init__(self, file: Path, units: int) -> None:
        self.file = file
        self._done = np.memmap(file, float, "w+", shape=units)

    @property
    def under_way(self) -> float:
        """Trials or batches done of all units under way."""
        return float(self._done.sum())

    def clear(self, number: int) -> None:
        """Forget a unit that has ended."""
        self._done[number] = 0

    @staticmethod
    def counter(file: Path, number: int) -> Callable[[float], None]:
        """Return what a process calls with how much more of its unit is done."""
        try:
            done = np.memmap(file, float, "r+")
        except FileNotFoundError:  # a machine of a cluster, where nobody looks
            return lambda _: None

        def advance(amount: float) -> None:
            done[number] += amount

        return advance


def _run_locked(
    numbered: tuple[int, Unit], *, file: Path, then: Callable[[], None] | None, wait: bool
) -> tuple[int, str | None]:
    """Run a unit once nobody else holds it; return its number, and who holds it."""
    number, unit = numbered
    count = SharedProgress.counter(file, number)

    def advance(amount: float) -> None:
        count(amount)
        if then is not None:
            then()

    with locked(unit.path, wait=wait) as lock:
        if isinstance(lock, str):
            return number, lock
        unit.run(advance)
        if lock:  # else another process may still be writing its drafts
            for path in unit.path.glob("*.mcap") if unit.path.is_dir() else [unit.path]:
                remove_drafts(path)
    return number, None


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

"""Threads of one process: a lock behind which work can go on, and the turns that fits take."""

import contextvars
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future
from contextlib import AbstractContextManager
from typing import Any, TypeVar

T = TypeVar("T")


class Lock:
    """A lock for one thread at a time, which that thread may take again.

    Its holder can start work (`start_behind`) that goes on after the lock is released. Whoever
    takes the lock next waits for the end of this work, so that nothing changes under it.

    A copy of what holds one, in this process or in another, has a lock of its own: it shares
    nothing that would have to be guarded.

    Examples
    --------
    >>> lock = Lock()
    >>> with lock:
    ...     lock.start_behind(lambda: 6 * 7, print)
    >>> with lock:
    ...     pass
    42
    """

    def __init__(self) -> None:
        self._held = threading.RLock()
        self._behind: _Behind | None = None

    def __enter__(self) -> None:
        self._held.acquire()
        try:
            self._wait()
        except BaseException:
            self._held.release()
            raise

    def __exit__(self, *raised: object) -> None:
        self._held.release()

    def start_behind(self, work: Callable[[], T], finish: Callable[[T], object]) -> None:
        """Start work in a thread of its own; to be called by the thread that holds the lock.

        The work must not take this lock. Whoever takes it next calls `finish` with the result, or
        is raised the error of the work.
        """
        self._wait()
        self._behind = _Behind(work, finish)
        self._behind.start()

    @property
    def is_busy(self) -> bool:
        """Whether work that was started behind the lock still goes on."""
        behind = self._behind
        return behind is not None and behind.is_alive()

    def _wait(self) -> None:
        behind = self._behind
        if behind is not None:
            behind.join()  # an interruption leaves the work to whoever takes the lock next
            self._behind = None
            behind.finish()

    def __reduce__(self) -> tuple[type["Lock"], tuple[()]]:
        return Lock, ()


class _Behind(threading.Thread):
    """Work in a thread of its own; the program ends without waiting for it."""

    def __init__(self, work: Callable[[], Any], finish: Callable[[Any], object]) -> None:
        super().__init__(name="work behind a lock", daemon=True)
        self._context = contextvars.copy_context()  # how NumPy treats floating point errors, too
        self._work = work
        self._finish = finish
        self._result: Future[Any] = Future()

    def run(self) -> None:
        """Do the work, and keep its result, or the error that it raised."""
        try:
            self._result.set_result(self._context.copy().run(self._work))
        except BaseException as fault:
            self._result.set_exception(fault)

    def finish(self) -> None:
        """Finish with the result, in the thread that needs it."""
        if not self._result.done():  # a process that was forked has no other threads
            self.run()
        self._finish(self._result.result())


_TURN = [threading.RLock()]


def turn() -> AbstractContextManager[Any]:
    """Return the lock that one thread of this process at a time holds, which may take it again.

    Fits take turns by it: they limit the threads of BLAS, which are those of the whole process, and
    sums of another number of threads differ in their last bit.
    """
    return _TURN[0]


def _turn_anew() -> None:
    """Let a process that was forked wait for no thread of its parent."""
    _TURN[0] = threading.RLock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_turn_anew)

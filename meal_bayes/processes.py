"""Child processes that end with their parent, however it ends: SIGTERM, SIGKILL, closed terminal.

Python children watch who their parent is (`end_with_parent`). Foreign programs are started through
this file as a script (`start`): on Linux it asks the kernel to kill the program with its parent and
becomes the program; elsewhere it stays as a guard that ends the program.
"""

import contextlib
import contextvars
import copy
import ctypes
import multiprocessing
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import Future
from contextlib import AbstractContextManager
from typing import IO, Any, TypeVar

T = TypeVar("T")

_POLL = 0.2  # s between looks at the parent
_PR_SET_PDEATHSIG = 1  # prctl(2)


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


def end_with_parent(parent: int | None = None) -> None:
    """End this process once the parent (its id; the present one) is gone; to be called first."""
    expected = os.getppid() if parent is None else parent
    if os.getppid() != expected:
        os._exit(1)
    threading.Thread(target=_watch, args=(expected,), daemon=True, name="parent watch").start()


def ending_context() -> Any:
    """Return a context of `multiprocessing` whose processes end with this one."""
    context: Any = copy.copy(multiprocessing.get_context())
    process = context.Process
    # a fork server's children have the server as their parent, which ends with us
    parent = None if context.get_start_method() == "forkserver" else os.getpid()
    context.Process = lambda *, target, args=(), **options: process(
        target=_run_and_end, args=(parent, target, args), **options
    )
    return context


def start(
    command: Sequence[str],
    *,
    environment: Mapping[str, str] | None = None,
    output: int | None = None,
    errors: IO[bytes] | None = None,
) -> "subprocess.Popen[bytes]":
    """Start a foreign program, by its absolute path, that is killed when this process ends.

    To be called from a thread that lives as long as the program is to live: the kernel counts the
    end of the thread as the end of the parent. Environment, output and errors are this
    process's own by default; an output may be `subprocess.PIPE` or `DEVNULL`.
    """
    guard = [sys.executable, "-I", "-S", __file__, str(os.getpid())]
    return subprocess.Popen([*guard, *command], env=environment, stdout=output, stderr=errors)


def _run_and_end(parent: int | None, target: Callable[..., object], args: tuple[Any, ...]) -> None:
    end_with_parent(parent)
    target(*args)


def _watch(parent: int) -> None:
    while os.getppid() == parent:
        time.sleep(_POLL)
    os._exit(1)


def _become(parent: int, command: list[str]) -> None:
    """Execute a program that ends with the parent, guarded where the kernel cannot end it."""
    try:
        if sys.platform != "linux":
            sys.exit(_guard(parent, command))
        # The kernel kills this process, and the program that it becomes, with its parent.
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        if os.getppid() == parent:  # it may have ended before the kernel was asked
            os.execv(command[0], command)  # which the program inherits
        sys.exit(1)
    except OSError as fault:
        sys.exit(f"{command[0]} cannot be run: {fault.strerror}")


def _guard(parent: int, command: list[str]) -> int:
    child = subprocess.Popen(command)
    signal.signal(signal.SIGTERM, lambda *_: child.kill())
    while child.poll() is None:
        if os.getppid() != parent:
            child.kill()
        with contextlib.suppress(subprocess.TimeoutExpired):
            child.wait(_POLL)
    return child.returncode


if __name__ == "__main__":
    _become(int(sys.argv[1]), sys.argv[2:])

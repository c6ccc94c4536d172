"""Child processes that end with their parent, however it ends: SIGTERM, SIGKILL, closed terminal.

Python children watch who their parent is (`end_with_parent`). Foreign programs are started through
this file as a script (`start`): on Linux it asks the kernel to kill the program with its parent and
becomes the program; elsewhere it stays as a guard that ends the program.
"""

import contextlib
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
from typing import IO, Any

_POLL = 0.2  # s between looks at the parent
_PR_SET_PDEATHSIG = 1  # prctl(2)


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

"""How planning kernels are compiled and cached: the one place of this package that imports numba.

`entry_kernel` makes a kernel that Python calls; `kernel` one that only kernels call, without the
wrappers that Python would need (a seventh of the compile time), and inlined, as a call would pass
all fields of all arrays of its named tuples, some 200 words; `called_kernel` one that is too large
to be inlined everywhere. A kernel is compiled again in every entry kernel that leads to it, so
these are few. Nothing in a kernel allocates, so no references are counted: callers bring scratch
buffers.

numba's cache looks at a kernel's own file alone, but kernels call kernels of other files, so a
digest of every file that may hold one is part of the cache's version: after an edit to any of
them, everything is compiled anew.
"""

import contextlib
import hashlib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from numba.core import event

from meal_bayes.cache import compile_kernel

_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False}
_CALLED = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
_OBSERVATION = Path(__file__).parents[1] / "momdp" / "observation.py"
_DIGEST = hashlib.blake2b(digest_size=8)
for _path in (*sorted(Path(__file__).parent.rglob("*.py")), _OBSERVATION):
    _DIGEST.update(_path.read_bytes())


def entry_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that Python calls, when it is called first; later processes load it."""
    return _versioned(compile_kernel(function, **_OPTIONS))


def called_kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a large kernel that only kernels call."""
    return _versioned(compile_kernel(function, **_OPTIONS, **_CALLED))


def kernel(function: Callable[..., Any]) -> Callable[..., Any]:
    """Compile a kernel that only kernels call, and inline it there."""
    return _versioned(compile_kernel(function, **_OPTIONS, **_CALLED, forceinline=True))


def _versioned(compiled: Callable[..., Any]) -> Callable[..., Any]:
    held = getattr(getattr(compiled, "_cache", None), "_cache_file", None)
    if held is not None:  # None where nothing is cached
        held._version = f"{held._version} {_DIGEST.hexdigest()}"
    return compiled


class _Watch(event.Listener):  # type: ignore[misc]  # numba has no types
    def __init__(self, begin: Callable[[], None], end: Callable[[], None]) -> None:
        self._begin, self._end, self._depth = begin, end, 0

    def on_start(self, event: object) -> None:
        self._depth += 1
        if self._depth == 1:
            self._begin()

    def on_end(self, event: object) -> None:
        self._depth -= 1
        if self._depth == 0:
            self._end()


@contextlib.contextmanager
def watch_compilation(begin: Callable[[], None], end: Callable[[], None]) -> Iterator[None]:
    """Call `begin` and `end` around everything that is compiled meanwhile; not around loading."""
    with event.install_listener("numba:compile", _Watch(begin, end)):
        yield

"""Folders of compiled code: the user's own, closed to everybody else, or none at all.

What lies in such a folder is loaded and run. So a folder is used only where nobody else can have
written into it, or made it: it is the user's, has mode 0700, and is no link. Where there is no such
folder, programs work without, and compile anew each time.
"""

import atexit
import contextlib
import functools
import logging
import os
import shutil
import stat
import tempfile
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

log = logging.getLogger("meal_bayes.cache")

_WARNED = "MEAL_BAYES_CACHE_WARNED"  # set with the warning, so that workers do not repeat it


def cache_root() -> Path | None:
    """Return the folder of all compiled code, which need not be there; None without a home."""
    try:
        return user_cache_path("meal_bayes", appauthor=False).expanduser()
    except RuntimeError:
        return None


@functools.cache
def private_folder(name: str) -> Path | None:
    """Return the folder of one kind of compiled code, or None where none is safe and writable.

    The folder is `meal_bayes/NAME` in the system's cache folder (on Linux `$XDG_CACHE_HOME` or
    `~/.cache`). Why there is none is logged as a warning, once for a program and its workers.
    """
    root = cache_root()
    folder = None if root is None else root / name
    try:
        if folder is None:
            raise OSError("this user has no home folder")  # noqa: TRY301
        _prepare(folder)
    except OSError as fault:
        why = fault.strerror or fault
        if _WARNED not in os.environ:
            os.environ[_WARNED] = "1"
            log.warning(
                "no cache of compiled code: %s%s; compiling anew each time (set XDG_CACHE_HOME "
                "to a folder of your own)",
                "" if folder is None else f"{folder}: ",
                why,
            )
        return None
    return folder


@functools.cache
def scratch_folder(name: str) -> Path:
    """Return `private_folder(name)`, or where there is none a folder that goes with the process."""
    folder = private_folder(name)
    if folder is None:
        folder = Path(tempfile.mkdtemp(prefix=f"meal_bayes-{name}-"))
        atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder


@contextlib.contextmanager
def writable_caches() -> Iterator[None]:
    """Set a writable cache for libraries that are imported in the block and require one.

    Nothing changes where the user's cache folder can be written.
    """
    if private_folder("libraries") is not None:
        yield
        return
    scratch = str(scratch_folder("libraries"))
    before = os.environ.get("XDG_CACHE_HOME")
    os.environ.setdefault("MPLCONFIGDIR", scratch)
    os.environ["XDG_CACHE_HOME"] = scratch
    try:
        yield
    finally:
        del os.environ["XDG_CACHE_HOME"]
        if before is not None:
            os.environ["XDG_CACHE_HOME"] = before


def compile_kernel(function: Callable[..., Any], **options: object) -> Callable[..., Any]:
    """Compile a function by numba when it is called first; later processes load it.

    It is kept in `private_folder("numba")`, or where `NUMBA_CACHE_DIR` says; without either, each
    process compiles. What is there but torn is compiled again. Options are those of `numba.njit`.
    """
    from numba import config, njit  # noqa: PLC0415  loaded by those who compile

    # Numba reads this setting while it decorates, and each function keeps what it was then.
    configured = config.CACHE_DIR and str(Path(config.CACHE_DIR).expanduser())
    usable = configured and _writable(Path(configured))
    folder = configured if usable else private_folder("numba")
    config.CACHE_DIR = str(folder or "")
    try:
        kernel: Callable[..., Any] = njit(cache=folder is not None, **options)(function)
    finally:
        config.CACHE_DIR = configured
    if hasattr(getattr(kernel, "_cache", None), "_cache_file"):  # numba has no public way to it
        _guard(kernel)
    return kernel


def _guard(kernel: Any) -> None:
    """Let one program at a time compile a kernel, which others then load; forget torn files."""
    disk = kernel._cache
    load = disk.load_overload
    compile_signature = kernel.compile
    file = disk._cache_file._index_path
    held = threading.local()  # what each thread holds while it compiles

    def load_or_forget(*signature: Any) -> Any:
        """Load a compiled kernel; forget those of this function where a file is torn."""
        try:
            return load(*signature)
        except Exception as fault:  # whatever unpickling torn bytes may raise
            log.info("compiled code cannot be read (%s); compiling anew", fault)
            disk.flush()

    def load_once_compiled(*signature: Any) -> Any:
        """Load a compiled kernel; where there is none, hold the lock until it is compiled."""
        loaded = load_or_forget(*signature)
        if loaded is None:
            from filelock import FileLock  # noqa: PLC0415  loaded by those who compile

            # Without the lock two programs would compile the same, and numba could take the code
            # of one signature for that of another that was written at the same time.
            with contextlib.suppress(OSError, NotImplementedError):  # as on a disk without locks
                Path(file).parent.mkdir(parents=True, exist_ok=True)
                held.locks.enter_context(FileLock(f"{file}.lock"))
                loaded = load_or_forget(*signature)
        return loaded

    def compile_guarded(signature: Any) -> Any:
        with contextlib.ExitStack() as held.locks:
            return compile_signature(signature)

    disk.load_overload = load_once_compiled
    kernel.compile = compile_guarded


def _prepare(folder: Path) -> None:
    """Create a folder; raise an `OSError` where others can write into it, or the user cannot."""
    # From the outside in: a folder that others can write is refused before anything is in it.
    folder.parent.parent.mkdir(parents=True, exist_ok=True)
    for level in (folder.parent, folder):
        level.mkdir(mode=0o700, exist_ok=True)
        state = level.lstat()
        if not stat.S_ISDIR(state.st_mode):
            raise OSError(f"{level} is a link or a file, expected a folder")
        if os.name != "posix":  # the profile's permissions hold
            continue
        if state.st_uid != os.getuid():
            raise OSError(f"{level} belongs to another user ({state.st_uid})")
        if state.st_mode & (stat.S_IRWXG | stat.S_IRWXO):
            mode = stat.S_IMODE(state.st_mode)
            raise OSError(f"{level} is open to others (mode {mode:o}); remove it")
    if not _writable(folder):
        raise OSError(f"{folder} cannot be written")


def _writable(folder: Path) -> bool:
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False

"""Many pieces of work at once, by joblib: processes here, or whatever backend the caller set.

`with joblib.parallel_config("dask"): ...` sends the work to the workers of a Dask cluster.
"""

import contextlib
import functools
import logging
import os
import platform
import sys
import warnings
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import BrokenExecutor, CancelledError
from importlib import metadata
from pathlib import Path
from types import ModuleType
from typing import Any, TypeVar

import cloudpickle
from joblib import Parallel, delayed, effective_n_jobs, parallel_config
from joblib.parallel import get_active_backend

from meal_bayes.digests import code_digest
from meal_bayes.errors import SettingsError
from meal_bayes.processes import end_with_parent

Work = TypeVar("Work")
Result = TypeVar("Result")

_INSTALLED = {"site-packages", "dist-packages"}  # folders of pip's and of the system's
_LIBRARIES = ("numpy", "scipy", "numba", "scikit-learn")  # whose versions may change a number
_PYTHONS_LINE = warnings.formatwarning
_PATIENCE = 10  # s for a scheduler to answer


def in_parallel(
    function: Callable[[Work], Result],
    work: Iterable[Work],
    *,
    jobs: int = 1,
    on_done: Callable[[int], None] | None = None,
) -> Iterator[Result]:
    """Call a function on every piece of work; results come in any order.

    Each piece derives its random streams from its own coordinates, so neither the order nor the
    number of processes changes a result. The user's modules go to the workers by value. The
    processes, no more than there are pieces, end with this one, however it ends.

    Parameters
    ----------
    function : Callable[[Work], Result]
        Function of one piece.
    work : Iterable[Work]
        Pieces of work.
    jobs : int
        Number of processes. With 1 the work is done here, or as the caller's `parallel_config`
        says; Dask's backend uses all of its workers, whatever the number.
    on_done : Callable[[int], None] | None
        Called with the number of pieces that are done, from any thread.

    Raises
    ------
    SettingsError
        A process died, or a worker of a cluster has other versions of code than this process.
    """
    pieces = list(work)
    # One job is joblib's default, which a caller's `parallel_config` replaces.
    workers = min(effective_n_jobs(None if jobs == 1 else jobs), len(pieces))
    if workers <= 1:
        yield from map(function, pieces)
        return
    # Dask's backend returns all results at the end; the others yield them as they come.
    backend = get_active_backend()[0]
    form = "generator_unordered" if backend.supports_return_generator else "list"
    pool = _Counting(workers, batch_size=1, pre_dispatch="all", return_as=form)
    pool.on_done = on_done
    # Warnings look alike wherever the work is done.
    line = None if warnings.formatwarning is _PYTHONS_LINE else warnings.formatwarning
    here = functools.partial(_call, parent=os.getpid(), expected=environment(), line=line)
    call = delayed(here)
    try:
        yield from pool(map(call, _pickled(function, pieces)))
    except BrokenExecutor as fault:
        raise SettingsError(
            "A process died during its work (the system ends processes if memory is short). "
            "Finished work is kept: run the same command again with fewer jobs."
        ) from fault


class _Counting(Parallel):  # type: ignore[misc]  # joblib has no types
    """joblib's `Parallel`, which also tells a function how many pieces are done."""

    on_done: Callable[[int], None] | None = None

    def print_progress(self) -> None:
        if self.on_done is not None:
            self.on_done(self.n_completed_tasks)


@contextlib.contextmanager
def on_cluster(address: str | None) -> Iterator[None]:
    """Let the workers of a Dask scheduler do what the block runs; None changes nothing.

    A piece of work whose worker dies goes to another worker.
    """
    if address is None:
        yield
        return
    try:
        import dask.distributed  # noqa: PLC0415  an extra
    except ImportError as fault:
        raise SettingsError(
            "A cluster needs Dask: pip install 'meal-bayes[cluster]', here and on its machines."
        ) from fault
    distributed: Any = dask.distributed  # without types
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors are raised here
    try:
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError, TimeoutError) as fault:
        raise SettingsError(
            f"No Dask scheduler answers at {address}; start one with `dask scheduler --host "
            "127.0.0.1`, and its workers with `dask worker ADDRESS`."
        ) from fault
    try:
        cores = sum(client.ncores().values())
        if cores < 2:
            raise SettingsError(  # joblib makes no use of a single core
                f"The cluster at {address} has {cores} cores, expected 2 or more; start its "
                "workers first, with `dask worker ADDRESS`."
            )
        with parallel_config("dask", client=client):
            yield
    except (CancelledError, distributed.KilledWorker, TimeoutError) as fault:
        raise SettingsError(
            f"The cluster at {address} has ended, or its workers died ({fault}). Finished work "
            "is kept: start the cluster again, and then run the same command."
        ) from fault
    finally:
        with contextlib.suppress(TimeoutError, OSError):  # where the scheduler is gone
            client.close(timeout=1)


@functools.cache
def environment() -> dict[str, str]:
    """Return what may change a number beside settings: the package's code, and versions."""
    versions = {name: metadata.version(name) for name in _LIBRARIES}
    python = {"python": platform.python_version(), "system": sys.platform}
    return {"meal_bayes": code_digest(), **python, **versions}


def _pickled(function: Callable[[Work], Result], pieces: list[Work]) -> list[bytes]:
    """Pickle calls such that a process can make them which cannot import the user's modules."""
    modules = {module.__name__: module for module in [*sys.modules.values()] if _is_own(module)}
    with contextlib.ExitStack() as stack:
        for name in modules.keys() - cloudpickle.list_registry_pickle_by_value():
            cloudpickle.register_pickle_by_value(modules[name])
            stack.callback(cloudpickle.unregister_pickle_by_value, modules[name])
        return [cloudpickle.dumps((function, piece)) for piece in pieces]


def _is_own(module: ModuleType) -> bool:
    """Return whether a module is the user's: it has a file, and is neither installed nor ours."""
    file = getattr(module, "__file__", None)
    if file is None or module.__name__ not in sys.modules or _INSTALLED & {*Path(file).parts}:
        return False
    return module.__name__.partition(".")[0] not in {"meal_bayes", *sys.stdlib_module_names}


def _call(
    pickled: bytes,
    *,
    parent: int,
    expected: dict[str, str],
    line: Callable[..., str] | None,
) -> Any:
    """Make a pickled call in a worker, which has the same code and shows warnings by `line`."""
    warnings.formatwarning = line or warnings.formatwarning
    if os.getppid() == parent:  # a process here, not a worker of a cluster
        _watch_parent(parent)
    _check_code(expected)
    function, piece = cloudpickle.loads(pickled)
    return function(piece)


@functools.cache
def _watch_parent(parent: int) -> None:
    end_with_parent(parent)


def _check_code(expected: dict[str, str]) -> None:
    """Raise where this worker has not the code and the versions that are expected."""
    here = environment()
    differing = ", ".join(
        f"{name} {here[name]} (expected {version})"
        for name, version in expected.items()
        if here[name] != version
    )
    if differing:
        raise SettingsError(
            f"A worker on {platform.node()} has other code: {differing}; install the same "
            "versions on all machines of the cluster."
        )

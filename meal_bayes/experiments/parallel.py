"""Many tasks at once: processes of our own here (loky's), or the workers of a Dask cluster."""

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from typing import Any, TypeVar

from joblib.externals.loky import ProcessPoolExecutor

from meal_bayes.errors import SettingsError
from meal_bayes.processes import end_with_parent

Work = TypeVar("Work")
Result = TypeVar("Result")

_PATIENCE = "10s"  # for a scheduler to answer
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def in_parallel(
    function: Callable[[Work], Result],
    work: Iterable[Work],
    *,
    jobs: int,
    cluster: str | None = None,
) -> Iterator[Result]:
    """Call a function on every piece of work; results come as they are ready, in any order.

    Work derives its random streams from its own coordinates, so neither the order nor the number
    of processes changes a result. The processes end with this one, however it ends.

    Parameters
    ----------
    jobs : processes on this machine; no more are started than there are pieces of work.
    cluster : address of a Dask scheduler; then its workers do the work, and what a worker that dies
        had in hand goes to another.

    Raises
    ------
    SettingsError : a cluster without the extra that brings Dask, or one that does not answer.
    """
    pieces = list(work)
    if cluster is not None:
        yield from _on_cluster(function, pieces, cluster)
    elif min(jobs, len(pieces)) <= 1:
        yield from map(function, pieces)
    else:
        yield from _here(function, pieces, min(jobs, len(pieces)))


def _here(
    function: Callable[[Work], Result], pieces: Sequence[Work], jobs: int
) -> Iterator[Result]:
    threads = str(max(1, (os.cpu_count() or 1) // jobs))  # of libraries, in each process
    pool = ProcessPoolExecutor(
        jobs,
        initializer=end_with_parent,
        initargs=(os.getpid(),),
        env={name: threads for name in _THREADS if name not in os.environ},
    )
    whole = False
    try:
        futures = [pool.submit(function, piece) for piece in pieces]
        for future in as_completed(futures):
            yield future.result()
        whole = True
    finally:
        pool.shutdown(kill_workers=not whole)


def _on_cluster(
    function: Callable[[Work], Result], pieces: Sequence[Work], address: str
) -> Iterator[Result]:
    try:
        import dask.distributed  # noqa: PLC0415  an extra
    except ImportError as fault:
        raise SettingsError(
            "A cluster needs Dask: pip install 'meal-bayes[cluster]', here and on its machines."
        ) from fault
    distributed: Any = dask.distributed  # without types
    client = distributed.Client.__new__(distributed.Client)
    try:
        # As the default it would be Dask's scheduler for this whole process, and stay so when no
        # scheduler answers: saving a NetCDF file would then fail for want of a client.
        client.__init__(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as fault:
        # Left to the garbage collector, it would be closed at any time, also while the next client
        # starts, and then wait for ever for a lock that the same thread holds.
        client.close()
        raise SettingsError(
            f"No Dask scheduler answers at {address}; start one with `dask scheduler --host "
            "127.0.0.1`, and its workers with `dask worker ADDRESS`."
        ) from fault
    with client:
        futures = [client.submit(function, piece, pure=False, retries=3) for piece in pieces]
        for future in distributed.as_completed(futures, loop=client.loop):
            yield future.result()
            future.release()

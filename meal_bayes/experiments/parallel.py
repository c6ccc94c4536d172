"""Many tasks at once: joblib's processes here, or the workers of a Dask cluster."""

from collections.abc import Callable, Iterable, Iterator
from typing import Any, TypeVar

from joblib import Parallel, delayed

from meal_bayes.errors import SettingsError

Work = TypeVar("Work")
Result = TypeVar("Result")

_PATIENCE = "10s"  # for a scheduler to answer


def in_parallel(
    function: Callable[[Work], Result],
    work: Iterable[Work],
    *,
    jobs: int,
    cluster: str | None = None,
) -> Iterator[Result]:
    """Call a function on every piece of work; results come as they are ready, in any order.

    Work derives its random streams from its own coordinates, so neither the order nor the number
    of processes changes a result.

    Parameters
    ----------
    jobs : processes on this machine.
    cluster : address of a Dask scheduler; then its workers do the work, and what a worker that dies
        had in hand goes to another.

    Raises
    ------
    SettingsError : a cluster without the extra that brings Dask, or one that does not answer.
    """
    if cluster is not None:
        yield from _on_cluster(function, work, cluster)
        return
    if jobs == 1:
        yield from map(function, work)
        return
    pool = Parallel(n_jobs=jobs, return_as="generator_unordered")
    yield from pool(delayed(function)(piece) for piece in work)


def _on_cluster(
    function: Callable[[Work], Result], work: Iterable[Work], address: str
) -> Iterator[Result]:
    try:
        import dask.distributed  # noqa: PLC0415  an extra
    except ImportError as fault:
        raise SettingsError(
            "A cluster needs Dask: pip install 'meal-bayes[cluster]', here and on its machines."
        ) from fault
    distributed: Any = dask.distributed  # without types
    try:
        # As the default it would be Dask's scheduler for this whole process, and stay so when no
        # scheduler answers: saving a NetCDF file would then fail for want of a client.
        client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)
    except (OSError, ValueError) as fault:
        raise SettingsError(
            f"No Dask scheduler answers at {address}; start one with `dask scheduler --host "
            "127.0.0.1`, and its workers with `dask worker ADDRESS`."
        ) from fault
    with client:
        futures = [client.submit(function, piece, pure=False, retries=3) for piece in work]
        for future in distributed.as_completed(futures, loop=client.loop):
            yield future.result()
            future.release()

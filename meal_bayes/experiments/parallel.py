"""Many tasks at once: processes of our own here (loky's), or the workers of a Dask cluster."""

import asyncio
import contextlib
import logging
import os
import platform
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, CancelledError, Executor, wait
from typing import Any, TypeVar

import cloudpickle
from joblib.externals.loky import ProcessPoolExecutor

from meal_bayes.errors import SettingsError
from meal_bayes.experiments.store import environment, own_modules
from meal_bayes.processes import end_with_parent

Work = TypeVar("Work")
Result = TypeVar("Result")

_PATIENCE = 10.0  # s for a scheduler to answer
_LOOK = 1.0  # s between calls of `meanwhile`
_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")


def in_parallel(
    function: Callable[[Work], Result],
    work: Iterable[Work],
    *,
    jobs: int,
    cluster: str | None = None,
    meanwhile: Callable[[], None] = lambda: None,
) -> Iterator[Result]:
    """Call a function on every piece of work; results come as they are ready, in any order.

    Work derives its random streams from its own coordinates, so no order changes a result. Code
    that is neither installed nor this package's goes with it, by value. The processes, no more than
    pieces of work, end with this one, however it ends; `meanwhile` is called every second.

    With the address of a Dask scheduler as `cluster` its workers do the work, if they have
    the same code; what a worker that dies had in hand goes to another.
    """
    pieces = list(work)
    jobs = min(jobs, len(pieces))
    if not pieces or (cluster is None and jobs <= 1):
        yield from map(function, pieces)
        return
    calls = _pickled(function, pieces)
    if cluster is None:
        yield from _here(calls, jobs, meanwhile)
    else:
        yield from _on_cluster(calls, cluster, meanwhile)


def _finished(
    pool: Executor, call: Callable[[bytes], Any], calls: list[bytes], look: Callable[[], None]
) -> Iterator[Any]:
    """Yield what calls return as they end, and look every second."""
    running = {pool.submit(call, pickled) for pickled in calls}
    while running:
        ended, running = wait(running, timeout=_LOOK, return_when=FIRST_COMPLETED)
        yield from (future.result() for future in ended)
        look()


def _pickled(function: Callable[[Work], Result], pieces: list[Work]) -> list[bytes]:
    """Return calls as bytes that a process can make which has none of the user's modules."""
    # Code that a worker cannot import travels by value: registered for this pickle alone.
    modules = {module.__name__: module for module in own_modules()}
    with contextlib.ExitStack() as stack:
        for name in modules.keys() - cloudpickle.list_registry_pickle_by_value():
            cloudpickle.register_pickle_by_value(modules[name])
            stack.callback(cloudpickle.unregister_pickle_by_value, modules[name])
        return [cloudpickle.dumps((function, piece)) for piece in pieces]


def _call(pickled: bytes) -> Any:
    function, piece = cloudpickle.loads(pickled)
    return function(piece)


def _here(calls: list[bytes], jobs: int, meanwhile: Callable[[], None]) -> Iterator[Any]:
    threads = str(max(1, (os.cpu_count() or 1) // jobs))  # of libraries, in each process
    pool = ProcessPoolExecutor(
        jobs,
        initializer=end_with_parent,
        initargs=(os.getpid(),),
        env={name: threads for name in _THREADS if name not in os.environ},
    )
    # Workers that still run when the generator is left are killed, or the program would wait.
    whole = False
    try:
        yield from _finished(pool, _call, calls, meanwhile)
        whole = True
    finally:
        pool.shutdown(kill_workers=not whole)


def _on_cluster(calls: list[bytes], address: str, meanwhile: Callable[[], None]) -> Iterator[Any]:
    try:
        import dask.distributed  # noqa: PLC0415  an extra
    except ImportError as fault:
        raise SettingsError(
            "A cluster needs Dask: pip install 'meal-bayes[cluster]', here and on its machines."
        ) from fault
    distributed: Any = dask.distributed  # without types

    async def answer() -> None:
        async with distributed.rpc(address) as scheduler:
            await asyncio.wait_for(scheduler.identity(), _PATIENCE)

    try:
        asyncio.run(answer())  # a client would wait for ever for one that is silent
    except (OSError, ValueError, TimeoutError) as fault:
        raise SettingsError(
            f"No Dask scheduler answers at {address}; start one with `dask scheduler --host "
            "127.0.0.1`, and its workers with `dask worker ADDRESS`."
        ) from fault
    logging.getLogger("distributed.client").setLevel(logging.CRITICAL)  # errors are raised here
    # As the default it would be Dask's scheduler for this whole process.
    client = distributed.Client(address, timeout=_PATIENCE, set_as_default=False)

    def checked(call: bytes) -> tuple[str, dict[str, str], Any]:
        """Make a call where the code is that of `expected`; it goes by value, as it is nested."""
        try:
            from meal_bayes.experiments.store import environment as of_worker  # noqa: PLC0415

            versions = of_worker()
        except ImportError as fault:
            return platform.node(), {"meal_bayes": str(fault)}, None
        function, piece = cloudpickle.loads(call) if versions == expected else (id, None)
        return platform.node(), versions, function(piece)

    def look() -> None:
        meanwhile()
        try:
            client.sync(client.scheduler.identity, callback_timeout=_PATIENCE)
        except (TimeoutError, OSError) as fault:
            raise CancelledError from fault

    expected = environment()
    pool = client.get_executor(pure=False, retries=3)
    try:
        for machine, versions, result in _finished(pool, checked, calls, look):
            if versions != expected:
                raise _other_code(machine, versions, expected)
            yield result
    except CancelledError as fault:
        raise SettingsError(
            f"The Dask scheduler at {address} has ended or does not answer; start it again, and "
            "then the same command: what is finished is not run again."
        ) from fault
    finally:
        with contextlib.suppress(TimeoutError, OSError):  # where the scheduler is gone
            client.close(timeout=1)


def _other_code(machine: str, versions: dict[str, str], expected: dict[str, str]) -> SettingsError:
    """Return the error that names what a worker has in other versions than this process."""
    differing = ", ".join(
        f"{name} {versions.get(name, 'missing')} (here {expected.get(name, 'missing')})"
        for name in expected | versions
        if versions.get(name) != expected.get(name)
    )
    return SettingsError(
        f"A worker on {machine} has other code: {differing}; "
        "install the same versions on all machines of the cluster."
    )

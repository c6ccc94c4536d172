"""Many tasks at once: joblib's processes here."""

from collections.abc import Callable, Iterable, Iterator
from typing import TypeVar

from joblib import Parallel, delayed

Work = TypeVar("Work")
Result = TypeVar("Result")


def in_parallel(
    function: Callable[[Work], Result], work: Iterable[Work], *, jobs: int
) -> Iterator[Result]:
    """Call a function on every piece of work; results come as they are ready, in any order.

    Work derives its random streams from its own coordinates, so neither the order nor the number
    of processes changes a result.
    """
    if jobs == 1:
        yield from map(function, work)
        return
    pool = Parallel(n_jobs=jobs, return_as="generator_unordered")
    yield from pool(delayed(function)(piece) for piece in work)

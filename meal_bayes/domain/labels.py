"""One label, and the labels of a group, which are one value."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import label_values
from meal_bayes.errors import DataError, QueryError

PRIOR_OBJECTS = 1.0  # of each value, beside those that are labeled, in every base rate (Laplace)


def label_of(name: str, value: object) -> int:
    """Return one label as 1, 0, or -1; a `DataError` that names what it is of, if it is none."""
    try:
        label = label_values(value)
        return int(label)
    except TypeError:
        raise DataError(f"{name}: Found {value!r:.60}; expected one label.") from None
    except DataError as fault:
        raise DataError(f"{name}: {fault}") from None


def one_value(labels: NDArray[np.int8], group: str, members: Sequence[str]) -> NDArray[np.int8]:
    """Return what labels (K,) of a group's members say of each of them.

    Raises
    ------
    QueryError
        Two are true, or none can be.
    """
    true = np.flatnonzero(labels == 1)
    possible = np.flatnonzero(labels != 0)
    if len(true) > 1 or not len(possible):
        values = " and ".join(members[i] for i in true.tolist()) or "none"
        raise QueryError(f"{values} of {group!r} ({', '.join(members)}); exactly one is true")
    value = true if len(true) else possible
    if len(value) > 1:
        return labels
    return np.asarray(np.arange(len(members)) == value, np.int8)

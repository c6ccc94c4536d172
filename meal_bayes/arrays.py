"""Read-only arrays: every array field of a public type goes through `freeze` at birth."""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray


def freeze(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """Copy into a contiguous array that cannot be written to; one that is frozen is not copied.

    >>> frozen = freeze([1, 2])
    >>> frozen.flags.writeable, freeze(frozen) is frozen
    (False, True)
    """
    if type(values) is np.ndarray and values.dtype == dtype:
        flags = values.flags
        if flags.owndata and flags.c_contiguous and not flags.writeable:
            return values
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def set_frozen(instance: object, **fields: Any) -> None:
    """Set fields of a frozen dataclass inside its own `__post_init__`."""
    for name, value in fields.items():
        object.__setattr__(instance, name, value)

"""The one check of features, whoever gives them: a robot, a data frame, an array, or a file."""

import math
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.errors import DataError


def checked_features(
    values: ArrayLike, axes: tuple[str, ...] = ("features",), *, absent: bool = False
) -> NDArray[np.float32]:
    """Copy features to single precision: real and finite numbers, at least one a recording.

    NumPy alone would read "4_0" as 40, and drop masks and imaginary parts.

    Parameters
    ----------
    values : ArrayLike
        (D,) of one recording, or (..., D) of several.
    axes : tuple[str, ...]
        The names of the axes that are expected.
    absent : bool
        Whether all features of a recording may be NaN: it is absent.

    Returns
    -------
    NDArray[np.float32]
        A copy, in the shape of the values.

    Raises
    ------
    DataError
        What was found instead; callers say of what.

    Examples
    --------
    >>> checked_features([1, 2.5])
    array([1. , 2.5], dtype=float32)
    >>> checked_features(["4_0"])
    Traceback (most recent call last):
    meal_bayes.errors.DataError: found text; expected real numbers
    """
    features = _real(values)
    expected = f"expected ({', '.join(axes)})"
    if features.ndim != len(axes):
        raise DataError(f"found shape {features.shape}; {expected}")
    if not features.shape[-1] and math.prod(features.shape[:-1]):
        raise DataError(f"found shape {features.shape}; {expected}, at least one feature")
    valid = np.isfinite(features).all(axis=-1)
    if absent:
        valid |= np.isnan(features).all(axis=-1)
    if not valid.all():
        index = np.argwhere(~valid)[0] + 1
        row = "".join(f", {axis[:-1]} {number}" for axis, number in zip(axes, index, strict=False))
        raise DataError(f"found NaN or infinity{row}; expected finite numbers")
    return features


def _real(values: Any) -> NDArray[np.float32]:
    """Copy real numbers to single precision, to infinity where they are too large for it."""
    try:
        masked = np.ma.is_masked(values)
        array = np.asarray(values)
        if array.dtype == object and all(isinstance(value, Real) for value in array.flat):
            array = array.astype(np.float64)
    except Exception as fault:  # whatever an object raises that is to become an array
        raise DataError(f"found no array of numbers ({fault})") from fault
    if masked:
        raise DataError("found masked values; expected real numbers")
    if array.dtype.kind not in "biuf":
        name = {"U": "text", "S": "bytes", "c": "complex numbers"}.get(array.dtype.kind, "objects")
        raise DataError(f"found {name}; expected real numbers")
    with np.errstate(over="ignore"):
        return array.astype(np.float32)

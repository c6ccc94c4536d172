"""The one check of features, whoever gives them: a robot, a data frame, an array, or a file.

A column that numbers or dates the rows says nothing about an object, but where objects were
recorded in the order of their labels a classifier learns the labels from it. So such a column is
refused by its name, and one that only grows or only falls with the rows is named in a warning.
"""

import math
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from decimal import Decimal
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.errors import DataError
from meal_bayes.look import listed, warn_user

# Words that alone name a number or a time of a row,
_COUNTERS = frozenset({
    "at", "attempt", "clock", "counter", "cycle", "date", "datetime", "elapsed", "episode",
    "epoch", "file", "filename", "frame", "frames", "guid", "hour", "id", "ids", "idx", "index",
    "indices", "instance", "iter", "iteration", "ix", "loop", "minute", "month", "nanosec",
    "nanosecs", "no", "nr", "nsec", "nsecs", "num", "number", "object", "order", "record",
    "recording", "records", "rep", "repeat", "repetition", "rosbagtimestamp", "row", "rownames",
    "rownum", "rows", "run", "sample", "sec", "secs", "seq", "sequence", "serial", "session",
    "snapshot", "stamp", "step", "tick", "ticks", "time", "timestamp", "timestamps", "timestep",
    "trial", "ts", "uid", "unnamed", "uuid", "weekday", "year",
})  # fmt: skip
# and words that stand beside one of them.
_BESIDE = frozenset({
    "arrival", "bag", "batch", "begin", "cam", "camera", "capture", "captured", "chunk", "clip",
    "code", "count", "counter", "created", "current", "data", "dataset", "day", "end",
    "execution", "experiment", "field", "file", "first", "from", "global", "gmt", "hash",
    "header", "image", "img", "in", "iso", "item", "key", "last", "level", "line", "local", "log",
    "logged", "measurement", "message", "micros", "millis", "modified", "monotonic", "ms", "msec",
    "msg", "name", "names", "nanos", "ns", "obs", "observation", "of", "old", "order", "original",
    "pandas", "participant", "position", "posix", "pub", "publish", "python", "receive",
    "received", "record", "recorded", "robot", "ros", "rosbag", "s", "second", "seconds",
    "sensor", "sim", "since", "sort", "sorted", "stamps", "start", "stop", "subject", "sys",
    "system", "table", "task", "the", "unix", "updated", "us", "usec", "user", "utc", "video",
    "wall",
})  # fmt: skip
_EXACT = re.compile(r"(level|key)_\d+|[ti#]|\s*")  # of pandas, and without a name
_WORD = re.compile(r"[A-Z]+(?![a-z])|[A-Z]?[a-z]+")  # also of camelCase
_CHANCE = 1e-3  # that columns without an order are named by mistake, in all of a modality


def numbers_rows(name: object) -> bool:
    """Return whether a column is called as one that numbers or dates rows.

    >>> [name for name in ("Unnamed: 0", "frame_id", "headerStamp.secs") if numbers_rows(name)]
    ['Unnamed: 0', 'frame_id', 'headerStamp.secs']
    >>> [name for name in ("contact_time", "sound_level", "f0", 3) if numbers_rows(name)]
    []
    """
    if isinstance(name, tuple):  # of several levels of columns
        return numbers_rows(" ".join(map(str, name)))
    if not isinstance(name, str):
        return False
    words = [word.casefold() for word in _WORD.findall(name)]
    # "frameid" is two words, too.
    parts = [part for word in words for part in _split(word)]
    counts = any(part in _COUNTERS for part in parts)
    known = all(part in _COUNTERS or part in _BESIDE for part in parts)
    return bool(_EXACT.fullmatch(name)) or (counts and known and name.isascii())


def _split(word: str) -> Sequence[str]:
    """Return the two known words that a word is made of, or the word."""
    if word in _COUNTERS or word in _BESIDE:
        return (word,)
    known = _COUNTERS | _BESIDE
    for end in range(2, len(word) - 1):
        if word[:end] in known and word[end:] in known:
            return word[:end], word[end:]
    return (word,)


def check_columns(names: Iterable[object]) -> None:
    """Refuse columns of features that number or date rows, by their names, or share a name.

    >>> check_columns(["force", "frame_id"])
    Traceback (most recent call last):
    meal_bayes.errors.DataError: found the column 'frame_id', which by its name numbers or dates \
the rows and measures no object; drop it, or rename it if it is a measurement
    """
    names = list(names)
    # Numbers are positions, which joined frames may share.
    texts = Counter(name for name in names if isinstance(name, str) and name)
    if doubled := [name for name, count in texts.items() if count > 1]:
        raise DataError(f"found two columns {doubled[0]!r}; expected each name once; rename one")
    found = [repr(name) for name in names if numbers_rows(name)]
    if found:
        columns = "columns" if len(found) > 1 else "column"
        raise DataError(
            f"found the {columns} {listed(found)}, which by its name numbers or dates the rows and "
            "measures no object; drop it, or rename it if it is a measurement"
        )


def column_names(values: Any) -> Sequence[object] | None:
    """Return the names of columns, or of one row's cells, where features have names."""
    for attribute in ("column_names", "columns"):  # of pyarrow; of pandas and polars
        names = getattr(values, attribute, None)
        if names is not None and not callable(names):
            return list(names)
    if isinstance(values, Mapping):
        return list(values)
    index = getattr(values, "index", None)  # a row of a pandas frame
    names = getattr(index, "tolist", None)
    return names() if callable(names) else None


def warn_of_order(
    what: str,
    values: NDArray[Any],
    objects: ArrayLike,
    names: Sequence[object] | None = None,
) -> bool:
    """Warn of columns (n,D) that only grow, or only fall, with the rows or in each object.

    Returns whether there are such.

    Rows of one object that stand together are permuted as a block and within it; a column is named
    where an order as it has is that improbable by chance (at most 1 in 1000 for all columns).
    """
    n, d = values.shape
    if n < 4:
        return False
    _, codes = np.unique(np.asarray(objects, dtype=str), return_inverse=True)
    starts = np.flatnonzero(np.diff(codes, prepend=-1))
    rises = np.diff(values, axis=0)
    inside = np.ones(n - 1, np.bool_)
    inside[starts[1:] - 1] = False
    # Of distinct numbers an order is least probable; mostly even that is probable enough.
    distinct = np.arange(n)
    least = [_chance_of_order(distinct, starts, whole=whole) for whole in (False, True)]
    named = list[str]()
    for sign, verb in ((1, "grows"), (-1, "falls")):
        up = sign * rises >= 0
        # A constant column is in any order.
        for column in np.flatnonzero(up[inside].all(axis=0) & rises.any(axis=0)):
            whole = bool(up[:, column].all())
            if d * least[whole] >= _CHANCE:
                continue
            chance = _chance_of_order(values[:, column], starts, whole=whole)
            if d * chance < _CHANCE:
                name = f"{column + 1} of {d}" if names is None else repr(names[int(column)])
                where = "the rows" if whole else "the rows of each object"
                named.append(f"{name} only {verb} with {where}")
    if named:
        warn_user(
            f"{what}: column {'; '.join(named[:5])}{'; ...' if len(named) > 5 else ''}, as a row "
            "number or a clock does. Leave it out unless it measures the object."
        )
    return bool(named)


def _chance_of_order(values: NDArray[Any], starts: NDArray[np.intp], *, whole: bool) -> float:
    """Compute how probable it is that blocks of values are in order by chance, up or down."""
    blocks = np.split(values, starts[1:])
    log_chance = sum(map(_log_chance, blocks))
    if whole:
        log_chance += _log_chance(np.array([block.mean() for block in blocks]))
    return 2 * math.exp(log_chance)


def _log_chance(values: NDArray[Any]) -> float:
    """Compute the log probability that shuffled values, some perhaps equal, come out ascending."""
    _, counts = np.unique(values, return_counts=True)
    return sum(math.lgamma(m + 1) for m in counts.tolist()) - math.lgamma(len(values) + 1)


def checked_features(
    values: ArrayLike, axes: tuple[str, ...] = ("features",), *, absent: bool = False
) -> NDArray[np.float32]:
    """Check features and copy them to single precision.

    Features must be real and finite numbers, at least one for each recording. (NumPy alone would
    read "4_0" as 40, and drop masks and imaginary parts.) If columns have names, as in a data
    frame, columns whose names suggest an index or a date are rejected.

    Parameters
    ----------
    values : ArrayLike
        (D,) features of one recording, or (..., D) of several recordings.
    axes : tuple[str, ...]
        Names of the expected axes.
    absent : bool
        Whether a recording may consist of NaN only, which means that it is absent.

    Returns
    -------
    NDArray[np.float32]
        Copy with the shape of the values.

    Raises
    ------
    DataError
        The features are not valid. The message says what was found; callers add the context.

    Examples
    --------
    >>> checked_features([1, 2.5])
    array([1. , 2.5], dtype=float32)
    >>> checked_features(["4_0"])
    Traceback (most recent call last):
    meal_bayes.errors.DataError: found text; expected real numbers
    """
    check_columns(column_names(values) or ())
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
        if array.dtype == object and all(isinstance(value, Real | Decimal) for value in array.flat):
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

"""The one pickle of the public data, read by a loader that accepts numbers and nothing else."""

import io
import pickle
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import DataError

INT64_BYTES = 8
SCALAR_NAMES = (  # before NumPy 2 and since
    ("numpy.core.multiarray", "scalar"),
    ("numpy._core.multiarray", "scalar"),
)


class _Int64:
    """Stand-in for NumPy's little-endian 64-bit integer type."""

    __slots__ = ()

    def __setstate__(self, state: object) -> None:
        if not isinstance(state, tuple) or state[1:2] not in (("<",), (b"<",)):
            raise pickle.UnpicklingError(f"the number type {state!r}")


class _MakeType:
    """Stand-in for `numpy.dtype`."""

    __slots__ = ()

    def __call__(self, name: object, *_: object) -> _Int64:
        if name not in ("i8", b"i8"):
            raise pickle.UnpicklingError(f"the number type {name!r}")
        return _Int64()


class _MakeNumber:
    """Stand-in for `numpy.core.multiarray.scalar`."""

    __slots__ = ()

    def __call__(self, dtype: object, data: object) -> int:
        raw = data.encode("latin-1") if isinstance(data, str) else data
        if not isinstance(dtype, _Int64) or not isinstance(raw, bytes) or len(raw) != INT64_BYTES:
            raise pickle.UnpicklingError(f"the number {data!r} of type {dtype!r}")
        return int.from_bytes(raw, "little", signed=True)


class _NumbersOnly(pickle.Unpickler):
    """Unpickler of three names, each replaced by a stand-in without attributes."""

    def find_class(self, module: str, name: str) -> Any:
        if (module, name) == ("numpy", "dtype"):
            return _MakeType()
        if (module, name) in SCALAR_NAMES:
            return _MakeNumber()
        raise pickle.UnpicklingError(f"the name {module}.{name}")

    def persistent_load(self, pid: object) -> Any:
        raise pickle.UnpicklingError(f"the outside reference {pid!r}")


def read_label_pickle(path: Path, objects: int, words: int) -> NDArray[np.int8]:
    """Read {0: [0 or 1, ...], ...} into an array (objects, words).

    Raises
    ------
    DataError : a pickle that names anything but NumPy's numbers, or holds another table.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DataError(f"{path}: cannot be read ({error.strerror}); restore it.") from error
    try:
        table = _NumbersOnly(io.BytesIO(data), encoding="latin1").load()
    except Exception as error:  # hostile bytes make the loader fail in any way
        raise DataError(
            f"{path}: found {' '.join(str(error).split())[:200]}; expected a pickle of NumPy "
            "integers and nothing else; do not trust the file, fetch it anew (`meal-bayes data`)."
        ) from error
    if not isinstance(table, dict) or set(table) != set(range(objects)):
        raise DataError(
            f"{path}: found no table with the keys 0 to {objects - 1}; expected one row of labels "
            "an object; fetch the file anew."
        )
    for key in range(objects):
        row = table[key]
        if not isinstance(row, list) or len(row) != words or any(v not in (0, 1) for v in row):
            raise DataError(
                f"{path}: found other than {words} labels 0 or 1 in row {key}; "
                "fetch the file anew, and the words (test_full.csv) with it."
            )
    return np.array([table[key] for key in range(objects)], dtype=np.int8)

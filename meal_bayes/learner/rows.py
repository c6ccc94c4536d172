"""Arrays that grow at their end, at constant cost."""

from typing import Any

import numpy as np
from numpy.typing import NDArray


class Rows:
    """An array that grows at its end.

    Parameters
    ----------
    dtype : type
        Of its entries.
    width : int
        Further axes.
    """

    def __init__(self, dtype: type, *width: int) -> None:
        self._held: NDArray[Any] = np.empty((8, *width), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def values(self) -> NDArray[Any]:
        """The rows so far, (n, ...)."""
        return self._held[: self._count]

    def extend(self, rows: Any) -> None:
        """Append rows (m, ...)."""
        needed = self._count + len(rows)
        if needed > len(self._held):
            larger = np.empty(
                (max(needed, 2 * len(self._held)), *self._held.shape[1:]), self._held.dtype
            )
            larger[: self._count] = self.values
            self._held = larger
        self._held[self._count : needed] = rows
        self._count = needed

    def append(self, row: Any) -> int:
        """Append a row, and return its number."""
        self.extend(np.asarray(row, self._held.dtype)[None])
        return self._count - 1

"""Rows of features with their keys: read strictly from files, and joined to the arrays of a domain.

Cells are split by the standard library's `csv` and read by NumPy. (pandas' reader of text took six
times as long for ISPY32's 4,096 columns, and fills rows that are too short without a word.)
"""

import csv
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import product
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import unknown
from meal_bayes.errors import DataError
from meal_bayes.untrusted import read_bytes

_NUMBER = re.compile(
    r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.ASCII | re.IGNORECASE
)
_LARGEST = float(np.finfo(np.float32).max)
Context = tuple[str, str]  # behavior, modality


class FeatureRows(NamedTuple):
    """Rows of one context: values (n,D), their keys (object, recording), and where they stand.

    The source is a file, or what else the rows stand in; a place is such as "line 3".
    """

    source: str
    places: Sequence[str]
    keys: Sequence[tuple[str, ...]]
    values: NDArray[np.floating]

    def fault(self, row: int, found: str, expected: str, repair: str) -> DataError:
        """Return the error of one row."""
        return fault(f"{self.source}, {self.places[row]}", found, expected, repair)


def fault(where: str, found: str, expected: str, repair: str) -> DataError:
    """Return an error: what was found, what was expected, and how to repair it."""
    return DataError(f"{where}: found {found}; expected {expected}; {repair}.")


def read_text(path: Path) -> str:
    """Read a UTF-8 file; a `DataError` where it is absent, empty, too large, or no text."""
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        beside, repair = "it beside the others of its data set", "put it there, or check the names"
        raise fault(str(path), "no such file", beside, repair) from None
    except OSError as error:
        raise DataError(
            f"{path}: cannot be read ({error.strerror}); check its permissions."
        ) from error
    except ValueError as error:
        raise DataError(f"{path}: {error}; expected a text file of its data set.") from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        found = f"the byte 0x{data[error.start]:02x}, which is not UTF-8"
        raise fault(f"{path}, line {line}", found, "UTF-8 text", "save the file as UTF-8") from None
    if not text.strip():
        expected = "rows of comma-separated values"
        raise fault(f"{path}, line 1", "an empty file", expected, "restore it")
    return text


def read_rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the place, such as "line 1", and the stripped cells of every row that is not empty."""
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        if not line.strip():
            continue
        try:
            cells = next(csv.reader([line.strip()], strict=True))
        except csv.Error:  # an open quote, or 200,000 signs: one cell, which the caller refuses
            cells = [line]
        yield f"line {number}", [cell.strip() for cell in cells]


def read_features(path: Path, key_columns: Sequence[str], *, header: bool = False) -> FeatureRows:
    """Read `key, ..., number, ...` rows; every row must be as long as the first.

    A row of another length, a cell that is no finite number, a header that does not begin with the
    key columns, no rows, or bytes that are not UTF-8 are a `DataError`.
    """
    count, width = len(key_columns), 0
    places, keys, values = list[str](), list[tuple[str, ...]](), list[list[float]]()
    for place, cells in read_rows(path):
        where = f"{path}, {place}"
        if header and not width:
            width = len(cells)
            if cells[:count] != list(key_columns) or width <= count:
                expected = f"{','.join(key_columns)},<feature>,..."
                repair = "write it so (commas, not semicolons)"
                raise fault(where, f"the header {','.join(cells)[:60]!r}", expected, repair)
            continue
        width = width or max(len(cells), count + 1)
        if len(cells) != width:
            side = "short" if len(cells) < width else "long"
            found = f"a row of {len(cells)} columns (too {side})"
            expected = f"{width} ({', '.join(key_columns)} and the features, separated by commas)"
            raise fault(where, found, expected, "restore or remove the row")
        places.append(place)
        keys.append(tuple(cells[:count]))
        values.append(_numbers(where, cells, count))
    if not values:
        expected = "a row a recording"
        raise fault(f"{path}, line 1", "no rows under the header", expected, "add the rows")
    return FeatureRows(str(path), places, keys, np.array(values))


def _numbers(where: str, cells: list[str], first: int) -> list[float]:
    """Read finite numbers from a column on; unlike `float`, refuse 3_4 and digits of others."""
    for column, cell in enumerate(cells[first:], start=first + 1):
        if not _NUMBER.fullmatch(cell):
            repair = "write one, with a point for decimals"
            raise fault(where, f"{cell[:40]!r} in column {column}", "a number", repair)
        if not abs(float(cell)) <= _LARGEST:  # NaN compares as false
            found, expected = f"{float(cell)} in column {column}", "a finite number"
            repair = "measure again, or remove the recording of all objects"
            raise fault(where, found, f"{expected} (single precision)", repair)
    return list(map(float, cells[first:]))


def join_features(
    objects: Sequence[str],
    contexts: Iterable[tuple[Context, FeatureRows]],
    recordings: int | None = None,
) -> dict[Context, NDArray[np.float32]]:
    """Sort rows by their keys (object, recording) into (O,R,D), NaN where an object has fewer.

    Rows of one behavior must be of the same recordings. Every object must have so many
    `recordings`, named from 1; by default what the first context of a behavior has, 2 before 10. An
    unknown object or recording, one that comes twice or is missing is a `DataError`.
    """
    place = {name: o for o, name in enumerate(objects)}
    by_behavior: dict[str, list[Context]] = {}  # what each one's first context holds, in order
    tables: dict[Context, tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating]]] = {}
    for context, rows in contexts:
        row_of = _row_of(rows, place)
        order = by_behavior.get(context[0])
        if order is None:
            numbers = [str(k) for k in range(1, (recordings or 0) + 1)]
            every = product(objects, numbers) if numbers else row_of
            order = sorted(every, key=lambda key: (place[key[0]], len(key[1]), key[1]))
            by_behavior[context[0]] = order
        for key in sorted(row_of.keys() - set(order), key=row_of.__getitem__):
            known = [recording for name, recording in order if name == key[0]]
            expected = f"one of {', '.join(known) or 'none'}"
            repair = "correct the number or remove the row"
            raise rows.fault(row_of[key], f"recording {key[1]!r} of {key[0]}", expected, repair)
        for name, recording in order:
            if (name, recording) not in row_of:
                last = f"{rows.places[-1]} (its last)" if rows.places else "without rows"
                raise DataError(
                    f"{rows.source}, {last}: found no row of recording {recording} of {name}; "
                    f"expected {[known for known, _ in order].count(name)} of it, as in the other "
                    "features of this behavior; add the row, or remove the recording from all."
                )
        o = np.array([place[name] for name, _ in order], np.int64)
        r = np.arange(len(o)) - np.searchsorted(o, o)
        tables[context] = o, r, rows.values[[row_of[key] for key in order]]
    most = max((int(r.max(initial=-1)) + 1 for _, r, _ in tables.values()), default=0)
    joined = {}
    for context, (o, r, values) in tables.items():
        joined[context] = np.full((len(objects), most, values.shape[1]), np.nan, np.float32)
        joined[context][o, r] = values
    return joined


def _row_of(rows: FeatureRows, objects: Mapping[str, int]) -> dict[Context, int]:
    """Return the row of each (object, recording)."""
    row_of: dict[tuple[str, str], int] = {}
    for row, (name, recording) in enumerate(rows.keys):
        if name not in objects:
            hint = unknown("object", name, objects).removesuffix(".")
            expected = "an object of the list"
            raise rows.fault(row, f"object {name!r}", expected, f"correct it ({hint})")
        if (name, recording) in row_of:
            before = rows.places[row_of[name, recording]]
            found = f"recording {recording} of {name} again, after {before}"
            raise rows.fault(row, found, "each recording once", "remove one of the rows")
        row_of[name, recording] = row
    return row_of

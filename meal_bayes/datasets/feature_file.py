"""Feature files: keys and numbers separated by commas, read strictly."""

import contextlib
import csv
import logging
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError
from meal_bayes.untrusted import read_bytes

log = logging.getLogger("meal_bayes.datasets")

_NUMBER = re.compile(
    r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.ASCII | re.IGNORECASE
)
LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True, slots=True)
class FeatureRows:
    """The rows of one file, in file order.

    Attributes
    ----------
    lines : (n,) line numbers, from 1.
    keys : (n,) the leading columns.
    values : (n,D) finite, also in single precision.
    """

    path: Path
    lines: tuple[int, ...]
    keys: tuple[tuple[str, ...], ...]
    values: NDArray[np.float64]


def bad_line(path: Path, line: int, found: str, expected: str, repair: str) -> DataError:
    """Return the error of one line: what was found, what was expected, and how to repair it."""
    return DataError(f"{path}, line {line}: found {found}; expected {expected}; {repair}.")


def read_text(path: Path) -> str:
    """Read a UTF-8 file.

    Raises
    ------
    DataError : it is absent, empty, too large, or no text.
    """
    try:
        data = read_bytes(path)
    except FileNotFoundError:
        raise DataError(
            f"{path}: found no such file; expected it beside the others of its data set; "
            "put it there, or check the folder's name and the domain's modalities."
        ) from None
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
        raise bad_line(path, line, found, "UTF-8 text", "save the file as UTF-8") from None
    if not text.strip():
        raise bad_line(path, 1, "an empty file", "rows of comma-separated values", "restore it")
    return text


def split_line(line: str) -> list[str]:
    """Split one line at its commas; quoted cells may hold commas."""
    if '"' not in line:
        return line.split(",")
    try:
        return next(csv.reader([line], strict=True))
    except csv.Error:  # an open quote, or 200,000 signs: one cell, which the caller refuses
        return [line]


def read_rows(path: Path) -> Iterator[tuple[int, list[str]]]:
    """Yield the number, from 1, and the stripped cells of every line of a file that is not empty.

    Raises
    ------
    DataError : as of `read_text`.
    """
    text = read_text(path)
    if not text.endswith("\n"):
        log.info("read the last row of %s, which no newline ends", path.name)
    for number, raw in enumerate(text.split("\n"), start=1):
        if line := raw.strip():
            yield number, [cell.strip() for cell in split_line(line)]


def read_features(path: Path, key_columns: Sequence[str], *, header: bool = False) -> FeatureRows:
    """Read `key, ..., number, ...` rows; every row must be as long as the first.

    Raises
    ------
    DataError : a row too short or too long, a cell that is no finite number, a header that does
        not begin with the key columns, no rows, bytes that are not UTF-8.
    """
    count, width = len(key_columns), 0
    lines, keys, values = list[int](), list[tuple[str, ...]](), list[list[float]]()
    for number, cells in read_rows(path):
        if header and not width:
            _check_header(path, number, cells, key_columns)
            width = len(cells)
            continue
        width = width or max(len(cells), count + 1)
        if len(cells) != width:
            side = "short" if len(cells) < width else "long"
            found = f"a row of {len(cells)} columns (too {side})"
            expected = f"{width} ({', '.join(key_columns)} and the features, separated by commas)"
            raise bad_line(path, number, found, expected, "restore or remove the row")
        values.append(_numbers(path, number, cells, count))
        lines.append(number)
        keys.append(tuple(cells[:count]))
    if not values:
        raise bad_line(path, 1, "no rows under the header", "a row a recording", "add the rows")
    array = np.array(values)
    finite = np.abs(array) <= LARGEST  # NaN compares as false
    if not finite.all():
        row, column = (int(at) for at in np.argwhere(~finite)[0])
        found = f"{array[row, column]} in column {column + count + 1}"
        repair = "measure again, or remove the recording of all objects"
        raise bad_line(path, lines[row], found, "a finite number (single precision)", repair)
    return FeatureRows(path, tuple(lines), tuple(keys), array)


def read_contexts(
    domain: Domain, folder: Path, name: str, key_columns: Sequence[str], *, header: bool = False
) -> Iterator[tuple[tuple[str, str], FeatureRows]]:
    """Yield (behavior, modality) and rows of the feature file of each context of a domain.

    Parameters
    ----------
    name : of a file, such as "{}_{}.csv", for behavior and modality.
    key_columns, header : as of `read_features`.
    """
    for behavior in domain.behaviors:
        for modality in behavior.modalities:
            path = folder / name.format(behavior.name, modality)
            yield (behavior.name, modality), read_features(path, key_columns, header=header)


def check_labeled(domain: Domain, words: Collection[str], name: str) -> None:
    """Raise a `DataError` where a data set has no labels of an attribute of the domain."""
    for attribute in domain.attributes:
        if attribute not in words:
            raise DataError(f"{name} has no labels of it. {unknown('word', attribute, words)}")


def join_features(
    rows: FeatureRows,
    keys: Sequence[tuple[str, str]],
    recordings: Mapping[str, Sequence[str]],
) -> NDArray[np.float32]:
    """Sort rows by their keys (object, recording) into (O,R,D), NaN where an object has fewer.

    Parameters
    ----------
    rows : of one file.
    keys : (n,) object and recording of each row.
    recordings : object -> the recordings that it must have, in order.

    Raises
    ------
    DataError : an unknown object or recording, one that comes twice, one that is missing.
    """
    found = _row_of(rows, keys, recordings)
    most = max(map(len, recordings.values()))
    joined = np.full((len(recordings), most, rows.values.shape[1]), np.nan, np.float32)
    for index, (name, own) in enumerate(recordings.items()):
        for place, recording in enumerate(own):
            if (name, recording) not in found:
                raise DataError(
                    f"{rows.path}, line {rows.lines[-1]} (its last): found no row of recording "
                    f"{recording} of {name}; expected {len(own)} of it, as in the other files of "
                    "this behavior; add the row, or remove the recording from all of them."
                )
            joined[index, place] = rows.values[found[name, recording]]
    return joined


def _row_of(
    rows: FeatureRows, keys: Sequence[tuple[str, str]], recordings: Mapping[str, Sequence[str]]
) -> dict[tuple[str, str], int]:
    """Return the row of each (object, recording)."""
    found: dict[tuple[str, str], int] = {}
    for row, (line, key) in enumerate(zip(rows.lines, keys, strict=True)):
        name, recording = key
        if name not in recordings:
            text = f"object {name!r}"
            hint = unknown("object", name, recordings).removesuffix(".")
            raise bad_line(rows.path, line, text, "an object of the list", f"correct it ({hint})")
        if recording not in recordings[name]:
            expected = f"one of {', '.join(recordings[name]) or 'none'}"
            text = f"recording {recording!r} of {name}"
            raise bad_line(rows.path, line, text, expected, "correct the number or remove the row")
        if key in found:
            before = rows.lines[found[key]]
            text = f"recording {recording} of {name} again, after line {before}"
            raise bad_line(rows.path, line, text, "each recording once", "remove one of the rows")
        found[key] = row
    return found


def _numbers(path: Path, line: int, cells: list[str], first: int) -> list[float]:
    """Read ASCII numbers from a column on; unlike `float`, refuse 3_4."""
    text = "".join(cells[first:])
    if "_" not in text and text.isascii():
        with contextlib.suppress(ValueError):
            return list(map(float, cells[first:]))
    column = next(i for i in range(first, len(cells)) if not _NUMBER.fullmatch(cells[i]))
    found = f"{cells[column][:40]!r} in column {column + 1}"
    raise bad_line(path, line, found, "a number", "write one, with a point for decimals")


def _check_header(path: Path, line: int, cells: list[str], key_columns: Sequence[str]) -> None:
    names = [cell.strip() for cell in cells]
    if names[: len(key_columns)] != list(key_columns) or len(names) <= len(key_columns):
        shape = ",".join(key_columns)
        found = f"the header {','.join(names)[:60]!r}"
        repair = "write it so (commas, not semicolons)"
        raise bad_line(path, line, found, f"{shape},<feature>,...", repair)

"""Files of comma-separated values, read strictly, and a folder of them with one's own data.

Cells are split by the standard library's `csv` and read by `float`. (pandas' reader of text took
longer for ISPY32's 4,096 columns, and fills rows that are too short without a word.)
"""

import csv
import logging
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_checks import check_columns
from meal_bayes.datasets.frames import (
    KEYS,
    Context,
    FeatureRows,
    add_once,
    fault,
    join_features,
    labeled,
)
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, OutputError, QueryError
from meal_bayes.files import checked_path, write_whole
from meal_bayes.look import listed, warn_user
from meal_bayes.untrusted import name_fault, read_bytes

log = logging.getLogger("meal_bayes.datasets")

_LINE_END = re.compile(r"\r\n|\r|\n")
_SEPARATORS = {";": "semicolons", "\t": "tabs", "|": "bars"}  # of other programs
_LABELS = "labels.csv"
_WORDS = {"1": 1, "0": 0, "true": 1, "false": 0}  # of labels, in any case
_VALUES = {**_WORDS, "1.0": 1, "0.0": 0, "": -1}  # pandas' too
_NUMBER = re.compile(
    r"[+-]?((\d+\.?\d*|\.\d+)(e[+-]?\d+)?|nan|inf(inity)?)", re.ASCII | re.IGNORECASE
)
_LARGEST = float(np.finfo(np.float32).max)


def load_csv_folder(domain: Domain, folder: Path) -> Dataset:
    """Read `labels.csv` and one `<behavior>_<modality>.csv` for each context of the domain.

    `labels.csv` has the header ``object,<attribute>,...`` and a row for each object: 1 true, 0
    false, empty unknown. A column of a group, in place of its attributes, holds the one that is
    true. A feature file has the header ``object,recording,<feature>,...`` and a row a recording;
    the files of one behavior are joined by (object, recording) and hold the same rows. An object
    may lack a behavior, or have another number of recordings of it than others. The first line that
    is wrong is a `DataError` with its file, number, and how to repair it.
    """
    files = _files(domain, folder)
    _check_names(domain, folder, [path.name for path in files.values()])
    objects, labels = read_labels(folder / _LABELS, domain)
    contexts = ((c, read_features(path, KEYS, header=True)) for c, path in files.items())
    features = join_features(objects, contexts)
    dataset = Dataset(domain, objects, features, labels, rows_checked=True)
    log.info(
        "%s: read %d objects, up to %d recordings each", folder, len(objects), dataset.recordings
    )
    return dataset


def save_csv_folder(dataset: Dataset, folder: str | Path, *, overwrite: bool = False) -> None:
    """Write a data set as a folder of CSV files.

    `load_dataset` reads exactly the same numbers from the files. `labels.csv` is written last, so a
    folder with this file is complete. Another person's answers (`Dataset.answers`) are not written;
    a warning says so.

    Parameters
    ----------
    dataset : Dataset
        Recordings and labels.
    folder : str or Path
        Folder to write. Missing folders are made.
    overwrite : bool
        Whether to replace files of recordings that are already in the folder.

    Raises
    ------
    OutputError
        The folder holds labels or recordings already, or cannot be written.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> from tempfile import TemporaryDirectory
    >>> from meal_bayes.datasets import make_synthetic
    >>> rng = np.random.default_rng(0)
    >>> data = make_synthetic(meal_bayes.load_domain("toy"), objects=4, recordings=2, rng=rng)
    >>> with TemporaryDirectory() as folder:
    ...     meal_bayes.save_csv_folder(data, folder)
    ...     again = meal_bayes.load_dataset("toy", root=folder)
    >>> again.objects == data.objects
    True
    """
    import pandas as pd  # noqa: PLC0415  takes half a second

    folder = checked_path("The folder", folder)
    files = _files(dataset.domain, folder)
    there = [path for path in csv_files(dataset.domain, folder) if os.path.lexists(path)]
    if there and not overwrite:
        raise OutputError(
            f"{there[0]} exists already, and recordings are not replaced; give another folder, or "
            "say overwrite=True."
        )
    if there:  # old labels beside a part of the new recordings would be a complete data set
        (folder / _LABELS).unlink(missing_ok=True)
    objects = np.array(dataset.objects)
    for context, path in files.items():
        values = dataset.features[context]
        counts = dataset.recording_counts[:, dataset.domain.behavior_index(context[0])]
        # Recordings that an object has; rows of NaN behind them are not written.
        o, r = np.nonzero(np.arange(values.shape[1]) < counts[:, None])
        names = [f"f{i}" for i in range(values.shape[2])]
        index = pd.MultiIndex.from_arrays([objects[o], r + 1], names=KEYS)
        frame = pd.DataFrame(values[o, r], index, names)
        text = frame.to_csv(float_format="%.9g", lineterminator="\n")
        write_whole(path, text)
    labels = pd.DataFrame(
        dataset.labels, pd.Index(objects, name="object"), dataset.domain.attributes
    )
    text = labels.astype("Int8").where(labels >= 0).to_csv(lineterminator="\n")
    write_whole(folder / _LABELS, text)
    if dataset.answers is not None:
        warn_user(f"{folder} holds no answers of another person; save Dataset.answers yourself.")


def csv_files(domain: Domain, folder: Path) -> list[Path]:
    """Name the files of a folder that `load_csv_folder` reads: others do not count."""
    return [folder / _LABELS, *_files(domain, folder).values()]


def _files(domain: Domain, folder: Path) -> dict[Context, Path]:
    """Name the file of each context; a `DataError` where two would be one, or none in the folder.

    Case plays no part, as on some systems it names no other file.
    """
    files: dict[str, object] = {_LABELS: "the labels"}
    for context in domain.contexts:
        name = _file_of(context)
        if name != Path(name).name or "\\" in name:
            raise DataError(f"{name!r} is not a valid file name; rename the behavior or modality.")
        other = files.setdefault(name.casefold(), context)
        if other != context:
            raise DataError(
                f"{other} and {context} have the same file, {name}; rename a behavior or modality."
            )
    return {context: folder / _file_of(context) for context in domain.contexts}


def _file_of(context: Context) -> str:
    return "{}_{}.csv".format(*context)


def _check_names(domain: Domain, folder: Path, contexts: Sequence[str]) -> None:
    """Refuse a folder that lacks a file and holds one that is of no context: it is misnamed."""
    expected = [_LABELS, *contexts]
    missing = [name for name in expected if not (folder / name).is_file()]
    strangers = sorted(path.name for path in folder.glob("*.csv") if path.name not in expected)
    if missing and strangers:
        raise DataError(
            f"{folder / missing[0]}: the file is missing, and {listed(strangers)} belongs to no "
            f"behavior and modality of {domain.name}; rename it, or add the missing file."
        )
    if strangers:
        reason = f"{domain.name} has no such behavior and modality"
        log.warning("%s: not read, as %s: %s", folder, reason, listed(strangers))


def read_labels(path: Path, domain: Domain) -> tuple[tuple[str, ...], NDArray[np.int8]]:
    """Read a `labels.csv`: names of the objects (O,), and labels (O,P), 1, 0, or -1 unknown."""
    (where, header), *rows = read_rows(path)
    if header[0] != "object":
        expected = f"object,{','.join(domain.attributes[:3])},..."
        content = f"the header {header[0][:40]!r}"
        raise fault(where, content, expected, _write_so(header))
    names = [name for name in (*domain.attributes, *domain.groups) if name in header[1:]]
    present = labeled(domain, names)
    for name in (*domain.attributes, *domain.groups):
        count = header[1:].count(name)  # the first cell names the objects, and may name one, too
        if count > 1 or (name in domain.attributes and name not in present):
            if count > 1:
                raise fault(where, f"{count} columns {name!r}", "one", "rename or remove one")
            hint = unknown("column", name, header[1:]).removesuffix(".")
            raise fault(where, f"{count} columns {name!r}", "one", f"add or rename one ({hint})")
    for name in header[1:]:
        if name not in names:
            hint = unknown("attribute", name, (*domain.attributes, *domain.groups)).removesuffix(
                "."
            )
            raise fault(where, f"a column {name!r}", "attributes and groups", f"remove it ({hint})")
    labels: dict[str, NDArray[np.int8]] = {}
    for where, cells in rows:
        if len(cells) != len(header):
            expected = f"{len(header)} as in the header"
            repair = "leave unknown values empty: a,1,,0"
            raise fault(where, f"{len(cells)} columns", expected, repair)
        if bad := name_fault(cells[0]):
            name = f"an object's name that {bad}"
            raise fault(where, name, "a name", "name it, or remove the row")
        row: dict[str, Any] = {}
        for column, cell in enumerate(cells[1:], start=1):
            members = domain.groups.get(header[column], ())
            if cell.casefold() not in _VALUES and not members:
                value = f"{cell!r} in column {column + 1} ({header[column]})"
                raise fault(where, value, f"{', '.join(_WORDS)} or nothing", "write one of them")
            text = next((t for t in (cell, cell.removesuffix(".0")) if t in members), None)
            row[header[column]] = text or _VALUES.get(cell.casefold(), cell)
        try:
            values = domain.labels({name: row[name] for name in names})
        except QueryError as error:
            message = str(error).removesuffix(".")
            raise fault(where, message, "one value of each group", "correct the row") from None
        add_once(labels, where, cells[0], values)
    if not labels:
        raise fault(where, "no rows under the header", "a row for each object", "add the rows")
    return tuple(labels), np.array(list(labels.values()), dtype=np.int8)


def _write_so(header: Sequence[str]) -> str:
    """Return how to repair a header that is not as expected, by what its cells hold."""
    separators = [
        name for sign, name in _SEPARATORS.items() if any(sign in cell for cell in header)
    ]
    return f"separate columns by commas, not {separators[0]}" if separators else "write it so"


def read_text(path: Path) -> str:
    """Read a UTF-8 file; a `DataError` where it is absent, empty, too large, or no text."""
    try:
        data = read_bytes(path)
    except (OSError, ValueError) as error:
        raise DataError(
            f"{path}: cannot be read ({getattr(error, 'strerror', error)}); expected it as text "
            "beside the others of its data set; check name, permissions and content."
        ) from error
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        content = f"the byte 0x{data[error.start]:02x}, which is not UTF-8"
        where = f"{path}, line {line}"
        raise fault(where, content, "UTF-8 text", "save the file as UTF-8") from None
    if not text.strip():
        expected = "rows of comma-separated values"
        raise fault(f"{path}, line 1", "an empty file", expected, "restore it")
    return text


def read_rows(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Yield the place, "FILE, line 1", and the stripped cells of every row that is not empty.

    Lines end as on any system: by a line feed, a carriage return, or both.
    """
    for number, line in enumerate(_LINE_END.split(read_text(path)), start=1):
        if not line.strip():
            continue
        try:
            cells = next(csv.reader([line.strip()], strict=True))
        except csv.Error:  # an open quote, or 200,000 signs: one cell, which the caller refuses
            cells = [line]
        yield f"{path}, line {number}", list(map(str.strip, cells))


def read_features(path: Path, key_columns: Sequence[str], *, header: bool = False) -> FeatureRows:
    """Read `key, ..., number, ...` rows; every row must be as long as the first.

    A row of another length, a cell that is no finite number, a header that does not begin with the
    key columns or names a column that numbers or dates the rows, no rows, or bytes that are not
    UTF-8 are a `DataError`. Where there is a header, a row without a number (its cells are empty,
    or "nan") says that the recording lacks this modality.
    """
    lines = read_rows(path)
    count = len(key_columns)
    width = 0
    rows = []
    columns: list[str] | None = None
    if header:
        where, cells = next(lines)
        width = len(cells)
        if cells[:count] != list(key_columns) or width <= count:
            expected = f"{','.join(key_columns)},<feature>,..."
            content = f"the header {','.join(cells)[:60]!r}"
            raise fault(where, content, expected, _write_so(cells))
        columns = cells[count:]
        try:
            check_columns(columns)
        except DataError as error:
            raise DataError(f"{where}: {error}.") from None
    for where, cells in lines:
        width = width or max(len(cells), count + 1)
        if len(cells) != width:
            side = "short" if len(cells) < width else "long"
            content = f"a row of {len(cells)} columns (too {side})"
            expected = f"{width} ({', '.join(key_columns)} and the features, separated by commas)"
            raise fault(where, content, expected, "restore or remove the row")
        lacks = header and {cell.casefold() for cell in cells[count:]} <= {"", "nan"}
        values = [np.nan] * (width - count) if lacks else _numbers(where, cells, count)
        rows.append((where, tuple(cells[:count]), values))
    if not rows:
        expected = "a row for each recording"
        raise fault(f"{path}, line 1", "no rows under the header", expected, "add the rows")
    places, keys, numbers = zip(*rows, strict=True)
    return FeatureRows(str(path), places, keys, np.array(numbers), columns)


def _numbers(where: str, cells: list[str], first: int) -> list[float]:
    """Read finite numbers from a column on; unlike `float`, refuse 3_4 and digits of others."""
    values = [np.inf]
    text = "".join(cells[first:])
    with suppress(ValueError):
        values = list(map(float, cells[first:]))
    # One sum decides for the whole row, as ISPY32 has 4,096 columns: where it is finite and in
    # range, so is each value. Only a row that fails is looked at cell by cell, for the message.
    if sum(map(abs, values)) <= _LARGEST and text.isascii() and "_" not in text:
        return values
    for column, cell in enumerate(cells[first:], start=first + 1):
        if not _NUMBER.fullmatch(cell):
            repair = "write one, with a point for decimals"
            raise fault(where, f"{cell[:40]!r} in column {column}", "a number", repair)
        if not abs(float(cell)) <= _LARGEST:
            content = f"{float(cell)} in column {column}"
            expected = "a finite number"
            repair = "measure again, or remove this recording from the behavior's files"
            raise fault(where, content, f"{expected} (single precision)", repair)
    return values

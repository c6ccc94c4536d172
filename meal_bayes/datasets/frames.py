"""Rows of features with their keys, joined to the arrays of a domain; frames, dictionaries, arrays.

What `Dataset.from_frames` takes becomes rows here; those of files come from `csv_files`.
"""

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.feature_checks import (
    checked_features,
    warn_of_order,
)
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError, QueryError
from meal_bayes.look import listed, warn_user

Context = tuple[str, str]  # behavior, modality
KEYS = ("object", "recording")  # that name a row of features
_OBJECT = "an object", "its name", "name it"  # what a cell is, as `_text_at` says it
_RECORDING = "a recording", "its number", "number it"
_EXACT = 2**53  # floats below it are whole numbers exactly
_Parts = tuple[tuple[str, ...], dict[Context, NDArray[np.float32]], NDArray[np.int8]]


class FeatureRows(NamedTuple):
    """Rows of one context: values (n,D), their keys (object, recording), and where they stand.

    The source is a file, or what else the rows stand in; a place is such as "FILE, line 3". A row
    of NaN alone says that the recording lacks this modality. Columns may have names.
    """

    source: str
    places: Sequence[str]
    keys: Sequence[tuple[str, ...]]
    values: NDArray[np.floating]
    columns: Sequence[object] | None = None


def fault(where: str, content: str, expected: str, repair: str) -> DataError:
    """Return an error: what was found, what was expected, and how to repair it."""
    return DataError(f"{where}: found {content}; expected {expected}; {repair}.")


def add_once(table: dict[str, Any], where: str, name: str, value: object) -> None:
    """Enter what a row says of an object; a `DataError` where another row says it already."""
    if name in table:
        again = f"object {name!r} again"
        raise fault(where, again, "each object once", "remove one of the rows")
    table[name] = value


def dataset_parts(
    domain: Domain, features: Mapping[Context, Any], labels: Any, objects: Sequence[str] | None
) -> _Parts:
    """Return objects (O,), features {context: (O,R,D)} and labels (O,P); see `from_frames`."""
    names, values = _labels(domain, labels, objects)
    for context in features:
        if context not in domain.contexts:
            raise DataError(unknown("context", str(context), map(str, domain.contexts)))
    rows = [(c, _rows(features[c], names, c)) for c in domain.contexts if c in features]
    if not any(len(table.keys) for _, table in rows):
        raise DataError("No object has a recording; give features of at least one.")
    return names, join_features(names, rows), values


def _rows(values: Any, objects: Sequence[str], context: Context) -> FeatureRows:
    """Return the rows of one context, whatever form they have."""
    source = f"the features of {context}"
    if is_frame(values):
        frame = _with_keys(pandas_frame(values, source), source)
        places = _places(source, len(frame))
        keys = [
            (_text_at(place, name, _OBJECT), _text_at(place, recording, _RECORDING))
            for place, name, recording in zip(
                places, frame["object"], frame["recording"], strict=True
            )
        ]
        of_key = [name in KEYS or (isinstance(name, tuple) and name[0] in KEYS) for name in frame]
        table = frame.loc[:, ~np.array(of_key, bool)]
        return FeatureRows(source, places, keys, _columns(table, source), list(table.columns))
    if not isinstance(values, Mapping):
        if len(values) != len(objects):
            raise DataError(
                f"{source}: found those of {len(values)} objects; expected {len(objects)}, in "
                "the order of `objects`."
            )
        values = dict(zip(objects, values, strict=True))
    named = {
        name: pandas_frame(rows, f"{source} of {name}") if is_frame(rows) else rows
        for name, rows in _named_once(values, source).items()
    }
    columns = next((list(rows.columns) for rows in named.values() if _has_names(rows)), None)
    by_object = {
        name: _numbers(_in_order(rows, columns, f"{source} of {name}"), f"{source} of {name}")
        for name, rows in named.items()
    }
    keys = [(name, str(r)) for name, rows in by_object.items() for r in range(1, len(rows) + 1)]
    sizes = {rows.shape[1] for rows in by_object.values() if len(rows)}
    if len(sizes) > 1:
        raise DataError(f"{source}: found recordings of {sorted(sizes)} features; give one size.")
    table = np.concatenate([np.empty((0, *(sizes or {1}))), *filter(len, by_object.values())])
    return FeatureRows(source, _places(source, len(keys)), keys, table, columns)


def _has_names(rows: Any) -> bool:
    """Return whether columns of one object's rows have names that count."""
    return is_frame(rows) and len(rows) > 0


def _in_order(rows: Any, columns: Sequence[object] | None, source: str) -> Any:
    """Return one object's rows with the columns of the first object's, in the same order."""
    if columns is None or not _has_names(rows) or list(rows.columns) == columns:
        return rows
    if set(rows.columns) != set(columns) or len(rows.columns) != len(columns):
        found, expected = (listed([*map(str, names)]) for names in (rows.columns, columns))
        raise DataError(
            f"{source}: found the columns {found}; expected {expected}, as of the first object; "
            "name them alike."
        )
    return rows[columns]


def is_frame(values: object) -> bool:
    """Return whether a value is a table with named columns, of pandas or of another package."""
    return not isinstance(values, Mapping) and any(
        hasattr(type(values), name) for name in ("columns", "column_names", "__dataframe__")
    )


def pandas_frame(values: Any, source: str) -> Any:
    """Return a data frame of polars, pyarrow, or another package as one of pandas.

    A `DataError` names the kind of frame where it cannot be converted.
    """
    import pandas as pd  # noqa: PLC0415  takes half a second

    kind = f"{type(values).__module__}.{type(values).__qualname__}"
    try:
        if not isinstance(values, pd.DataFrame) and hasattr(values, "collect"):
            values = values.collect()  # a query of polars that was not run yet
        if not isinstance(values, pd.DataFrame) and hasattr(values, "compute"):
            values = values.compute()  # the same of Dask
        with suppress(ImportError):  # polars converts by pyarrow, which may be missing
            if not isinstance(values, pd.DataFrame) and hasattr(values, "to_pandas"):
                values = values.to_pandas()
        if not isinstance(values, pd.DataFrame):
            values = pd.api.interchange.from_dataframe(values)
    except Exception as fault:  # whatever another package raises
        why = " ".join(str(fault).split())[:200]
        raise DataError(
            f"{source}: found a {kind}, which does not become a pandas frame ({why}); convert it "
            "with its own to_pandas()."
        ) from fault
    return values


def _places(source: str, count: int) -> list[str]:
    return [f"{source}, row {n}" for n in range(1, count + 1)]


def _with_keys(values: Any, source: str) -> Any:
    """Return a frame with the columns "object" and "recording", of its index where it has them."""
    doubled = values.columns[values.columns.duplicated()]
    if len(doubled):
        raise DataError(f"{source}: found two columns {doubled[0]!r}; rename one.")
    in_index = [key for key in KEYS if key in values.index.names and key not in values.columns]
    frame = (values.reset_index(level=in_index) if in_index else values).reset_index(drop=True)
    if "object" not in frame.columns:
        raise DataError(f"{source}: found a frame without a column 'object'; add one.")
    if "recording" not in frame.columns:
        frame = frame.assign(recording=frame.groupby("object", observed=True).cumcount() + 1)
    return frame


def _text_at(place: str, cell: object, words: tuple[str, str, str]) -> str:
    """Return a cell's name or number as text; a `DataError` where it is empty or none.

    Whole numbers are written as their digits, also where a gap in a column made them floats. The
    words say as what the cell stands there, what is expected, and how to repair it.
    """
    if isinstance(cell, np.generic):
        cell = cell.item()
    if isinstance(cell, float) and cell.is_integer():
        cell = int(cell)
    if isinstance(cell, bool) or not isinstance(cell, str | int):
        role, expected, repair = words
        raise fault(place, f"{cell!r:.60} as {role}", expected, f"{repair} or remove the row")
    return str(cell)


def _named_once(rows: Mapping[Any, Any], source: str) -> dict[str, Any]:
    """Return a mapping by objects' names as text; a `DataError` where two keys are one name."""
    named = dict[str, Any]()
    for key, value in rows.items():
        add_once(named, source, _text_at(source, key, _OBJECT), value)
    return named


def _columns(table: Any, source: str) -> NDArray[np.float32]:
    """Return the numbers of a frame (n,D); a fault names the first column that has one alone."""
    # pandas' own kinds of numbers, which may lack some: beside others they were objects.
    from pandas.api.types import is_extension_array_dtype, is_numeric_dtype  # noqa: PLC0415

    kinds = dict(table.dtypes)
    own = [n for n, kind in kinds.items() if is_extension_array_dtype(kind)]
    table = table.astype({name: float for name in own if is_numeric_dtype(kinds[name])})
    try:
        return _numbers(table, source)
    except DataError:
        for column, name in enumerate(table.columns):
            _numbers(table.iloc[:, [column]], f"{source}, column {name!r}")
        raise


def _numbers(rows: Any, source: str) -> NDArray[np.float32]:
    try:
        return checked_features(rows, ("recordings", "features"), absent=True)
    except DataError as fault:
        raise DataError(f"{source}: {fault}.") from None


def _labels(
    domain: Domain, labels: Any, objects: Sequence[str] | None
) -> tuple[tuple[str, ...], NDArray[np.int8]]:
    """Return the objects (O,) and the labels (O,P) in the domain's order."""
    if is_frame(labels):
        labels = pandas_frame(labels, "Labels")
        # An attribute may be called "object", where the index names the objects.
        counted = type(labels.index).__name__ == "RangeIndex"
        named = counted or "object" not in (*domain.attributes, *domain.groups)
        in_column = named and "object" in labels.columns
        frame = labels.set_index("object") if in_column else labels
        columns = [name for name in (*domain.attributes, *domain.groups) if name in frame.columns]
        for attribute in domain.attributes:
            if attribute not in labeled(domain, columns):
                raise DataError(f"Labels: {unknown('column', attribute, map(str, frame.columns))}")
        if frame.index.has_duplicates:
            raise DataError("An object has two rows of labels; give each one.")
        cells = frame[list(dict.fromkeys(columns))].astype(object)
        rows = (dict(row) for _, row in cells.iterrows())
        values = _named_once(dict(zip(frame.index, rows, strict=True)), "Labels")
    elif isinstance(labels, Mapping):
        values = {name: dict(row) for name, row in _named_once(labels, "Labels").items()}
    else:
        if objects is None or np.shape(labels) != (len(objects), len(domain.attributes)):
            raise DataError(
                f"Labels have shape {np.shape(labels)}; an array needs objects=[names] and the "
                f"shape (objects, {len(domain.attributes)})."
            )
        rows = (dict(zip(domain.attributes, row, strict=True)) for row in labels)
        values = dict(zip(objects, rows, strict=True))
    names = tuple(values) if objects is None else tuple(objects)
    if strangers := [name for name in values if name not in names]:
        warn_user(
            f"Labels of {listed(strangers)} are left out, because `objects` does not name "
            f"{'it' if len(strangers) == 1 else 'them'}."
        )
    table = np.full((len(names), len(domain.attributes)), -1, np.int8)
    for index, name in enumerate(names):
        try:
            table[index] = domain.labels(values.get(name, {}))
        except (DataError, QueryError) as fault:
            raise DataError(f"Labels of {name!r}: {fault}") from None
    return names, table


def labeled(domain: Domain, columns: Iterable[str]) -> set[str]:
    """Return the attributes of which some columns, of attributes and groups, hold labels."""
    return {member for name in columns for member in (name, *domain.groups.get(name, ()))}


def join_features(
    objects: Sequence[str],
    contexts: Iterable[tuple[Context, FeatureRows]],
    recordings: int | None = None,
) -> dict[Context, NDArray[np.float32]]:
    """Sort rows by their keys (object, recording) into (O,R,D), NaN where an object has fewer.

    A recording that lacks a modality, by a row of NaN, is left out of all of its behavior, with a
    warning where another modality has it. Columns are checked by `features.py`.

    A number of a recording is whole, 0 or more, and the same however it is written: 1, 01, 1.0 (a
    name in its place is read as it is).
    Rows of one behavior must be of the same recordings. Every object must have so many
    `recordings`, named from 1; by default what the first context of a behavior has, 2 before 10. An
    unknown object or recording, one that comes twice or is missing is a `DataError`.
    """
    index = {name: o for o, name in enumerate(objects)}
    by_behavior: dict[str, list[Context]] = {}  # what each one's first context holds, in order
    tables: dict[Context, tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.floating]]] = {}
    named = [(context, rows, _row_of(rows, index)) for context, rows in contexts]
    lacking = {} if recordings else _without_a_modality(named)
    for context, rows, all_rows in named:
        if not recordings:  # public recordings were looked at, and are pinned
            warn_of_order(f"Features of {context}", *_of_objects(rows), rows.columns)
        left_out = lacking.get(context[0], ())
        row_of = {key: row for key, row in all_rows.items() if key not in left_out}
        keys = product(objects, map(str, range(1, recordings + 1))) if recordings else row_of
        # By object, then number: of texts without leading zeros a shorter one is less.
        natural = sorted(keys, key=lambda key: (index[key[0]], len(key[1]), key[1]))
        order = by_behavior.setdefault(context[0], natural)
        for key in sorted(row_of.keys() - set(order), key=row_of.__getitem__):
            numbers = [recording for name, recording in order if name == key[0]]
            content = f"recording {key[1]!r} of {key[0]}"
            where = rows.places[row_of[key]]
            expected = f"one of {', '.join(numbers) or 'none'}"
            raise fault(where, content, expected, "correct the number or remove the row")
        for name, recording in order:
            if (name, recording) not in row_of:
                empty = f"{rows.source}, without rows"
                last = f"{rows.places[-1]} (its last)" if rows.places else empty
                raise DataError(
                    f"{last}: found no row of recording {recording} of {name}; "
                    f"expected {[other for other, _ in order].count(name)} of it, as in the other "
                    "features of this behavior; add the row, or remove the recording from all."
                )
        # Rows lie object by object, so a row's number within its object is its recording.
        o = np.array([index[name] for name, _ in order], np.int64)
        r = np.arange(len(o)) - np.searchsorted(o, o)
        tables[context] = o, r, rows.values[[row_of[key] for key in order]]
    most = max((int(r.max(initial=-1)) + 1 for _, r, _ in tables.values()), default=0)
    joined = {}
    for context, (o, r, values) in tables.items():
        joined[context] = np.full((len(objects), most, values.shape[1]), np.nan, np.float32)
        joined[context][o, r] = values
    return joined


def _of_objects(rows: FeatureRows) -> tuple[NDArray[np.floating], list[str]]:
    """Return the rows that are there, in their order, and the object of each."""
    there = ~np.isnan(rows.values).any(axis=1)
    return rows.values[there], [
        name for (name, *_), has in zip(rows.keys, there, strict=True) if has
    ]


def _without_a_modality(
    named: Iterable[tuple[Context, FeatureRows, Mapping[tuple[str, str], int]]],
) -> dict[str, set[tuple[str, str]]]:
    """Return, by behavior, the recordings that are NaN in a modality; warn where others have it."""
    absent: dict[str, set[tuple[str, str]]] = {}
    present: dict[str, set[tuple[str, str]]] = {}
    modalities: dict[str, list[str]] = {}
    for (behavior, modality), rows, row_of in named:
        missing = np.isnan(rows.values).all(axis=1)
        lacks = {key for key, row in row_of.items() if missing[row]}
        absent.setdefault(behavior, set()).update(lacks)
        present.setdefault(behavior, set()).update(row_of.keys() - lacks)
        if lacks:
            modalities.setdefault(behavior, []).append(modality)
    for behavior, keys in absent.items():
        if lost := sorted(keys & present[behavior]):
            texts = [f"{recording} of {name}" for name, recording in lost]
            warn_user(
                f"Recordings of {behavior} are left out, as {' or '.join(modalities[behavior])} is "
                f"missing (NaN): {listed(texts)}."
            )
    return absent


def _row_of(rows: FeatureRows, objects: Mapping[str, int]) -> dict[Context, int]:
    """Return the row of each (object, recording)."""
    row_of: dict[tuple[str, str], int] = {}
    for row, (name, text) in enumerate(rows.keys):
        if name not in objects:
            hint = unknown("object", name, objects).removesuffix(".")
            expected = "an object of the list"
            raise fault(rows.places[row], f"object {name!r}", expected, f"correct it ({hint})")
        recording = _recording_of(text)
        if not recording:
            content = f"{text!r:.60} as {_RECORDING[0]}"
            expected = f"{_RECORDING[1]}, 0 or more and whole"
            raise fault(rows.places[row], content, expected, f"{_RECORDING[2]} or remove the row")
        if (name, recording) in row_of:
            first = row_of[name, recording]
            earlier = rows.places[first].removeprefix(f"{rows.source}, ")
            other = rows.keys[first][1]
            alike = "" if other == text else f" (there as {other!r:.60}, here as {text!r:.60})"
            content = f"recording {recording} of {name} again, after {earlier}{alike}"
            raise fault(rows.places[row], content, "each recording once", "remove one of the rows")
        row_of[name, recording] = row
    return row_of


def _recording_of(text: str) -> str:
    """Return what names a recording: a name, or the digits of a whole number; "" of no other.

    Programs write a number in several ways, and not all files of a behavior by one program.

    >>> [_recording_of(text) for text in ("7", "007", "7.0", "cup_7", "-7", "7.5")]
    ['7', '7', '7', 'cup_7', '', '']
    """
    name = text.strip()
    if "_" in name:  # which Python would pass over
        return name
    with suppress(ValueError):
        return "" if name.startswith("-") else str(int(name))
    try:
        number = float(name)
    except ValueError:
        return name
    exact = 0 <= number < _EXACT and number.is_integer() and not name.startswith("-")
    return str(int(number)) if exact else ""

"""Conversion of data frames, dictionaries and arrays to the fields of a `Dataset`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError

_KEYS = ("object", "recording")
_UNKNOWN = -1
_VALUES = {1: 1, 0: 0, -1: _UNKNOWN, None: _UNKNOWN, "": _UNKNOWN}  # True is 1, and 1.0 too

Parts = tuple[
    tuple[str, ...], dict[tuple[str, str], NDArray[np.float32]], NDArray[np.int8]
]  # objects, features, labels


def dataset_parts(
    domain: Domain,
    features: Mapping[tuple[str, str], Any],
    labels: Any,
    objects: Sequence[str] | None,
) -> Parts:
    """Return objects (O,), features {context: (O,R,D)} and labels (O,P); see `from_frames`."""
    names, table = _labels(domain, labels, objects)
    wanted = [(b.name, m) for b in domain.behaviors for m in b.modalities]
    for context in features:
        if context not in wanted:
            raise DataError(unknown("context", str(context), map(str, wanted)))
    for context in wanted:
        if context not in features:
            raise DataError(f"No features of {context}; expected one entry a context: {wanted}.")
    found = {context: _by_object(features[context], names, context) for context in wanted}
    most = max(len(rows) for each in found.values() for rows in each.values())
    if not most:
        raise DataError("No object has a recording; give features of at least one.")
    return names, {c: _packed(each, names, most, c) for c, each in found.items()}, table


def _by_object(
    values: Any, names: tuple[str, ...], context: tuple[str, str]
) -> dict[str, NDArray[np.float32]]:
    """Return the recordings (R,D) of each object, none of an object without an entry."""
    if hasattr(values, "columns"):
        given = _grouped(values, context)
    elif isinstance(values, Mapping):
        given = {name: _numbers(rows, context) for name, rows in values.items()}
    else:
        if len(values) != len(names):
            raise DataError(
                f"Features of {context} are of {len(values)} objects; expected {len(names)}, in "
                "the order of `objects`."
            )
        given = {name: _numbers(rows, context) for name, rows in zip(names, values, strict=True)}
        given = {name: rows[~np.isnan(rows).all(axis=1)] for name, rows in given.items()}
    for name in given:
        if name not in names:
            raise DataError(f"Features of {context}: {unknown('object', str(name), names)}")
    sizes = {rows.shape[1] for rows in given.values() if len(rows)}
    if len(sizes) > 1:
        raise DataError(f"Recordings of {context} have {sorted(sizes)} features; give one size.")
    empty = np.empty((0, *sizes), np.float32) if sizes else np.empty((0, 1), np.float32)
    return {name: rows if len(rows := given.get(name, empty)) else empty for name in names}


def _grouped(frame: Any, context: tuple[str, str]) -> dict[str, NDArray[np.float32]]:
    if "object" not in frame.columns:
        frame = frame.reset_index()
    if "object" not in frame.columns:
        raise DataError(f"The frame of {context} has no column 'object'; add one.")
    keys = [name for name in _KEYS if name in frame.columns]
    if frame.duplicated(keys).any() and "recording" in keys:
        twice = frame[frame.duplicated(keys)].iloc[0]
        raise DataError(
            f"Recording {twice['recording']} of {twice['object']!r} comes twice in the frame of "
            f"{context}; keep one."
        )
    frame = frame.sort_values(keys, kind="stable")
    columns = [name for name in frame.columns if name not in (*_KEYS, "index")]
    return {
        str(name): _numbers(part[columns], context)
        for name, part in frame.groupby("object", sort=False)
    }


def _numbers(rows: Any, context: tuple[str, str]) -> NDArray[np.float32]:
    try:
        values = np.asarray(rows, dtype=np.float32)
    except (TypeError, ValueError) as fault:
        raise DataError(f"Features of {context} are not numbers: {fault}.") from None
    if values.ndim != 2:
        raise DataError(
            f"Recordings of {context} have shape {values.shape}; expected (recordings, features)."
        )
    return values


def _packed(
    rows: dict[str, NDArray[np.float32]],
    names: tuple[str, ...],
    most: int,
    context: tuple[str, str],
) -> NDArray[np.float32]:
    """Pad with NaN to (O,R,D)."""
    width = max(each.shape[1] for each in rows.values())
    packed = np.full((len(names), most, width), np.nan, np.float32)
    for index, name in enumerate(names):
        if not np.isfinite(rows[name]).all():
            raise DataError(f"Features of {context} of {name!r} hold NaN or infinity.")
        packed[index, : len(rows[name])] = rows[name]
    return packed


def _labels(
    domain: Domain, labels: Any, objects: Sequence[str] | None
) -> tuple[tuple[str, ...], NDArray[np.int8]]:
    """Return the objects (O,) and the labels (O,P) in the domain's order."""
    if hasattr(labels, "columns"):
        frame = labels.set_index("object") if "object" in labels.columns else labels
        for attribute in domain.attributes:
            if attribute not in frame.columns:
                raise DataError(f"Labels: {unknown('column', attribute, map(str, frame.columns))}")
        rows = frame[list(domain.attributes)].iterrows()
        given = {str(name): dict(row) for name, row in rows}
        if len(given) != len(frame):
            raise DataError("An object has two rows of labels; give each one.")
    elif isinstance(labels, Mapping):
        given = {str(name): dict(row) for name, row in labels.items()}
    else:
        if objects is None or np.shape(labels) != (len(objects), len(domain.attributes)):
            raise DataError(
                f"Labels have shape {np.shape(labels)}; an array needs objects=[names] and the "
                f"shape (objects, {len(domain.attributes)})."
            )
        named = (dict(zip(domain.attributes, row, strict=True)) for row in labels)
        given = dict(zip(objects, named, strict=True))
    names = tuple(given) if objects is None else tuple(objects)
    table = np.full((len(names), len(domain.attributes)), _UNKNOWN, np.int8)
    for index, name in enumerate(names):
        for attribute, value in given.get(name, {}).items():
            table[index, domain.attribute_index(str(attribute))] = _label(value, name, attribute)
    return names, table


def _label(value: Any, name: str, attribute: str) -> int:
    if type(value).__name__ == "NAType" or (isinstance(value, float) and np.isnan(value)):
        return _UNKNOWN  # pandas' and NumPy's; NumPy's double is a float
    try:
        return _VALUES[value.item() if isinstance(value, np.generic) else value]
    except (KeyError, TypeError):
        raise DataError(
            f"Whether {name!r} is {attribute!r} is {value!r}; expected 1, 0, True, False, or "
            "nothing where it is unknown."
        ) from None

"""Conversion of data frames, dictionaries and arrays to the fields of a `Dataset`."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import label_values, real_values
from meal_bayes.datasets.feature_file import Context, FeatureRows, join_features
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError

_KEYS = ["object", "recording"]
_Parts = tuple[tuple[str, ...], dict[Context, NDArray[np.float32]], NDArray[np.int8]]


def dataset_parts(
    domain: Domain, features: Mapping[Context, Any], labels: Any, objects: Sequence[str] | None
) -> _Parts:
    """Return objects (O,), features {context: (O,R,D)} and labels (O,P); see `from_frames`."""
    names, values = _labels(domain, labels, objects)
    contexts = domain.contexts
    for context in features:
        if context not in contexts:
            raise DataError(unknown("context", str(context), map(str, contexts)))
    for context in contexts:
        if context not in features:
            raise DataError(f"No features of {context}; expected one entry a context: {contexts}.")
    rows = [(context, _rows(features[context], names, context)) for context in contexts]
    if not any(len(table.keys) for _, table in rows):
        raise DataError("No object has a recording; give features of at least one.")
    return names, join_features(names, rows), values


def _rows(values: Any, objects: Sequence[str], context: Context) -> FeatureRows:
    """Return the rows of one context, whatever form they have."""
    source = f"the features of {context}"
    if hasattr(values, "columns"):
        frame = values if "object" in values.columns else values.reset_index()
        if "object" not in frame.columns:
            raise DataError(f"{source}: found a frame without a column 'object'; add one.")
        numbered = "recording" in frame.columns
        recordings = frame["recording"] if numbered else frame.groupby("object").cumcount()
        keys = list(zip(frame["object"].astype(str), recordings.astype(str), strict=True))
        table = _numbers(frame.drop(columns=[*_KEYS, "index"], errors="ignore"), source)
    else:
        if not isinstance(values, Mapping):
            if len(values) != len(objects):
                raise DataError(
                    f"{source}: found those of {len(values)} objects; expected {len(objects)}, in "
                    "the order of `objects`."
                )
            named = (
                (name, _numbers(part, source)) for name, part in zip(objects, values, strict=True)
            )
            values = {name: part[~np.isnan(part).all(axis=1)] for name, part in named}
        parts = {str(name): _numbers(part, source) for name, part in values.items()}
        keys = [(name, str(r)) for name, part in parts.items() for r in range(1, len(part) + 1)]
        sizes = {part.shape[1] for part in parts.values() if len(part)}
        if len(sizes) > 1:
            raise DataError(
                f"{source}: found recordings of {sorted(sizes)} features; give one size."
            )
        table = np.concatenate([np.empty((0, *(sizes or {1}))), *filter(len, parts.values())])
    rows = FeatureRows(source, [f"row {n}" for n in range(1, len(keys) + 1)], keys, table)
    for row in np.flatnonzero(~np.isfinite(table).all(axis=1)):
        found = f"NaN or infinity in recording {keys[row][1]} of {keys[row][0]}"
        raise rows.fault(int(row), found, "finite numbers", "leave the recording out")
    return rows


def _numbers(rows: Any, source: str) -> NDArray[np.float32]:
    try:
        values = real_values(rows)
    except (TypeError, ValueError) as fault:
        raise DataError(f"{source} are not numbers: {fault}.") from None
    if values.ndim != 2:
        raise DataError(f"{source} have shape {values.shape}; expected (recordings, features).")
    return values


def _labels(
    domain: Domain, labels: Any, objects: Sequence[str] | None
) -> tuple[tuple[str, ...], NDArray[np.int8]]:
    """Return the objects (O,) and the labels (O,P) in the domain's order."""
    if hasattr(labels, "columns"):
        frame = labels.set_index("object") if "object" in labels.columns else labels
        for attribute in domain.attributes:
            if attribute not in frame.columns:
                raise DataError(f"Labels: {unknown('column', attribute, map(str, frame.columns))}")
        if frame.index.has_duplicates:
            raise DataError("An object has two rows of labels; give each one.")
        columns = frame[list(domain.attributes)].astype(object)
        values = {str(name): dict(row) for name, row in columns.iterrows()}
    elif isinstance(labels, Mapping):
        values = {str(name): dict(row) for name, row in labels.items()}
    else:
        if objects is None or np.shape(labels) != (len(objects), len(domain.attributes)):
            raise DataError(
                f"Labels have shape {np.shape(labels)}; an array needs objects=[names] and the "
                f"shape (objects, {len(domain.attributes)})."
            )
        rows = (dict(zip(domain.attributes, row, strict=True)) for row in labels)
        values = dict(zip(objects, rows, strict=True))
    names = tuple(values) if objects is None else tuple(objects)
    table = np.full((len(names), len(domain.attributes)), -1, np.int8)
    for index, name in enumerate(names):
        for attribute, value in values.get(name, {}).items():
            try:
                table[index, domain.attribute_index(str(attribute))] = label_values(value)
            except DataError as fault:
                raise DataError(f"Whether {name!r} is {attribute!r}: {fault}") from None
    return names, table

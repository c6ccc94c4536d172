"""The experience in a learner's file: an array a table, checked before it is the record."""

import json
import zipfile
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import Domain
from meal_bayes.learner.columns import NONE, WITHDRAWN
from meal_bayes.learner.experience import Experience
from meal_bayes.untrusted import read_array, read_member, write_array

_TABLES = ("instances", "levels", "detected", "labels", "executions", "feedback", "object_labels")
_NAMES = ("objects", "trials", "feedback_logs")  # JSON values, a line each
_LARGE = 2**62
_MOST_LEVELS = 64

Limits = tuple[int, int]  # the least value, and the end
Tables = Mapping[str, NDArray[Any]]
FeatureParts = list[Any]  # [number of the context, name of the rows' array, of the values']


class _Sizes(NamedTuple):
    """How many of each there are that a number of the record may name."""

    instances: int
    objects: int
    trials: int
    behaviors: int
    attributes: int


def write_experience(archive: zipfile.ZipFile, experience: Experience) -> None:
    """Write the tables of the record, and the names of its objects, trials and logs."""
    for name in _TABLES:
        write_array(archive, name, getattr(experience, name).values)
    for name in _NAMES:
        archive.writestr(name, "\n".join(map(json.dumps, getattr(experience, name))))


def read_experience(archive: zipfile.ZipFile, domain: Domain) -> Experience:
    """Read a record, once every number in it is known to fit.

    Raises
    ------
    ValueError
        What does not fit the domain, or what else is in the file.
    """
    experience = Experience(domain)
    empty = {name: getattr(experience, name).values for name in _TABLES}
    tables = {
        name: read_array(archive, name, values.dtype, values.ndim) for name, values in empty.items()
    }
    objects = _read_lines(archive, "objects")
    trials = [tuple(key) for key in _read_lines(archive, "trials")]
    feedback_logs = _read_lines(archive, "feedback_logs")
    sizes = _Sizes(
        instances=len(tables["instances"]),
        objects=len(objects),
        trials=len(trials),
        behaviors=len(domain.behaviors),
        attributes=len(domain.attributes),
    )
    _check_tables(tables, sizes)
    if len(set(objects)) < len(objects) or len(set(trials)) < len(trials):
        raise ValueError("objects or trials are named twice")
    if not all(isinstance(name, str) for name in [*objects, *feedback_logs]):
        raise ValueError("objects or logs are not named by text")
    experience.feedback_logs = dict.fromkeys(feedback_logs)
    experience.objects = {name: number for number, name in enumerate(objects)}
    experience.trials = {key: number for number, key in enumerate(trials)}
    for name, values in tables.items():
        getattr(experience, name).extend(values)
    return experience


def _column_limits(sizes: _Sizes) -> dict[str, dict[str, Limits]]:
    """Return the limits of each column of the record's tables (`columns.py`)."""
    n, o, t, e, p = sizes
    return {
        "instances": {
            "object": (0, o),
            "behavior": (0, e),
            "digest": (0, 2**63 - 1),
            "copy": (0, _LARGE),
            "recording": (NONE, _LARGE),
            "origin": (0, WITHDRAWN + 1),
            "scale": (0, _MOST_LEVELS),
        },
        "executions": {
            "trial": (0, t),
            "behavior": (0, e),
            "instance": (NONE, n),
            "success": (-1, WITHDRAWN + 1),
        },
        "feedback": {
            "trial": (0, t),
            "call": (0, _LARGE),
            "object": (0, o),
            "attribute": (0, p),
            "value": (-1, 2),
            "given": (0, 2),
        },
    }


def _check_tables(tables: Tables, sizes: _Sizes) -> None:
    """Raise a `ValueError` where a table names what there is not, or has another length."""
    for name, limits in _column_limits(sizes).items():
        for column in tables[name].dtype.names or ():
            check_limits(name, tables[name][column], limits[column])
    for name in ("levels", "detected"):
        check_limits(name, tables[name], (-1, _MOST_LEVELS))
    for name in ("labels", "object_labels"):
        check_limits(name, tables[name], (-1, 2))
    if any(len(tables[name]) != sizes.instances for name in ("levels", "detected", "labels")):
        raise ValueError("percepts or labels do not fit the instances")
    if len(tables["object_labels"]) != sizes.objects:
        raise ValueError("labels do not fit the objects")


def check_limits(name: str, values: NDArray[Any], limits: Limits) -> None:
    """Raise a `ValueError` where a value lies outside of limits."""
    least, end = limits
    if ((values < least) | (values >= end)).any():
        raise ValueError(f"{name} names what there is not")


def write_features(experience: Experience, keep: Callable[[NDArray[Any]], str]) -> FeatureParts:
    """Write features, an array of each context and size; return where they are."""
    parts = []
    for number, context in enumerate(experience.domain.contexts):
        by_size: dict[int, list[int]] = {}
        for i, values in experience.features[context].items():
            by_size.setdefault(len(values), []).append(i)
        for rows in by_size.values():
            values = np.stack([experience.features[context][i] for i in rows])
            parts.append([number, keep(np.array(rows, np.int64)), keep(values)])
    return parts


def read_features(
    parts: FeatureParts, read: Callable[[str, str, int], NDArray[Any]], experience: Experience
) -> None:
    """Read features into the record, in the order of instances.

    Raises
    ------
    ValueError
        Features that are not finite, or of no instance of their behavior.
    """
    contexts = experience.domain.contexts
    by_context: list[dict[int, NDArray[np.float32]]] = [{} for _ in contexts]
    behaviors = experience.instances.values["behavior"]
    for number, rows_name, values_name in parts:
        values = read(str(values_name), "<f4", 2)
        rows = read(str(rows_name), "<i8", 1)
        name = f"features of {contexts[number]}"
        if not np.isfinite(values).all() or values.shape[0] != len(rows) or not values.shape[1]:
            raise ValueError(f"{name} are not finite, or not of instances")
        check_limits(name, rows, (0, len(behaviors)))
        behavior = experience.domain.behavior_index(contexts[number][0])
        if (behaviors[rows] != behavior).any():
            raise ValueError(f"{name} are of another behavior's instances")
        by_context[number].update(zip(rows.tolist(), values, strict=True))
    for context, by_instance in zip(contexts, by_context, strict=True):
        experience.features[context] = dict(sorted(by_instance.items()))


def _read_lines(archive: zipfile.ZipFile, name: str) -> list[Any]:
    """Read JSON values, a line each."""
    return [json.loads(line) for line in read_member(archive, name).splitlines()]

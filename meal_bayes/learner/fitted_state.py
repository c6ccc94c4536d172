"""What was fitted, as JSON and arrays: nothing in it can make a program execute.

Fitted objects are trees of dataclasses and named tuples over arrays. Each is written as its name
and its fields, and only the classes that are listed here are read back.
"""

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Knowledge
from meal_bayes.domain import Domain
from meal_bayes.perception import Perception
from meal_bayes.perception.ensemble import BehaviorClassifier, KernelFit
from meal_bayes.perception.recordings import FeatureSpace
from meal_bayes.perception.stacked import Stacker
from meal_bayes.posterior import ConfusionPosterior, SharedTrait

_CLASSES: dict[str, Callable[..., Any]] = {
    known.__name__: known
    for known in (
        Perception, BehaviorClassifier, KernelFit, FeatureSpace, Stacker, Knowledge,
        ConfusionPosterior, SharedTrait,
    )
}  # fmt: skip
_DTYPES = ("<f8", "<f4", "<i8", "|i1", "|b1")

Json = Any


def pack(value: object, keep: Callable[[NDArray[Any]], str]) -> Json:
    """Return an object as JSON values; a domain is not written, as a learner has one.

    Parameters
    ----------
    value : object
        Of classes that this module lists.
    keep : Callable[[NDArray[Any]], str]
        Stores an array, and returns its name.

    Raises
    ------
    TypeError
        An object of another class.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, np.ndarray) and value.dtype.str in _DTYPES:
        return {"array": keep(value), "dtype": value.dtype.str, "axes": value.ndim}
    if isinstance(value, Domain):
        return {"domain": True}
    if isinstance(value, Mapping):
        return {"table": {str(name): pack(each, keep) for name, each in value.items()}}
    name = type(value).__name__
    if _CLASSES.get(name) is not type(value):
        raise TypeError(f"{name} cannot be saved")
    if dataclasses.is_dataclass(value):
        names = [field.name for field in dataclasses.fields(value)]
    else:
        names = list(value._fields)  # of a named tuple
    return {"class": name, "fields": {one: pack(getattr(value, one), keep) for one in names}}


def unpack(found: Json, read: Callable[[str, str, int], NDArray[Any]], domain: Domain) -> Any:
    """Return the object that `pack` wrote.

    Parameters
    ----------
    found : Json
        What it returned.
    read : Callable[[str, str, int], NDArray[Any]]
        Reads an array by its name, dtype and number of axes.
    domain : Domain
        Of the learner.

    Raises
    ------
    KeyError, TypeError, ValueError, SettingsError
        JSON that `pack` does not write.
    """
    if not isinstance(found, dict):
        return found
    if "domain" in found:
        return domain
    if "array" in found:
        if found["dtype"] not in _DTYPES:
            raise ValueError(f"an array is of {found['dtype']!r}")
        return read(str(found["array"]), found["dtype"], int(found["axes"]))
    entries = found["table"] if "table" in found else found["fields"]
    made = {str(name): unpack(each, read, domain) for name, each in entries.items()}
    return made if "table" in found else _CLASSES[found["class"]](**made)

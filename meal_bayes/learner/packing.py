"""Trees of dataclasses and named tuples over arrays, as JSON values and arrays, and back.

Only the classes that are listed here are written and read.
"""

from collections.abc import Callable, Mapping
from dataclasses import fields, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Knowledge
from meal_bayes.agents.co_occurrence import CoOccurrence
from meal_bayes.arrays import Rows
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Domain, Payoffs
from meal_bayes.perception import Perception
from meal_bayes.perception.feature_spaces import FeatureSpace, Whitening
from meal_bayes.perception.kernel_ridge import KernelFit, Stacker
from meal_bayes.perception.perceiver import BehaviorClassifier
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.trait import SharedTrait

_KINDS: tuple[type[Any], ...] = (
    Perception,
    BehaviorClassifier,
    KernelFit,
    FeatureSpace,
    Whitening,
    Stacker,
    Knowledge,
    CoOccurrence,
    ConfusionPosterior,
    SharedTrait,
    PerceptTable,
    Payoffs,
)
_CLASSES = {kind.__name__: kind for kind in _KINDS}

Json = Any


def pack(value: Any, keep: Callable[[NDArray[Any]], str]) -> Json:
    """Return an object as JSON values; `keep` stores an array and returns its name.

    Of a domain, which a learner has, only the probabilities of success are written.
    """
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, Rows):
        value = value.values
    if isinstance(value, np.ndarray):
        return {"array": keep(value), "dtype": value.dtype.str, "axes": value.ndim}
    if isinstance(value, Domain):
        return {"domain": [effect.probability for effect in value.diagram.effects]}
    if isinstance(value, Mapping):
        return {"table": {str(name): pack(entry, keep) for name, entry in value.items()}}
    if isinstance(value, tuple) and not hasattr(value, "_fields"):
        return [pack(entry, keep) for entry in value]
    name = type(value).__name__
    if _CLASSES.get(name) is not type(value):
        raise TypeError(f"{name} cannot be saved")
    names = getattr(value, "_fields", None)  # of a named tuple
    names = names or [field.name for field in fields(value)]
    return {"class": name, "fields": {n: pack(getattr(value, n), keep) for n in names}}


def unpack(packed: Json, read: Callable[[str, str, int], NDArray[Any]], domain: Domain) -> Any:
    """Return the object that `pack` wrote; `read` reads an array by name, dtype and axes."""
    if isinstance(packed, list):
        return tuple(unpack(entry, read, domain) for entry in packed)
    if not isinstance(packed, dict):
        return packed
    if "domain" in packed:
        return _succeeding(domain, packed["domain"])
    if "array" in packed:
        return read(str(packed["array"]), packed["dtype"], int(packed["axes"]))
    entries = packed["table"] if "table" in packed else packed["fields"]
    values = {str(name): unpack(entry, read, domain) for name, entry in entries.items()}
    return values if "table" in packed else _CLASSES[packed["class"]](**values)


def _succeeding(domain: Domain, probabilities: list[float]) -> Domain:
    """Return a domain whose behaviors succeed with other probabilities, an effect each."""
    effects = tuple(
        replace(effect, probability=float(probability))
        for effect, probability in zip(domain.diagram.effects, probabilities, strict=True)
    )
    return replace(domain, diagram=replace(domain.diagram, effects=effects))

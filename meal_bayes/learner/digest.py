"""The digest of an agent's fields: equal agents of two processes have equal ones.

It is of an agent in use, so of other objects it sees what their constructors were given, not what
they have computed since. A run, which begins with its agents and is found again by their code,
counts the files of that too: `own_agent_digest` of `experiments/store.py`.
"""

import dataclasses
import functools
import hashlib
import inspect
from collections.abc import Iterator
from types import CodeType
from typing import Any

import numpy as np

from meal_bayes.agents import Agent

_DEEPEST = 12  # fields inside each other


def agent_digest(agent: Agent) -> str:
    """Compute the digest of all fields of an agent, its planner's and its functions' included."""
    return hashlib.sha256("\0".join(_parts(agent, _DEEPEST)).encode()).hexdigest()[:16]


def _parts(value: Any, depth: int) -> Iterator[str]:
    """Yield texts that name a value, whatever process it is in."""
    kind = f"{type(value).__module__}.{type(value).__qualname__}"
    if depth == 0:
        return
    if value is None or isinstance(value, str | bytes | bool | int | float | complex):
        yield repr(value)
    elif isinstance(value, np.ndarray):
        yield f"{value.dtype}{value.shape}{hashlib.sha256(value.tobytes()).hexdigest()}"
    elif isinstance(value, tuple | list):
        yield f"{kind}{len(value)}"
        for entry in value:
            yield from _parts(entry, depth - 1)
    elif isinstance(value, dict | set | frozenset):
        entries = value.items() if isinstance(value, dict) else value
        yield kind
        yield from sorted("\0".join(_parts(entry, depth - 1)) for entry in entries)
    elif dataclasses.is_dataclass(value) and not isinstance(value, type):
        yield kind
        for field in dataclasses.fields(value):
            yield field.name
            yield from _parts(getattr(value, field.name), depth - 1)
    elif isinstance(value, functools.partial):
        yield from _parts((value.func, value.args, value.keywords), depth - 1)
    elif inspect.ismethod(value):
        yield from _parts((value.__func__, value.__self__), depth - 1)
    elif inspect.isfunction(value):
        cells = tuple(cell.cell_contents for cell in value.__closure__ or ())
        yield f"{value.__module__}.{value.__qualname__}"
        yield from _code(value.__code__)
        yield from _parts((value.__defaults__, value.__kwdefaults__, cells), depth - 1)
    elif isinstance(value, type):
        yield f"{value.__module__}.{value.__qualname__}"
    else:  # of any other object, what its constructor is given and keeps under that name
        yield kind
        for name in sorted(inspect.signature(type(value)).parameters):
            if hasattr(value, name):
                yield name
                yield from _parts(getattr(value, name), depth - 1)


def _code(code: CodeType) -> Iterator[str]:
    """Yield what a function does: its instructions, names and constants."""
    yield code.co_code.hex()
    yield repr(code.co_names)
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield from _code(constant)
        else:
            yield repr(constant)

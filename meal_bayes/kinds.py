"""The door of public functions and classes: arguments are of the kinds that annotations name.

What is of another kind is refused before anything is done, by an error that names the argument,
what was found and what is expected. Ranges, shapes, and what must fit another argument are read by
the function itself.
"""

import functools
import inspect
import itertools
import os
import types
import typing
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple, ParamSpec, TypeVar, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import is_number, is_whole, real_array
from meal_bayes.errors import SettingsError

Given = ParamSpec("Given")
Result = TypeVar("Result")
Callee = TypeVar("Callee", bound=Callable[..., Any])


class Kind(NamedTuple):
    """What values of an annotation are: a test, the words for it, and classes that need no test."""

    fits: Callable[[Any], bool]
    expected: str
    surely: frozenset[type] = frozenset()

    def admits(self, value: object) -> bool:
        """Return whether a value is of this kind."""
        return type(value) in self.surely or self.fits(value)


def checked(callee: Callee) -> Callee:
    """Make a function, or a class, refuse arguments that are not of the kinds of its annotations.

    A class refuses them when it is made, and in each public method of its own.

    >>> @checked
    ... def wait(seconds: float, name: str = "it") -> str:
    ...     return f"{name} waits for {seconds} s"
    >>> wait(2)
    'it waits for 2 s'
    >>> wait(2, name=None)
    Traceback (most recent call last):
    meal_bayes.errors.SettingsError: wait(): name is None; give a text.
    """
    return checked_except()(callee)


def checked_except(*names: str) -> Callable[[Callee], Callee]:
    """Do as `checked`, but for arguments of these names, which the callee itself reads."""

    def check(callee: Callee) -> Callee:
        if not isinstance(callee, type):
            return cast(Callee, _guarded(callee, callee.__name__, names, bound=False))
        made_by = "__new__" if issubclass(callee, tuple) else "__init__"
        guarded = _guarded(getattr(callee, made_by), callee.__name__, names, bound=True)
        for name, member in tuple(vars(callee).items()):
            if not name.startswith("_"):
                setattr(callee, name, _guarded_method(callee, name, member, names))
        setattr(callee, made_by, guarded)
        return callee

    return check


def _guarded_method(owner: type[Any], name: str, member: Any, free: tuple[str, ...]) -> Any:
    """Return a method that looks at its arguments first; other members of a class as they are."""
    full_name = f"{owner.__name__}.{name}"
    if isinstance(member, classmethod):
        return classmethod(_guarded(member.__func__, full_name, free, bound=True, owner=owner))
    if isinstance(member, staticmethod):
        return staticmethod(_guarded(member.__func__, full_name, free, bound=False))
    if inspect.isfunction(member):
        return _guarded(member, full_name, free, bound=True, owner=owner)
    return member


def _guarded(
    function: Callable[Given, Result],
    name: str,
    free: tuple[str, ...],
    *,
    bound: bool,
    owner: type[Any] | None = None,
) -> Callable[Given, Result]:
    """Return a function that looks at its arguments first; where it is bound, not at the first.

    A method of an owner is told by the class whose method a user has called, which may inherit it.
    """
    kinds = functools.cache(functools.partial(_kinds_of, function, free, bound=bound))

    @functools.wraps(function)
    def call(*values: Given.args, **by_name: Given.kwargs) -> Result:
        places, further, names = kinds()
        by_place = itertools.chain(places, itertools.cycle(further))
        for (argument, kind), value in zip(by_place, values[bound:], strict=False):
            if not kind.admits(value):
                raise _refusal(_called_name(name, owner, values), argument, value, kind)
        for argument, value in by_name.items():
            kind = names.get(argument, _ANYTHING)  # a name that is unknown is Python's to refuse
            if not kind.admits(value):
                raise _refusal(_called_name(name, owner, values), argument, value, kind)
        return function(*values, **by_name)

    return call


def _called_name(name: str, owner: type[Any] | None, values: Sequence[object]) -> str:
    """Return the name of a method by the class that it was called of."""
    if owner is None or not values:
        return name
    called = values[0] if isinstance(values[0], type) else type(values[0])
    return f"{called.__name__}.{name.partition('.')[2]}" if issubclass(called, owner) else name


def _refusal(name: str, argument: str, value: object, kind: Kind) -> SettingsError:
    value_text = f"the class {value.__name__}" if isinstance(value, type) else f"{value!r:.60}"
    return SettingsError(f"{name}(): {argument} is {value_text}; give {kind.expected}.")


Named = tuple[str, Kind]  # an argument, by name


def _kinds_of(
    function: Callable[..., Any], free: tuple[str, ...], *, bound: bool
) -> tuple[list[Named], list[Named], dict[str, Kind]]:
    """Return the kinds of arguments by place, of all further ones (*args), and of those by name."""
    # What it returns may be of a library that is not loaded.
    annotations = dict(function.__annotations__)
    annotations.pop("return", None)
    arguments = types.SimpleNamespace(__annotations__=annotations)
    hints = typing.get_type_hints(arguments, inspect.unwrap(function).__globals__)
    parameters = list(inspect.signature(function).parameters.values())[bound:]
    kinds = {}
    for parameter in parameters:
        is_free = parameter.name in free or parameter.kind is parameter.VAR_KEYWORD
        hint = Any if is_free else hints.get(parameter.name, Any)
        kinds[parameter.name] = kind_of(hint | None if parameter.default is None else hint)

    def of(*sorts: inspect._ParameterKind) -> list[Named]:
        return [(p.name, kinds[p.name]) for p in parameters if p.kind in sorts]

    places = of(inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)
    further = of(inspect.Parameter.VAR_POSITIONAL)
    return places, further, {name: kinds[name] for name in kinds.keys() - dict(further)}


def _is_real(value: Any) -> bool:
    scalar = isinstance(value, np.ndarray) and value.ndim == 0 and value.dtype.kind in "iuf"
    return scalar or is_number(value)


_ANYTHING = Kind(lambda _: True, "anything")
_SCALARS = {
    bool: Kind(
        lambda value: isinstance(value, bool | np.bool_), "True or False", frozenset({bool})
    ),
    int: Kind(is_whole, "a whole number", frozenset({int})),
    float: Kind(_is_real, "a number", frozenset({float, int})),
    str: Kind(lambda value: isinstance(value, str), "a text", frozenset({str})),
    type(None): Kind(lambda value: value is None, "None", frozenset({type(None)})),
}
# What an `ArrayLike` is made of, where it is a union; from numpy 2.5 on it is one name.
_ARRAY_LIKE = frozenset(typing.get_args(ArrayLike) or (ArrayLike,))


@functools.cache
def kind_of(hint: Any) -> Kind:
    """Return the kind of values that an annotation names.

    >>> kind_of(dict[str, float] | None).expected
    'a mapping of a text to a number, or None'
    """
    if hint in _SCALARS:
        return _SCALARS[hint]
    if hint in (Any, object, ArrayLike) or isinstance(hint, TypeVar):
        return _ANYTHING
    origin = typing.get_origin(hint) or hint
    parts = typing.get_args(hint)
    if origin in (typing.Union, types.UnionType):
        return _any_of(parts)
    if origin is Callable or origin is typing.get_origin(Callable[..., Any]):
        return Kind(callable, "a function")
    return _container(origin, parts) or _instance(origin)


def _container(origin: type[Any], parts: tuple[Any, ...]) -> Kind | None:
    """Return the kind of what holds other values, or names a file; None of other classes."""
    if origin in (np.ndarray, NDArray):  # NDArray is its own origin from numpy 2.5 on
        return _array(parts[-1])
    if origin is tuple and parts and parts[-1] is not Ellipsis:
        return _row(parts)
    if issubclass(origin, os.PathLike):
        return Kind(lambda value: isinstance(value, os.PathLike), "a Path")
    if issubclass(origin, Mapping):
        return _mapping(*map(kind_of, parts or (Any, Any)))
    if issubclass(origin, Iterable) and parts:
        return _list(origin, kind_of(parts[0]))
    return None


def _any_of(parts: tuple[Any, ...]) -> Kind:
    """Return the kind of a union; one with anything that numpy reads as an array is anything."""
    if set(parts) >= _ARRAY_LIKE:
        return _ANYTHING
    kinds = [kind_of(part) for part in parts]
    tests = [kind.fits for kind in kinds]
    words = [kind.expected for kind in kinds]
    if {str, Path} <= set(parts):
        words = ["a path, as a text or a Path", *words]
        words = [text for text in words if text not in ("a text", "a Path")]
    return Kind(
        lambda value: any(fits(value) for fits in tests),
        ", or ".join(words),
        frozenset().union(*(kind.surely for kind in kinds)),
    )


def _instance(origin: type[Any]) -> Kind:
    """Return the kind of instances of a class, or of what has the methods of a protocol."""
    words = f"a value of class {origin.__name__}"
    if not getattr(origin, "_is_protocol", False):
        return Kind(lambda value: isinstance(value, origin), words, frozenset({origin}))
    # A class has the methods of its instances.
    return Kind(
        lambda value: isinstance(value, origin) and not isinstance(value, type),
        f"an object with the methods of {origin.__name__}",
    )


def _array(dtype: Any) -> Kind:
    """Return the kind of arrays, and of lists that make one."""
    scalar = (typing.get_args(dtype) or (dtype,))[0]

    def fits(value: Any) -> bool:
        if isinstance(value, np.ndarray) and value.dtype.kind in "biuf":
            return value.ndim > 0
        if scalar is np.object_:
            return isinstance(value, list | tuple | np.ndarray)
        try:
            return real_array("array", value).ndim > 0
        except SettingsError:
            return False

    return Kind(fits, "an array of values" if scalar is np.object_ else "an array of numbers")


def _list(origin: type[Any], item: Kind) -> Kind:
    """Return the kind of lists; what can be read but once is not read."""
    least = list | tuple if origin in (list, tuple) else origin

    def fits(value: Any) -> bool:
        if isinstance(value, np.ndarray) and origin not in (list, tuple):
            return value.ndim == 1 and all(map(item.fits, value.tolist()))
        if isinstance(value, str | bytes) or not isinstance(value, least):
            return False
        return not isinstance(value, list | tuple | Mapping) or all(map(item.fits, value))

    return Kind(fits, f"a list of which each is {item.expected}")


def _row(parts: tuple[Any, ...]) -> Kind:
    """Return the kind of tuples of some length."""
    items = [kind_of(part) for part in parts]

    def fits(value: Any) -> bool:
        of_length = isinstance(value, list | tuple) and len(value) == len(items)
        return of_length and all(item.fits(part) for item, part in zip(items, value, strict=True))

    return Kind(fits, f"a tuple of {', '.join(item.expected for item in items)}")


def _mapping(key: Kind, item: Kind) -> Kind:
    """Return the kind of mappings."""

    def fits(value: Any) -> bool:
        return isinstance(value, Mapping) and all(
            key.fits(name) and item.fits(content) for name, content in value.items()
        )

    return Kind(fits, f"a mapping of {key.expected} to {item.expected}")

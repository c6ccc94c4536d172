"""Read-only arrays, arrays that grow, and checks of values that others give.

Every array field of a public type goes through `freeze` at birth.
"""

import dataclasses
from collections.abc import Callable, Mapping
from decimal import Decimal
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any, TypeGuard, TypeVar, get_args, get_origin

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.errors import DataError, SettingsError

Function = TypeVar("Function", bound=Callable[..., Any])
Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Levels = NDArray[np.int8]  # of percepts, 0 to K-1

_HASHED = 64  # entries of an array that its hash depends on
_FINITE = float(np.finfo(float).max)  # the largest finite number


def tiny_is_zero(function: Function) -> Function:
    """Let a function round to 0 what is too small for a float, as NumPy does by default.

    Probabilities of much evidence are that small. Where the user has said `np.seterr(all="raise")`
    or "warn", NumPy would not.
    """
    return np.errstate(under="ignore")(function)


def freeze(values: ArrayLike, dtype: Any = np.float64) -> NDArray[Any]:
    """Copy into a contiguous array that cannot be written to; one that is frozen is not copied.

    >>> frozen = freeze([1, 2])
    >>> frozen.flags.writeable, freeze(frozen) is frozen
    (False, True)
    """
    if type(values) is np.ndarray and values.dtype == dtype:
        flags = values.flags
        if flags.owndata and flags.c_contiguous and not flags.writeable:
            return values
    array = np.array(values, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


def set_frozen(instance: object, **fields: object) -> None:
    """Set fields of a frozen dataclass inside its own `__post_init__`."""
    for name, value in fields.items():
        object.__setattr__(instance, name, value)


def freeze_arrays(instance: Any) -> None:
    """Freeze the arrays of a dataclass, in the types of its annotations; None stays None."""
    for name, dtype in _array_fields(instance.__class__):
        values = getattr(instance, name)
        if values is not None:
            try:
                object.__setattr__(instance, name, freeze(values, dtype))
            except (TypeError, ValueError, OverflowError):
                argument = f"{type(instance).__name__}(): {name}"
                raise SettingsError(
                    f"{argument} is {values!r:.60}; give an array of numbers."
                ) from None


@cache
def _array_fields(kind: type[Any]) -> list[tuple[str, Any]]:
    """Return name and dtype of the fields that are given and are `NDArray[dtype]`, perhaps None."""
    arrays = []
    for field in filter(lambda field: field.init, dataclasses.fields(kind)):
        hint = get_args(field.type)[0] if isinstance(field.type, UnionType) else field.type
        if get_origin(hint) in (np.ndarray, NDArray):  # NDArray is its own origin from numpy 2.5 on
            dtype = get_args(hint)[-1]
            scalar = get_args(dtype)[0] if get_origin(dtype) is np.dtype else dtype
            arrays.append((field.name, scalar))
    return arrays


def lowest_yes(levels: int) -> int:
    """Return the lowest of K levels of a percept that says yes: their upper half does.

    Tables, beliefs, posteriors, detectors, texts and, compiled, planners ask here.
    """
    return levels // 2


def yes_of(levels: NDArray[Any]) -> NDArray[Any]:
    """Sum counts or probabilities of a percept's levels (...,K) over those that say yes, (...).

    >>> yes_of(np.array([0.1, 0.2, 0.3, 0.4])).round(3).item()
    0.7
    """
    return np.asarray(levels[..., lowest_yes(levels.shape[-1]) :].sum(axis=-1))


def no_and_yes_of(levels: NDArray[Any]) -> NDArray[Any]:
    """Sum counts or probabilities of levels (...,K) over those that say no, and yes, (...,2)."""
    no = levels[..., : lowest_yes(levels.shape[-1])].sum(axis=-1)
    return np.stack([no, yes_of(levels)], axis=-1)


def equal_values(first: object, second: object) -> bool:  # noqa: PLR0911  a kind a line
    """Return whether two values are equal: of arrays every entry, where nan equals nan.

    >>> equal_values({"a": np.array([1.0, np.nan])}, {"a": np.array([1.0, np.nan])})
    True
    """
    if first is second:
        return True
    if first is None or second is None:
        return False
    try:
        if any(hasattr(v, "__array__") and not isinstance(v, np.generic) for v in (first, second)):
            a, b = np.asarray(first), np.asarray(second)
            return np.array_equal(a, b, equal_nan=_may_lack(a) and _may_lack(b))
        if isinstance(first, Mapping) and isinstance(second, Mapping):
            keys = first.keys()
            return keys == second.keys() and all(equal_values(first[k], second[k]) for k in keys)
        # Also a tuple with names, which compares itself by this function.
        if isinstance(first, list | tuple) or isinstance(second, list | tuple):
            for kind in (list, tuple):
                if isinstance(first, kind) and isinstance(second, kind):
                    pairs = zip(first, second, strict=False)
                    return len(first) == len(second) and all(equal_values(*pair) for pair in pairs)
            return False
        return bool(first == second) or bool(first != first and second != second)  # noqa: PLR0124  nan
    except (TypeError, ValueError):  # what others compare, such as arrays inside arrays
        return False


def _may_lack(array: NDArray[Any]) -> bool:
    """Return whether entries may be missing, as nan or as no time, which equals itself here."""
    return array.dtype.kind in "fcmM"


def _real(array: NDArray[Any]) -> NDArray[Any]:
    """Return the real parts of an array (n,), also of numbers that it holds as objects."""
    if array.dtype != object:
        return np.asarray(array.real)
    parts = array.copy()
    for place, part in enumerate(array):
        parts[place] = getattr(part, "real", part)
    return parts


def hash_of(value: Any) -> int:
    """Compute a hash that is the same for values that `equal_values` finds equal.

    Of a large array the shape and the first entries decide, as equal arrays have equal ones.
    """
    if isinstance(value, Mapping):
        return hash(frozenset((key, hash_of(part)) for key, part in value.items()))
    if hasattr(value, "__array__") or isinstance(value, list | tuple):
        try:
            array = np.asarray(value)
            # Real parts alone: equal complex numbers have equal ones. -0 equals 0.
            first = _real(array.ravel()[:_HASHED]).astype(float) + 0.0
            first[np.isnan(first)] = np.nan
            return hash((array.shape, first.tobytes())) if array.shape else hash(float(first[0]))
        except (TypeError, ValueError):
            return hash(tuple(map(hash_of, value))) if isinstance(value, list | tuple) else 0
    try:
        return hash(value)
    except TypeError:
        return 0


class ByValue:
    """A frozen dataclass that is compared and hashed by value, also where it holds arrays."""

    __slots__ = ()
    __array_ufunc__ = None  # an array compares itself with it as a whole, not entry by entry

    def __init_subclass__(cls, **options: Any) -> None:
        """Give a subclass this comparison, in place of the one that a dataclass makes."""
        super().__init_subclass__(**options)
        for name in ("__eq__", "__hash__"):
            if name not in cls.__dict__:
                setattr(cls, name, ByValue.__dict__[name])

    def __eq__(self, other: object) -> bool:
        """Return whether another of the same class has equal fields; of arrays every entry."""
        if self.__class__ is not other.__class__:
            return NotImplemented
        kind: Any = self.__class__
        names = _compared(kind)
        return all(equal_values(getattr(self, name), getattr(other, name)) for name in names)

    def __hash__(self) -> int:
        """Compute a hash by value."""
        kind: Any = self.__class__
        return hash((kind, *(hash_of(getattr(self, name)) for name in _compared(kind))))


class FrozenArrays(ByValue):
    """A dataclass whose arrays are frozen at birth, and that is compared and hashed by value."""

    __slots__ = ()

    def __post_init__(self) -> None:
        """Freeze the arrays."""
        freeze_arrays(self)


@cache
def _compared(kind: type[Any]) -> list[str]:
    """Return the names of the fields by which a dataclass is compared."""
    return [field.name for field in dataclasses.fields(kind) if field.compare]


_LABELS = {1: 1, 0: 0, -1: -1, None: -1, "": -1}  # True is 1, and 1.0 too


def label_values(values: Any) -> NDArray[np.int8]:
    """Convert labels to 1, 0 and -1, before any cast can make values of what is none.

    True or 1, False or 0; -1, None, NaN, nothing or what is masked is unknown; any other value,
    such as 257, 0.5 or "False", is a `DataError`.

    >>> label_values([True, 0, None, float("nan")])
    array([ 1,  0, -1, -1], dtype=int8)
    >>> label_values(["False"])
    Traceback (most recent call last):
    meal_bayes.errors.DataError: Found the label 'False'; expected 1 or True, 0 or False, or None.
    """
    small = type(values) is np.ndarray and values.dtype == np.int8
    if small and ((values >= -1) & (values <= 1)).all():
        return np.asarray(values)
    # Values one by one, as a cast would make 257 to 1, and "False" to True.
    array = np.ma.filled(np.ma.asarray(values).astype(object), None)
    labels = np.empty(array.shape, np.int8)
    for index, value in np.ndenumerate(array):
        scalar = value.item() if isinstance(value, np.generic) else value
        unknown = repr(scalar) in ("<NA>", "nan")  # pandas' and IEEE's
        try:
            labels[index] = -1 if unknown else _LABELS[scalar]
        except (KeyError, TypeError):
            raise DataError(
                f"Found the label {scalar!r:.60}; expected 1 or True, 0 or False, or None."
            ) from None
    return labels


def check_kind(name: str, value: object, kind: type[Any]) -> None:
    """Refuse an argument that is not of a class, which users of other packages may give.

    >>> check_kind("domain", 5, dict)
    Traceback (most recent call last):
    meal_bayes.errors.SettingsError: domain is 5; give a value of class dict.
    """
    if not isinstance(value, kind):
        raise SettingsError(f"{name} is {value!r:.60}; give a value of class {kind.__name__}.")


def plain(value: Any) -> Any:  # noqa: PLR0911  a kind a line
    """Return a setting in Python's own types, which JSON knows; also inside lists and tables.

    A number, text or truth value of numpy, an array of no axes, a fraction and a decimal number are
    what they say.

    >>> plain({"seed": np.int64(3), "agents": (np.str_("bayes"), np.array(0.5))})
    {'seed': 3, 'agents': ('bayes', 0.5)}
    """
    if type(value) in (str, int, float, bool, NoneType):
        return value
    if isinstance(value, np.generic) or (isinstance(value, np.ndarray) and value.ndim == 0):
        value = value.item()
    if isinstance(value, bool | int | float):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real | Decimal):  # a fraction, or a float of more bits than Python's
        return as_float(value)
    if type(value) in (list, tuple):
        return type(value)(map(plain, value))
    if type(value) is dict:
        return {plain(key): plain(part) for key, part in value.items()}
    return value


def as_float(number: Any) -> float:
    """Return a number as a float; one that is too large is infinite, and so refused as such.

    >>> as_float(-(10**400))
    -inf
    """
    try:
        return float(number)
    except OverflowError:
        return np.inf if number > 0 else -np.inf
    except ValueError:  # of a signaling NaN
        return np.nan


def plain_fields(instance: Any) -> None:
    """Make the fields of a frozen dataclass `plain`, as classes of settings do at birth."""
    for field in dataclasses.fields(instance):
        if field.init:
            object.__setattr__(instance, field.name, plain(getattr(instance, field.name)))


def real_array(name: str, values: object) -> NDArray[np.float64]:
    """Return numbers as an array; refuse what is none, or is of lists of unequal lengths."""
    numbers: Any = values
    try:
        return np.array(numbers, dtype=float)
    except (TypeError, ValueError, OverflowError):  # the last of an integer beyond floats
        raise SettingsError(f"{name} is {numbers!r:.60}; give an array of numbers.") from None


def shaped_array(name: str, values: object, *shape: int) -> NDArray[np.float64]:
    """Return numbers as an array of a shape; refuse what is none.

    >>> shaped_array("prior", [0.5], 2)
    Traceback (most recent call last):
    meal_bayes.errors.SettingsError: prior has shape (1,); expected (2,).
    """
    array = real_array(name, values)
    if array.shape != shape:
        raise SettingsError(f"{name} has shape {array.shape}; expected {shape}.")
    return array


def whole_array(name: str, values: object, *shape: int) -> NDArray[np.int64]:
    """Return whole numbers as an array of a shape; refuse what is none."""
    if isinstance(values, np.ndarray) and values.dtype.kind in "iu" and values.shape == shape:
        return values
    array = shaped_array(name, values, *shape)
    whole = array.astype(np.int64) if (np.abs(array) < 2.0**53).all() else None  # nan is not
    if whole is None or not (whole == array).all():
        raise SettingsError(f"{name} is {values!r:.60}; give whole numbers.")
    return whole


def spread_array(name: str, values: object, *shape: int) -> NDArray[np.float64]:
    """Return numbers as an array of a shape, to which one, or a row of them, is repeated."""
    array = real_array(name, values)
    try:
        return np.array(np.broadcast_to(array, shape))
    except ValueError:
        raise SettingsError(
            f"{name} has shape {array.shape}; expected {shape}, or a number."
        ) from None


def real_vector(name: str, values: object) -> NDArray[np.float64]:
    """Return numbers as an array (n,); refuse what is none."""
    array = real_array(name, values)
    if array.ndim != 1:
        raise SettingsError(f"{name} has shape {array.shape}; give a list of numbers.")
    return array


def check_place(name: str, value: object, count: int) -> None:
    """Refuse what is no place among so many, counted from 0."""
    if not is_whole(value) or not 0 <= value < count:
        raise SettingsError(f"{name} is {value!r:.60}; give a whole number from 0 to {count - 1}.")


def check_whole(name: str, value: object) -> int:
    """Return a whole number, 0 or more, as an int; refuse any other setting."""
    number = plain(value)
    if not is_whole(number) or number < 0:
        raise SettingsError(f"{name} is {value!r:.60}; give a whole number, 0 or more.")
    return number


def is_whole(value: object) -> TypeGuard[int]:
    """Return whether a setting is one whole number; True and False are none."""
    return isinstance(value, int | np.integer) and not isinstance(value, bool)


def is_number(value: object) -> TypeGuard[float]:
    """Return whether a setting is one real number that floats hold; True and False are none."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= _FINITE
    return isinstance(value, Real)


def check_seconds(name: str, value: object, *, or_none: bool = False) -> None:
    """Refuse a setting that is no number of seconds, 0 or more."""
    value = plain(value)
    if not ((or_none and value is None) or (is_number(value) and value >= 0)):
        raise SettingsError(f"{name} is {value!r:.60}; give seconds, 0 or more.")


def check_yes_no(name: str, value: object) -> None:
    """Refuse a setting that is neither True nor False: "no" would be as good as True."""
    if not isinstance(plain(value), bool):
        raise SettingsError(f"{name} is {value!r:.60}; give True or False.")


def check_amount(name: str, value: object, most: float = _FINITE, *, or_none: bool = False) -> None:
    """Refuse a setting that is no number above 0, up to the most: finite, where that is."""
    value = plain(value)
    if (or_none and value is None) or (is_number(value) and 0 < value <= most):
        return
    expected = "a number above 0" if np.isinf(most) else "a finite number above 0"
    expected += f", at most {most:g}" if most < _FINITE else ""
    expected += ", or None" if or_none else ""
    raise SettingsError(f"{name} is {value!r:.60}; give {expected}.")


class Rows:
    """An array that grows at its end, at constant cost; `width` is that of its further axes."""

    def __init__(self, dtype: type | np.dtype[Any], *width: int) -> None:
        self._held: NDArray[Any] = np.empty((8, *width), dtype)
        self._count = 0

    def __len__(self) -> int:
        return self._count

    @property
    def values(self) -> NDArray[Any]:
        """The rows so far, (n, ...)."""
        return self._held[: self._count]

    def extend(self, rows: Any) -> None:
        """Append rows (m, ...)."""
        needed = self._count + len(rows)
        while needed > len(self._held):
            self._held = np.concatenate([self._held, np.empty_like(self._held)])
        self._held[self._count : needed] = rows
        self._count = needed

    def cut(self, count: int) -> None:
        """Remove the rows behind the first `count`."""
        self._count = min(self._count, count)

    def widen(self, columns: int, value: Any) -> None:
        """Append columns to rows (n,W), each filled with a value."""
        added = np.full((len(self._held), columns), value, self._held.dtype)
        self._held = np.concatenate([self._held, added], axis=1)

    def append(self, row: Any) -> int:
        """Append a row, and return its number."""
        self.extend(np.asarray(row, self._held.dtype)[None])
        return self._count - 1

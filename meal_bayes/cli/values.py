"""Types of option values, whose ranges are checked before any work."""

import re
from typing import Any

import click

from meal_bayes.untrusted import LARGEST

__all__ = ["LARGEST", "Address", "Chance", "Finite", "Shares", "Whole"]
MOST_TRIALS = 10_000_000
MOST_JOBS = 1024
LARGEST_SEED = 2**63 - 1
_WHOLE = re.compile(r"\s*[+-]?\d{1,30}\s*", re.ASCII)
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,9})?\s*", re.ASCII)
_ADDRESS = re.compile(
    r"((tcp|tls|ws|wss|ucx)://)?[\w.-]+:\d{1,5}|\[[\da-fA-F:]+\]:\d{1,5}", re.ASCII
)


class Whole(click.ParamType[int]):
    """A whole number in a range, in plain digits."""

    name = "integer"

    def __init__(self, low: int, high: int) -> None:
        self._low, self._high = low, high
        self._expected = f"expected a whole number from {low} to {high}"

    def convert(self, value: Any, param: Any, ctx: Any) -> int:
        """Read the digits, but not 1_0 or digits of other scripts, as Python does."""
        if isinstance(value, str) and not _WHOLE.fullmatch(value):
            self.fail(f"{value!r} is not a valid integer; {self._expected}.", param, ctx)
        if not self._low <= int(value) <= self._high:
            self.fail(f"{value} is not in the range; {self._expected}.", param, ctx)
        return int(value)


class Finite(click.ParamType[float]):
    """A finite number in a range; its bounds belong to it unless they are open."""

    name = "number"

    def __init__(
        self, low: float, high: float, *, min_open: bool = False, max_open: bool = False
    ) -> None:
        self._low, self._high, self._open = low, high, (min_open, max_open)
        words = "above" if min_open else "not below", "below" if max_open else "not above"
        self._expected = f"expected a finite number {words[0]} {low:g} and {words[1]} {high:g}"

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Read the number; neither NaN nor infinity is one."""
        if isinstance(value, str) and not _NUMBER.fullmatch(value):
            self.fail(f"{value!r} is not a valid number; {self._expected}.", param, ctx)
        number = float(value)
        at_end = (number == self._low and self._open[0]) or (number == self._high and self._open[1])
        if at_end or not self._low <= number <= self._high:
            self.fail(f"{value} is not in the range; {self._expected}.", param, ctx)
        return number


class Shares(click.ParamType[Any]):
    """Three parts of the objects, such as 33/33/34."""

    name = "A/B/C"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Read three whole numbers."""
        if isinstance(value, tuple):
            return value
        parts = value.split("/")
        if len(parts) != 3 or not all(_WHOLE.fullmatch(p) and 0 < int(p) <= 10**6 for p in parts):
            self.fail(
                f"split is {value!r}; give three whole numbers above 0, such as 33/33/34.",
                param, ctx,
            )  # fmt: skip
        return tuple(map(int, parts))


class Chance(click.ParamType[Any]):
    """A behavior and its probability, such as grasp=0.5."""

    name = "BEHAVIOR=P"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Read the name and the number."""
        if isinstance(value, tuple):
            return value
        name, _, chance = value.partition("=")
        if not name.strip() or not _NUMBER.fullmatch(chance) or not 0 < float(chance) <= 1:
            self.fail(
                f"success is {value!r}; give it as grasp=0.5, above 0 and at most 1.", param, ctx
            )
        return name.strip(), float(chance)


class Address(click.ParamType[Any]):
    """Address of a Dask scheduler."""

    name = "ADDRESS"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Check the form of the address."""
        if not _ADDRESS.fullmatch(value):
            self.fail(f"{value!r} is no address; give it as tcp://host:8786.", param, ctx)
        return value

"""What values options take: each with its range, so that a bad one is told before any work."""

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
_ADDRESS = re.compile(r"((tcp|tls|ws|wss|ucx)://)?[\w.-]+:\d{1,5}|\[[\da-fA-F:]+\]:\d{1,5}", re.ASCII)


class Whole(click.IntRange):
    """A whole number in a range, in plain digits."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Read the digits; Python alone would take 1_0, and digits of other scripts."""
        if isinstance(value, str) and not _WHOLE.fullmatch(value):
            self.fail(f"{value!r} is not a valid integer; {self.expected}.", param, ctx)
        if not self.min <= int(value) <= self.max:
            self.fail(f"{value} is not in the range; {self.expected}.", param, ctx)
        return int(value)

    @property
    def expected(self) -> str:
        """The range in words."""
        return f"expected a whole number from {self.min} to {self.max}"


class Finite(click.FloatRange):
    """A finite number in a range; its bounds belong to it unless they are open."""

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Read the number; neither NaN nor infinity is one."""
        if isinstance(value, str) and not _NUMBER.fullmatch(value):
            self.fail(f"{value!r} is not a valid number; {self.expected}.", param, ctx)
        number = float(value)
        low = number > self.min if self.min_open else number >= self.min
        high = number < self.max if self.max_open else number <= self.max
        if not (low and high):
            self.fail(f"{value} is not in the range; {self.expected}.", param, ctx)
        return number

    @property
    def expected(self) -> str:
        """The range in words."""
        low = "above" if self.min_open else "not below"
        high = "below" if self.max_open else "not above"
        return f"expected a finite number {low} {self.min:g} and {high} {self.max:g}"


class Shares(click.ParamType):
    """Three shares of the objects, such as 33/33/34."""

    name = "A/B/C"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Read three whole numbers."""
        if isinstance(value, tuple):
            return value
        parts = value.split("/")
        if len(parts) != 3 or not all(_WHOLE.fullmatch(p) and 0 < int(p) <= 10**6 for p in parts):  # noqa: PLR2004
            self.fail(
                f"split is {value!r}; give three whole numbers above 0, such as 33/33/34.",
                param, ctx,
            )  # fmt: skip
        return tuple(map(int, parts))


class Chance(click.ParamType):
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


class Address(click.ParamType):
    """Where a Dask scheduler listens."""

    name = "ADDRESS"

    def convert(self, value: Any, param: Any, ctx: Any) -> Any:
        """Check the form; whether somebody listens there is seen when it is asked."""
        if not _ADDRESS.fullmatch(value):
            self.fail(f"{value!r} is no address; give it as tcp://host:8786.", param, ctx)
        return value

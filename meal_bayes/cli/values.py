"""Types of option values, whose ranges are checked before any work."""

import math
import re
from typing import Any

import click

from meal_bayes.untrusted import LARGEST

__all__ = ["LARGEST", "Address", "Chance", "Finite", "Shares"]
MOST_TRIALS = 10_000_000
MOST_JOBS = 1024
LARGEST_SEED = 2**63 - 1
_WHOLE = re.compile(r"\s*[+-]?\d{1,30}\s*", re.ASCII)
_NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d{1,9})?\s*", re.ASCII)
_ADDRESS = re.compile(
    r"((tcp|tls|ws|wss|ucx)://)?[\w.-]+:\d{1,5}|\[[\da-fA-F:]+\]:\d{1,5}", re.ASCII
)


class Finite(click.FloatRange):
    """A finite number in a range: click's, which takes NaN, without it."""

    def convert(self, value: Any, param: Any, ctx: Any) -> float:
        """Read the number."""
        number = float(super().convert(value, param, ctx))
        if math.isnan(number):
            self.fail(f"{value!r} is not in the range {self._describe_range()}.", param, ctx)
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

"""Types of option values, whose ranges are checked before any work."""

import math
import re
from typing import Any

import click

from meal_bayes.untrusted import LARGEST

__all__ = ["LARGEST", "Finite", "address", "chance", "shares"]
MOST_TRIALS = 10_000_000
MOST_JOBS = 1024
LARGEST_SEED = 2**63 - 1
_SHARES = re.compile(r"([1-9]\d{0,5})/([1-9]\d{0,5})/([1-9]\d{0,5})", re.ASCII)
_CHANCE = re.compile(r"(.*[^\s=].*)=((0?\.|[01]\.?)\d*([eE]-?\d{1,3})?)", re.ASCII)
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


def shares(text: str) -> tuple[int, ...]:
    """Read three parts of the objects, such as 33/33/34."""
    found = _SHARES.fullmatch(text)
    if found is None:
        raise click.BadParameter(
            f"split is {text!r}; give three whole numbers above 0, such as 33/33/34."
        )
    return tuple(map(int, found.groups()))


def chance(text: str) -> tuple[str, float]:
    """Read a behavior and its probability, such as grasp=0.5."""
    found = _CHANCE.fullmatch(text)
    if found is None or not 0 < float(found[2]) <= 1:
        raise click.BadParameter(
            f"success is {text!r}; give it as grasp=0.5, above 0 and at most 1."
        )
    return found[1].strip(), float(found[2])


def address(text: str) -> str:
    """Read the address of a Dask scheduler."""
    if not _ADDRESS.fullmatch(text):
        raise click.BadParameter(f"{text!r} is no address; give it as tcp://host:8786.")
    return text

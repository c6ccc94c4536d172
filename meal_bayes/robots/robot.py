"""The interface that the driver of a real robot implements; it uses names alone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Outcome:
    """The outcome of one behavior.

    Attributes
    ----------
    state : str
        The observed state x after it, one of the domain's diagram.
    features : Mapping[str, ArrayLike] | None
        The features (D,) of each of the behavior's modalities; None where nothing was sensed
        (the behavior failed, or has no modalities).
    answers : Mapping[str, bool] | None
        Of a behavior that asks a person: what the person said, by attribute.
    recording : int | None
        Of a robot that replays stored percepts: which of them this is. A real robot leaves it out.
    """

    state: str
    features: Mapping[str, ArrayLike] | None = None
    answers: Mapping[str, bool] | None = None
    recording: int | None = None


class Robot(Protocol):
    """A robot with an object in front of it; implement these two methods for your own."""

    def start(self) -> str:
        """Start a trial, and return the name of the observed state x0."""
        ...

    def execute(self, behavior: str) -> Outcome:
        """Execute the behavior of that name, and return its outcome."""
        ...

"""The seam where a body plugs in: what the driver of a real robot implements, by names alone."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

from numpy.typing import ArrayLike


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of one behavior.

    Attributes
    ----------
    state : str
        The observed state x after it, one of the domain's diagram.
    features : mapping, optional
        The features (D,) felt in each of the behavior's modalities; None where nothing was felt
        (the behavior failed, or senses nothing).
    answers : mapping, optional
        Of a behavior that asks a person: what the person said, by attribute.
    recording : int, optional
        Of a robot that replays stored percepts: which of them this is. A real robot leaves it out.
    """

    state: str
    features: Mapping[str, ArrayLike] | None = None
    answers: Mapping[str, bool] | None = None
    recording: int | None = None


class Robot(Protocol):
    """A body with an object in front of it. Implement these two methods for a robot of your own."""

    def start(self) -> str:
        """Return to the start of a trial, and return the name of the observed state x0."""
        ...

    def execute(self, behavior: str) -> Outcome:
        """Execute the behavior of that name, and observe what came of it."""
        ...

"""The seam where a body plugs in: what a real robot's driver implements."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from meal_bayes.datasets import Instance


@dataclass(frozen=True, slots=True)
class Execution:
    """What came of one behavior: the next x, and the instance f_a if one was recorded."""

    next_x: int
    instance: Instance | None  # None: failed, illegal, senseless, or recordings used up


class Robot(Protocol):
    """A body. Implement these two methods to run MORC on your own robot."""

    def start(self, object_index: int) -> int:
        """Put the object in front of the robot and return the observed x0."""
        ...

    def execute(self, behavior: int, rng: np.random.Generator) -> Execution:
        """Execute behavior `behavior` (its index in the domain) and observe the next x."""
        ...

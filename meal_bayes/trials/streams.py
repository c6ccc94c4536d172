"""The random streams of one trial."""

from collections.abc import Sequence
from functools import cached_property

import numpy as np

from meal_bayes.seeds import stream


class Streams:
    """The random streams of one trial, each made when it is first drawn from.

    Parameters
    ----------
    seed, key : int, tuple
        Name the streams of the trial.
    agent : str
        Names, with these, the stream of the planner.
    """

    def __init__(self, seed: int, key: Sequence[str | int], agent: str) -> None:
        self._seed, self._key, self._agent = seed, key, agent

    @cached_property
    def percepts(self) -> np.random.Generator:
        """Of percepts that are drawn from tables; the same for every agent."""
        return stream(self._seed, "percepts", *self._key)

    @cached_property
    def planner(self) -> np.random.Generator:
        """Of the agent."""
        return stream(self._seed, "planner", self._agent, *self._key)

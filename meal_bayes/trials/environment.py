"""What a trial runs in: a robot's boundary, a perceiver, random streams; and who records it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.perception import Perceiver
from meal_bayes.robots import Boundary
from meal_bayes.seeds import stream
from meal_bayes.trials.trial import Step, Trial


class Streams(NamedTuple):
    """The random streams of one trial.

    Attributes
    ----------
    percepts : of percepts that are drawn from tables; the same for every agent.
    planner : of the agent.
    """

    percepts: np.random.Generator
    planner: np.random.Generator

    @classmethod
    def of(cls, seed: int, key: Sequence[str | int], agent: str) -> "Streams":
        """Return the streams that seed and key name, and for the planner the agent as well."""
        return cls(stream(seed, "percepts", *key), stream(seed, "planner", agent, *key))


class Recorder(Protocol):
    """Writes a trial as it happens: each step before the next behavior is named."""

    @property
    def path(self) -> Path:
        """Where the trial is recorded."""
        ...

    def begin(self, trial: Trial) -> None:
        """Record a trial that has no steps yet."""
        ...

    def step(self, step: Step) -> None:
        """Record the next step."""
        ...

    def end(self, trial: Trial) -> None:
        """Record the whole trial."""
        ...


@dataclass(frozen=True, slots=True)
class Environment:
    """What a trial runs in.

    Attributes
    ----------
    boundary : Boundary
        Checks what the robot returns.
    perceiver : Perceiver
        Turns sensor data into percept levels.
    streams : Streams
        Random streams of the trial.
    truth : mapping or array, optional
        See `truth_of`; compared with the report only, neither policy nor belief sees it.
    counts : (N,E,2,K) array, optional
        Labeled percepts behind the MOMDP, for the record alone; see `Trial`.
    """

    boundary: Boundary
    perceiver: Perceiver
    streams: Streams
    truth: Mapping[str, bool] | ArrayLike | None = None
    counts: NDArray[np.float64] | None = None

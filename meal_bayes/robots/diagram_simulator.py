"""Simulation of the transition diagram with random numbers common to all agents."""

import bisect
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import Domain, TransitionDiagram, unknown
from meal_bayes.errors import SettingsError

Rows = tuple[tuple[tuple[float, ...], ...], ...]  # (E,X,X)

_BLOCK = 16  # executions of each behavior whose uniform draws are made at once


class Move(NamedTuple):
    """The outcome of one execution.

    Attributes
    ----------
    state : name of the next state.
    perceivable : whether a percept comes.
    uniform : a draw from [0, 1) that belongs to this execution alone.
    """

    state: str
    perceivable: bool
    uniform: float


class DiagramSimulator:
    """The state x of one trial.

    The k-th execution of a behavior has the same uniform draws whatever else was executed before:
    agents that are compared meet the same failures (common random numbers). To that end they are
    drawn in blocks for all behaviors at once, and the generator serves nothing else.

    Parameters
    ----------
    domain : behaviors and diagram.
    rng : generator of the trial's failures.
    """

    def __init__(self, domain: Domain, rng: np.random.Generator) -> None:
        self._rng = rng
        self._states = domain.diagram.states
        self._names = {name: e for e, name in enumerate(domain.behavior_names)}
        self._senses = [behavior.senses for behavior in domain.behaviors]
        self._reach, self._shows = _compile(domain.diagram, domain.behavior_names)
        self._start = domain.diagram.states.index(domain.diagram.start)
        self._x: int | None = None
        self._blocks: list[NDArray[np.float64]] = []  # (E,_BLOCK,3) each
        self._executed = [0] * len(self._names)

    def start(self) -> str:
        """Start a trial and return the name of x0."""
        self._x, self._blocks = self._start, []
        self._executed = [0] * len(self._names)
        return self._states[self._start]

    def move(self, name: str) -> Move:
        """Execute a behavior and return its outcome."""
        if self._x is None:
            raise SettingsError("The robot is in no trial yet; call start() first.")
        if name not in self._names:
            raise SettingsError(unknown("behavior", name, self._names))
        behavior = self._names[name]
        block, place = divmod(self._executed[behavior], _BLOCK)
        while len(self._blocks) <= block:
            self._blocks.append(self._rng.random((len(self._names), _BLOCK, 3)))
        self._executed[behavior] += 1
        outcome, shown, uniform = self._blocks[block][behavior, place].tolist()
        reach = self._reach[behavior][self._x]
        next_x = bisect.bisect_right(reach, outcome)
        perceivable = self._senses[behavior] and shown < self._shows[behavior][self._x][next_x]
        self._x = next_x
        return Move(self._states[next_x], perceivable, uniform)


@lru_cache(maxsize=16)
def _compile(diagram: TransitionDiagram, behaviors: tuple[str, ...]) -> tuple[Rows, Rows]:
    """Return the cumulative Pr(x' | x, behavior) over x', and Pr(a percept comes), each (E,X,X).

    Tuples, as a single number is read ten times faster from them than from an array.
    """
    arrays = diagram.compile(behaviors)
    reach = arrays.transition.cumsum(axis=2)
    reach[reach > 1 - 1e-12] = 1.0  # rounding must not leave room for impossible states
    return _tuples(reach), _tuples(arrays.observation_probability)


def _tuples(array: NDArray[np.float64]) -> Rows:
    return tuple(tuple(tuple(row) for row in matrix) for matrix in array.tolist())

"""Behaviors that yield nothing: a dead sensor, or a motion that never works, is not repeated."""

import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, History, Policy

_LEAST = 2  # executions in a row without yield, before which nothing is concluded,
_CHANCE = 0.05  # and the largest probability of them all by the diagram's own failures
_SILENT = (
    "{!r} yielded nothing several times in a row: it is not counted on until it does again. The "
    "warnings of the trial's steps say what was wrong with its features, if any came."
)
_STUCK = (
    "{!r} moved nothing several times in a row: it is not counted on until it does again. Look "
    "whether the object is where the robot takes it to be."
)


def faults_of(
    momdp: MOMDP, history: History, expected: NDArray[np.float64]
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Find the behaviors whose latest executions yielded nothing, more often than chance allows.

    An execution of a behavior that senses yields nothing where no percept comes; of one that only
    moves, where x stays. How often they fail by chance is `expected`, Pr(x' | x, behavior)
    (E,X,X). Returned are those that fail (E,), and which of these did not move
    either (E,).
    """
    chance = np.ones(momdp.n_behaviors)
    count = np.zeros(momdp.n_behaviors, int)
    remaining = momdp.limit.copy()  # a robot that replays runs out of recordings
    still = np.ones(momdp.n_behaviors, bool)
    x = momdp.start
    for e, perceived, after in zip(history.actions, history.perceived, history.moved, strict=True):
        percept = float(expected[e, x] @ momdp.observation_probability[e, x])
        if perceived or (percept == 0 and after != x):
            chance[e] = 1.0
            count[e] = 0
            still[e] = True
            remaining[e] -= perceived
        elif remaining[e] > 0 or percept == 0:
            chance[e] *= 1.0 - percept if percept else expected[e, x, x]
            count[e] += 1
            still[e] &= after == x
        x = after
    failing = (count >= _LEAST) & (chance <= _CHANCE)
    return failing, failing & still


def without(momdp: MOMDP, failing: NDArray[np.bool_], stuck: NDArray[np.bool_]) -> MOMDP:
    """Return the problem in which failing behaviors sense nothing, and stuck ones do nothing."""
    silent = failing[:, None, None]
    idle = stuck[:, None, None]
    return replace(
        momdp,
        observation_probability=np.where(silent, 0.0, momdp.observation_probability),
        transition=np.where(idle, np.eye(len(momdp.x_names)), momdp.transition),
        legal=momdp.legal & ~stuck,
    )


@dataclass(slots=True)
class FaultTolerant:
    """A policy that is made anew, without them, when behaviors turn out to fail in a trial."""

    momdp: MOMDP
    policy: Policy  # of this problem
    solve: Callable[[MOMDP], Policy]  # makes the policy of the problem without them
    expected: NDArray[np.float64]  # (E,X,X), see `faults_of`
    _failing: NDArray[np.bool_] | bool = False  # (E,), or none yet

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action among what works; warn of what begins to fail."""
        failing, stuck = faults_of(self.momdp, history, self.expected)
        if (failing != self._failing).any():
            senses = np.asarray(self.momdp.observation_probability.any(axis=(1, 2)))
            for e in np.flatnonzero(failing > self._failing):
                name = self.momdp.behavior_names[e]
                # Heard in Python alone; the warnings that steps keep are the session's.
                warnings.warn(
                    _SILENT.format(name) if senses[e] else _STUCK.format(name), stacklevel=2
                )
            self.policy = self.solve(without(self.momdp, failing, stuck))
            self._failing = failing
        return self.policy.decide(history, rng)

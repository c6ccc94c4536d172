"""Behaviors that yield nothing: a dead sensor, or a motion that never works, is not repeated."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain.diagram import TransitionArrays
from meal_bayes.look import warn_user
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import Decision, History, Policy

_LEAST = 2  # executions in a row without yield, before which nothing is concluded,
CHANCE = 0.05  # and the largest probability of them all by the diagram's own failures
_SILENT = (
    "{!r} yielded nothing several times in a row. The robot does not rely on it until it "
    "yields a percept again. If features were returned, the warnings of the trial's steps say "
    "what was wrong with them."
)
_STUCK = (
    "{!r} moved nothing several times in a row. The robot does not rely on it until "
    "it succeeds again. Check that the object is where the robot expects it."
)


class Nothing(NamedTuple):
    """The latest executions of each behavior (E,) that yielded nothing, in a row.

    `chance` is the probability of them all by failures, `number` how many they are, `unread` how
    many of these had features that could not be read, and `still` whether none moved anything.
    """

    chance: NDArray[np.float64]
    number: NDArray[np.int64]
    unread: NDArray[np.int64]
    still: NDArray[np.bool_]


def nothing_came(momdp: MOMDP, history: History, usual: TransitionArrays) -> Nothing:
    """Return what yielded nothing of late, and how likely that is where behaviors fail as `usual`.

    An execution of a behavior that senses yields nothing where no percept comes; of one that only
    moves, as one does whose recordings are used up, where x stays. How often they fail is what the
    domain says, not what was learned: that a behavior failed in trials before does not explain that
    it fails.
    """
    size = momdp.n_behaviors
    nothing = Nothing(
        chance=np.ones(size),
        number=np.zeros(size, int),
        unread=np.zeros(size, int),
        still=np.ones(size, bool),
    )
    remaining = momdp.limit.copy()  # a robot that replays runs out of recordings
    unread = set(history.unread)
    x = momdp.start
    executed = zip(history.actions, history.perceived, history.moved, strict=True)
    for index, (e, perceived, after) in enumerate(executed):
        shows = usual.observation_probability[e, x] * (momdp.observation_probability[e, x] > 0)
        percept = float(usual.transition[e, x] @ shows) if remaining[e] > 0 else 0.0
        if perceived or (percept == 0 and after != x):
            nothing.chance[e] = 1.0
            nothing.number[e] = 0
            nothing.unread[e] = 0
            nothing.still[e] = True
            remaining[e] -= perceived
        else:
            nothing.chance[e] *= 1.0 - percept if percept else usual.transition[e, x, x]
            nothing.number[e] += 1
            nothing.unread[e] += index in unread
            nothing.still[e] &= after == x
        x = after
    return nothing


def faults_of(
    momdp: MOMDP, history: History, usual: TransitionArrays
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Find the behaviors whose latest executions yielded nothing, more often than chance allows.

    Chance explains no features that cannot be read. Returned are those that fail (E,), and which
    of these did not move either (E,).
    """
    nothing = nothing_came(momdp, history, usual)
    failing = (nothing.number >= _LEAST) & (nothing.chance <= CHANCE)
    failing |= nothing.unread >= _LEAST
    return failing, failing & nothing.still


def without(momdp: MOMDP, failing: NDArray[np.bool_], stuck: NDArray[np.bool_]) -> MOMDP:
    """Return the problem in which failing behaviors sense nothing, and stuck ones do nothing."""
    silent = failing[:, None, None]
    fails = stuck[:, None, None]
    return replace(
        momdp,
        observation_probability=np.where(silent, 0.0, momdp.observation_probability),
        transition=np.where(fails, np.eye(len(momdp.x_names)), momdp.transition),
        legal=momdp.legal & ~stuck,
    )


@dataclass(slots=True)
class FaultTolerant:
    """Policy that is solved again, without failing behaviors, if behaviors fail in a trial."""

    momdp: MOMDP
    policy: Policy  # of this problem
    solve: Callable[[MOMDP], Policy]  # makes the policy of the problem without them
    usual: TransitionArrays  # by the domain, see `nothing_came`
    _failing: NDArray[np.bool_] | bool = False  # (E,), or none yet

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action without relying on failing behaviors; warn of new ones."""
        failing, stuck = faults_of(self.momdp, history, self.usual)
        if (failing != self._failing).any():
            senses = np.asarray(self.momdp.observation_probability.any(axis=(1, 2)))
            for e in np.flatnonzero(failing > self._failing):
                name = self.momdp.behavior_names[e]
                # Heard in Python alone; the warnings that steps keep are the session's.
                warn_user(_SILENT.format(name) if senses[e] else _STUCK.format(name))
            self.policy = self.solve(without(self.momdp, failing, stuck))
            self._failing = failing
        return self.policy.decide(history, rng)

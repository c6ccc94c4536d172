"""Recording: every behavior on every object, as often as asked, with what went wrong tried again."""

from collections import Counter
from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from meal_bayes.robots.simulated_arm.arm import SimulatedArm
from meal_bayes.robots.simulated_arm.behaviors import GRASPED, LEGAL, LIFTED, READY
from meal_bayes.robots.simulated_arm.objects import ObjectParameters
from meal_bayes.robots.simulated_arm.physics import RobotFault

Recording = Mapping[tuple[str, str], NDArray[np.float64]]  # (behavior, modality) -> (D,)
Happened = Counter[tuple[str, str, str]]  # (state, behavior, state after)

ORDER = ("look", "press", "grasp", "lift", "hold", "shake", "lower", "drop", "push")
ATTEMPTS = 4  # at each behavior of a recording
FAULT = "fault"  # in place of the state after

_TOWARDS = {READY: "grasp", GRASPED: "lift"}  # what comes nearer to `LIFTED`


def record_object(
    parameters: ObjectParameters,
    recordings: int,
    seed: int,
    *path: str | int,
    on_execution: Callable[[str, str, str], None] = lambda *_: None,
) -> list[Recording]:
    """Record an object: one mapping a recording, without the behaviors that never succeeded.

    Parameters
    ----------
    seed, path : name the random streams.
    on_execution : called with (state, behavior, state after or `FAULT`) of everything executed.
    """
    return [
        _record(SimulatedArm(parameters, seed, *path, number), on_execution)
        for number in range(recordings)
    ]


def _record(arm: SimulatedArm, on_execution: Callable[[str, str, str], None]) -> Recording:
    found: dict[tuple[str, str], NDArray[np.float64]] = {}
    state = arm.start()
    for behavior in ORDER:
        for _ in range(ATTEMPTS):
            state, features = _attempt(arm, state, behavior, on_execution)
            if features is not None:
                found |= {(behavior, modality): values for modality, values in features.items()}
                break
    return found


def _attempt(
    arm: SimulatedArm, state: str, behavior: str, on_execution: Callable[[str, str, str], None]
) -> tuple[str, Mapping[str, NDArray[np.float64]] | None]:
    """Bring the object where the behavior is legal, and execute it; one slip ends the attempt."""
    while True:
        here = state in LEGAL[behavior]
        step = behavior if here else _way(state, LEGAL[behavior])
        try:
            outcome = arm.execute(step)
        except RobotFault:
            on_execution(state, step, FAULT)
            return arm.start(), None
        on_execution(state, step, outcome.state)
        slipped = step in _TOWARDS.values() and outcome.state not in (GRASPED, LIFTED)
        state = outcome.state
        if here or slipped:
            return state, outcome.features if here else None


def _way(state: str, goals: tuple[str, ...]) -> str:
    """Choose what leads from a state towards one of the goals."""
    reachable = state in _TOWARDS and READY not in goals
    return _TOWARDS[state] if reachable else "reinit"

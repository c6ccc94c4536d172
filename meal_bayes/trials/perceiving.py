"""What is perceived of an outcome without features: a person's answers, or nothing."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain.diagram import TransitionArrays
from meal_bayes.momdp import MOMDP
from meal_bayes.planners import History
from meal_bayes.robots.robot import NO_PERCEPT
from meal_bayes.trials.faults import CHANCE, nothing_came


def answered(
    answers: Mapping[str, bool], attributes: Sequence[str], levels: int
) -> tuple[NDArray[np.int8] | None, str]:
    """Return percept levels (N,) of what a person said, or None, and a warning."""
    missing = [name for name in attributes if name not in answers]
    if missing:
        return None, f"{NO_PERCEPT}: the person did not answer about {missing}"
    sure = (0, levels - 1)  # the two extreme levels
    return np.array([sure[bool(answers[name])] for name in attributes], np.int8), ""


def silence(momdp: MOMDP, usual: TransitionArrays, before: History, e: int, next_x: int) -> str:
    """Return a warning where a robot's behavior shows nothing, more often than failures explain.

    How often it fails is `usual`; a failure that this explains is one that is shown as failed.
    """
    if not momdp.observation_probability[e, before.belief.x, next_x] > 0:
        return ""
    now = before.after(before.belief.at(next_x), e, perceived=False, cost=0.0)
    if nothing_came(momdp, now, usual).chance[e] > CHANCE:
        return ""
    return f"nothing perceived by {momdp.behavior_names[e]}: it sensed nothing, or it failed"

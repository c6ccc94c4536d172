"""What is perceived of an outcome without features: a person's answers, or nothing."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP


def answered(
    answers: Mapping[str, bool], attributes: Sequence[str], levels: int
) -> tuple[NDArray[np.int8] | None, str]:
    """Return percept levels (N,) of what a person said, or None, and a warning."""
    missing = [name for name in attributes if name not in answers]
    if missing:
        return None, f"no percept: the person did not answer about {missing}"
    sure = (0, levels - 1)  # the two extreme levels
    return np.array([sure[bool(answers[name])] for name in attributes], np.int8), ""


def silence(momdp: MOMDP, x: int, e: int, next_x: int) -> str:
    """Return a warning where a robot's behavior that may have succeeded showed nothing."""
    if not momdp.observation_probability[e, x, next_x] > 0:
        return ""
    return f"nothing perceived by {momdp.behavior_names[e]}: it sensed nothing, or it failed"

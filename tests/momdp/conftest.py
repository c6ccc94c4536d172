"""What the tests of beliefs share."""

from collections.abc import Callable, Iterable

import numpy as np
import pytest

from meal_bayes.momdp import MOMDP, Belief, Transition, initial_belief, update_belief


@pytest.fixture(scope="session")
def follow() -> Callable[..., list[Belief]]:
    """Filter the percept levels, or None, of named behaviors; return the belief after each."""

    def beliefs(momdp: MOMDP, steps: Iterable[tuple[str, list[int] | None]]) -> list[Belief]:
        belief, after = initial_belief(momdp), []
        for behavior, levels in steps:
            observation = None if levels is None else np.array(levels, dtype=np.int8)
            action = momdp.behavior_names.index(behavior)
            belief = update_belief(belief, momdp, Transition(action, belief.x, observation))
            after.append(belief)
        return after

    return beliefs

"""A robot without recordings: every success draws a fresh instance from a synthetic model."""

import numpy as np

from meal_bayes.datasets import Instance, SyntheticModel
from meal_bayes.errors import SettingsError
from meal_bayes.robots.recorded import ANSWERED
from meal_bayes.robots.robot import Execution
from meal_bayes.robots.walk import DiagramWalk
from meal_bayes.seeds import stream


class SimulatedRobot:
    """Acts by the diagram; the k-th execution of a behavior feels the same for every agent."""

    def __init__(self, model: SyntheticModel) -> None:
        self._model = model
        self._walk = DiagramWalk(model.domain)
        self._object = -1
        self._drawn = [0] * len(model.domain.behaviors)

    def start(self, object_index: int) -> int:
        """Put the object in front of the robot and return x0."""
        if not 0 <= object_index < len(self._model.objects):
            raise SettingsError(
                f"Object {object_index} does not exist; expected 0 to "
                f"{len(self._model.objects) - 1}."
            )
        self._object = object_index
        self._drawn = [0] * len(self._model.domain.behaviors)
        return self._walk.start()

    def execute(self, behavior: int, rng: np.random.Generator) -> Execution:
        """Execute a behavior; a success gives an instance that nobody has met before."""
        move = self._walk.move(behavior, rng)
        if not move.perceivable:
            return Execution(move.next_x, None)
        kind = self._model.domain.behaviors[behavior]
        if not kind.modalities:
            return Execution(move.next_x, Instance(self._object, kind.name, ANSWERED))
        recording = self._drawn[behavior]
        self._drawn[behavior] += 1
        # The execution's own luck seeds its features, so that no other draw can shift them.
        own = stream(int(move.luck * 2**53), "features", kind.name)
        instance = self._model.draw(self._object, kind.name, own, recording=recording)
        return Execution(move.next_x, instance)

"""A robot without recordings: every success draws a new instance from a synthetic model."""

import numpy as np

from meal_bayes.datasets import SyntheticModel
from meal_bayes.errors import SettingsError
from meal_bayes.robots.diagram_simulator import DiagramSimulator
from meal_bayes.robots.recorded import ANSWERED
from meal_bayes.robots.robot import Outcome
from meal_bayes.seeds import stream


class SimulatedRobot:
    """A robot in the diagram; the k-th execution of a behavior senses the same for every agent.

    Parameters
    ----------
    model : of the features.
    object_index : the object in front of the robot.
    failures : generator of failures.
    """

    def __init__(
        self, model: SyntheticModel, object_index: int, failures: np.random.Generator
    ) -> None:
        if not 0 <= object_index < len(model.objects):
            raise SettingsError(
                f"Object {object_index} does not exist; expected 0 to {len(model.objects) - 1}."
            )
        self._model, self._object = model, object_index
        self._simulator = DiagramSimulator(model.domain, failures)
        self._drawn = dict.fromkeys(model.domain.behavior_names, 0)

    def start(self) -> str:
        """Start a trial in x0."""
        self._drawn = dict.fromkeys(self._drawn, 0)
        return self._simulator.start()

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior; a success senses new features."""
        move, domain = self._simulator.move(behavior), self._model.domain
        if not move.perceivable:
            return Outcome(move.state)
        if not domain.behaviors[domain.behavior_index(behavior)].modalities:
            return Outcome(move.state, recording=ANSWERED)
        recording = self._drawn[behavior]
        self._drawn[behavior] += 1
        # The execution's own draw seeds its features, so that no other draw can shift them.
        own = stream(int(move.uniform * 2**53), "features", behavior)
        instance = self._model.draw(self._object, behavior, own, recording=recording)
        return Outcome(move.state, instance.features, recording=recording)

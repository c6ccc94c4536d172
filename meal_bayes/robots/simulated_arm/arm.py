"""The robot: executes behaviors by name in the physics, and returns their outcomes."""

import numpy as np

from meal_bayes.domain import TERMINAL, unknown
from meal_bayes.errors import SettingsError
from meal_bayes.robots.robot import Outcome
from meal_bayes.robots.simulated_arm.behaviors import (
    BEHAVIORS,
    LEGAL,
    READY,
    SUCCEEDED,
    observe_state,
)
from meal_bayes.robots.simulated_arm.camera import picture_features
from meal_bayes.robots.simulated_arm.objects import ObjectParameters
from meal_bayes.robots.simulated_arm.physics import OnFrame, Scene
from meal_bayes.robots.simulated_arm.sensors import features_of
from meal_bayes.seeds import stream


class SimulatedArm:
    """An arm in front of one object; implements `Robot`.

    The k-th execution of a behavior since `start` has the same sensor noise whatever else was
    executed, so that agents that are compared meet the same noise.

    Parameters
    ----------
    parameters : ObjectParameters
        The object. Only the builder of the physics reads them.
    seed, path : int | str
        Name the random streams: where the object lies, and the noise of the sensors.
    on_frame : OnFrame | None
        Called 30 times a simulated second, with the scene.
    """

    def __init__(
        self,
        parameters: ObjectParameters,
        seed: int,
        *path: str | int,
        on_frame: OnFrame | None = None,
    ) -> None:
        self._parameters, self._seed, self._path = parameters, seed, path
        self._on_frame = on_frame
        self._starts = 0
        self._scene: Scene | None = None
        self._state = READY
        self._executed: dict[str, int] = {}

    @property
    def scene(self) -> Scene:
        """The physics of this trial."""
        if self._scene is None:
            raise SettingsError("The robot has no object yet; call start() first.")
        return self._scene

    def start(self) -> str:
        """Start a trial with the object at its place, and return the state."""
        placing = stream(self._seed, *self._path, "placing", self._starts)
        self._scene = Scene(self._parameters, placing, self._on_frame)
        self._starts += 1
        self._executed = {}
        self._state = observe_state(self._scene)
        return self._state

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior, and return its outcome; a failure, as a slip, has no features.

        Raises
        ------
        RobotError
            The object is gone, the gripper jams, or the physics broke down.
        """
        if behavior not in BEHAVIORS:
            raise SettingsError(unknown("behavior", behavior, BEHAVIORS))
        scene = self.scene
        if self._state not in LEGAL[behavior]:
            return Outcome(TERMINAL, None)
        count = self._executed[behavior] = self._executed.get(behavior, 0) + 1
        rng = stream(self._seed, *self._path, "sensors", self._starts, behavior, count)
        pieces = [(motion, scene.move(motion)) for motion in BEHAVIORS[behavior]]
        if behavior == "reinit":
            scene.put_back()
        self._state = observe_state(scene)
        if self._state not in SUCCEEDED[behavior]:
            return Outcome(self._state, None)
        if behavior == "look":
            return Outcome(self._state, picture_features(scene, rng))
        recorded = [channels for motion, channels in pieces if motion.recorded]
        features = features_of(behavior, np.concatenate(recorded), rng) if recorded else None
        return Outcome(self._state, features)

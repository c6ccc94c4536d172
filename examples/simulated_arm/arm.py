"""The robot: executes behaviors by name in the physics, and returns their outcomes.

A behavior is the arm's motions, some recorded; where it is legal, and which states a success ends
in, is told by the diagram in `simulated_arm.toml`.
"""

from collections import Counter
from pathlib import Path

import numpy as np

from meal_bayes import Outcome, RobotError, load_domain
from simulated_arm.objects import ObjectParameters
from simulated_arm.physics import HIGH, OPEN, ArmPhysics, Motion, OnFrame
from simulated_arm.sensors import features_of, picture_features
from simulated_arm.streams import stream

READY = "ready"
GRASPED = "grasped"
LIFTED = "lifted"
MOVED = "moved"

_LOW = 0.035  # m, of the fingertips
_UP = _LOW + 0.10

BEHAVIORS: dict[str, tuple[Motion, ...]] = {
    "look": (Motion(0.5),),
    "press": (
        Motion(0.4, z=HIGH),
        Motion(0.4, y=0.0, width=0.0),
        Motion(1.2, z=0.03, press=8.0, recorded=True),
        Motion(0.5, z=HIGH),
    ),
    "push": (
        Motion(0.5, z=HIGH),
        Motion(0.5, y=-0.10, width=0.0),
        Motion(0.5, z=0.025),
        Motion(0.25, y=-0.01, recorded=True),
        Motion(0.75, recorded=True),
        Motion(0.5, y=-0.06, z=HIGH),
    ),
    "grasp": (
        Motion(0.6, z=HIGH, y=0.0),
        Motion(0.2, width=OPEN),
        Motion(0.7, z=_LOW),
        Motion(1.0, width=0.0, recorded=True),
    ),
    "lift": (Motion(1.2, z=_UP, recorded=True), Motion(0.3)),
    "hold": (Motion(1.0, recorded=True),),
    "shake": (Motion(0.2), Motion(1.5, wave=(0.025, 4.0), recorded=True), Motion(0.3)),
    "lower": (Motion(1.2, z=_LOW, recorded=True), Motion(0.3)),
    "drop": (
        Motion(0.6, z=_LOW + 0.03),
        Motion(0.1, width=OPEN, recorded=True),
        Motion(0.5, recorded=True),
        Motion(0.3),
    ),
    "reinit": (Motion(1.0, width=OPEN), Motion(1.0, z=HIGH, y=0.0), Motion(4.0)),
}

DOMAIN = Path(__file__).parent / "simulated_arm.toml"
_ARROWS = load_domain(DOMAIN).diagram.effects
LEGAL = {  # the states that a behavior may start from
    name: {arrow.source for arrow in _ARROWS if arrow.behavior == name} for name in BEHAVIORS
}
_SUCCEEDED = {(arrow.behavior, arrow.target) for arrow in _ARROWS if arrow.senses}

_AT_PLACE = 0.008  # m, along x and y, where a grasp still reaches it
_UPRIGHT = 0.98  # cosine of the tilt
_OFF_TABLE = 0.01  # m, lifted
_JAMMED = 0.01  # m, by which a finger misses its commanded opening


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
        Called 30 times a simulated second, with the physics.
    """

    def __init__(
        self,
        parameters: ObjectParameters,
        seed: int,
        *path: str | int,
        on_frame: OnFrame | None = None,
    ) -> None:
        self._parameters = parameters
        self._seed = seed
        self._path = path
        self._on_frame = on_frame
        self._starts = 0
        self._physics: ArmPhysics | None = None
        self._executed = Counter[str]()

    @property
    def physics(self) -> ArmPhysics:
        """The physics of this trial."""
        if self._physics is None:
            raise RobotError("the robot has no object yet; call start() first")
        return self._physics

    def start(self) -> str:
        """Start a trial with the object at its place, and return the state."""
        placing = stream(self._seed, *self._path, "placing", self._starts)
        self._physics = ArmPhysics(self._parameters, placing, self._on_frame)
        self._starts += 1
        self._executed.clear()
        self._state = observe_state(self._physics)
        return self._state

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior, and return its outcome; a failure, as a slip, has no features.

        Raises
        ------
        RobotError
            The behavior is not possible in this state, the object is gone, the gripper jams, or the
            physics broke down.
        """
        if behavior not in BEHAVIORS:
            raise RobotError(f"no behavior {behavior!r}; it has {', '.join(BEHAVIORS)}")
        physics = self.physics
        if self._state not in LEGAL[behavior]:
            raise RobotError(f"{behavior} is not possible in the state {self._state!r}")
        self._executed[behavior] += 1
        count = self._executed[behavior]
        rng = stream(self._seed, *self._path, "sensors", self._starts, behavior, count)
        pieces = [(motion, physics.move(motion)) for motion in BEHAVIORS[behavior]]
        if behavior == "reinit":
            physics.put_back()
        self._state = observe_state(physics)
        if (behavior, self._state) not in _SUCCEEDED:
            return Outcome(self._state, None)
        if behavior == "look":
            return Outcome(self._state, picture_features(physics, rng))
        recorded = [channels for motion, channels in pieces if motion.recorded]
        features = features_of(behavior, np.concatenate(recorded), rng) if recorded else None
        return Outcome(self._state, features)


def observe_state(physics: ArmPhysics) -> str:
    """Return the state, by the fingertips' switches and the tracker of the object's pose."""
    position = physics.object_place
    home = physics.home
    if physics.held():
        return LIFTED if position[2] - home[2] > _OFF_TABLE else GRASPED
    commanded, width = physics.opening
    if commanded - width > _JAMMED:
        raise RobotError(f"the gripper jams: {width:.3f} m open, commanded {commanded:.3f} m")
    near = (abs(position[:2]) < _AT_PLACE).all() and abs(position[2] - home[2]) < _OFF_TABLE
    return READY if near and physics.upright > _UPRIGHT else MOVED

"""The behaviors: the arm's motions, which of them are recorded, and the states they end in."""

from meal_bayes.errors import RobotError
from meal_bayes.robots.simulated_arm.physics import OPEN, Motion, Scene

READY, GRASPED, LIFTED, MOVED = STATES = ("ready", "grasped", "lifted", "moved")

_HIGH, _LOW = 0.25, 0.035  # m, of the fingertips
_UP = _LOW + 0.10

BEHAVIORS: dict[str, tuple[Motion, ...]] = {
    "look": (Motion(0.5),),
    "press": (
        Motion(0.4, z=_HIGH),
        Motion(0.4, y=0.0, width=0.0),
        Motion(1.2, z=0.03, press=8.0, recorded=True),
        Motion(0.5, z=_HIGH),
    ),
    "push": (
        Motion(0.5, z=_HIGH),
        Motion(0.5, y=-0.10, width=0.0),
        Motion(0.5, z=0.025),
        Motion(0.25, y=-0.01, recorded=True),
        Motion(0.75, recorded=True),
        Motion(0.5, y=-0.06, z=_HIGH),
    ),
    "grasp": (
        Motion(0.6, z=_HIGH, y=0.0),
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
    "reinit": (Motion(1.0, width=OPEN), Motion(1.0, z=_HIGH, y=0.0), Motion(4.0)),
}

LEGAL: dict[str, tuple[str, ...]] = {  # the states that a behavior may start from
    **dict.fromkeys(("look", "press", "push", "grasp"), (READY,)),
    "lift": (GRASPED,),
    **dict.fromkeys(("hold", "shake", "lower", "drop"), (LIFTED,)),
    "reinit": (GRASPED, LIFTED, MOVED),
}
SUCCEEDED: dict[str, tuple[str, ...]] = {  # the states that a success ends in
    **dict.fromkeys(("look", "press", "reinit"), (READY,)),
    "push": (MOVED,),
    "drop": (READY, MOVED),
    **dict.fromkeys(("grasp", "lower"), (GRASPED,)),
    **dict.fromkeys(("lift", "hold", "shake"), (LIFTED,)),
}

_AT_PLACE = 0.008  # m, along x and y, where a grasp still reaches it
_UPRIGHT = 0.98  # cosine of the tilt
_OFF_TABLE = 0.01  # m, lifted
_JAMMED = 0.01  # m, by which a finger misses its commanded opening


def duration(behavior: str) -> float:
    """Return the duration of a behavior, s of simulated time."""
    return sum(motion.seconds for motion in BEHAVIORS[behavior])


def observe_state(scene: Scene) -> str:
    """Return the state, by the fingertips' switches and the tracker of the object's pose.

    Raises
    ------
    RobotError
        The gripper jams.
    """
    place, home = scene.object_place, scene.home
    if scene.held():
        return LIFTED if place[2] - home[2] > _OFF_TABLE else GRASPED
    commanded, width = scene.opening
    if commanded - width > _JAMMED:
        raise RobotError(f"the gripper jams: {width:.3f} m open, commanded {commanded:.3f} m")
    near = (abs(place[:2]) < _AT_PLACE).all() and abs(place[2] - home[2]) < _OFF_TABLE
    return READY if near and scene.upright > _UPRIGHT else MOVED

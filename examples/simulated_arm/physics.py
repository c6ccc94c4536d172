"""Stepping the scene: command the gantry, record channels, notice faults."""

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from meal_bayes import RobotError
from simulated_arm.objects import ObjectParameters, build_model

Floats = NDArray[np.float64]

CHANNELS = ("force", "push", "fingers", "height", "object_y", "object_z", "load")
FRAMES_PER_SECOND = 30  # of simulated time
OPEN = 0.05  # m, of each finger
# Indices in qpos; the hand's joints come first in scene.xml.
_Z = 1
_LEFT = 2
_APART = 0.01  # m, of each finger
_FALLEN = -0.1  # m, below the table
_STRETCH = 0.3  # m, an object that came apart
_BROKEN = (
    mujoco.mjtWarning.mjWARN_BADQPOS,
    mujoco.mjtWarning.mjWARN_BADQVEL,
    mujoco.mjtWarning.mjWARN_BADQACC,
)
_SETTLE = 0.4  # s, before a trial; costs nothing
HIGH = 0.25  # m, where the hand waits

# MuJoCo would write what it warns of into a file in the working directory; `_check` reads it.
mujoco.set_mju_user_warning(lambda _: None)


@dataclass(frozen=True, slots=True)
class Motion:
    """One piece of a behavior: go smoothly to a command, with a wave in z on top if there is one.

    It takes `seconds`, and ends at `y`, `z` and the fingers' `width`, m (None keeps it), with a
    downward force of at most `press`, N (None: the gantry's own); the `wave` is (m, Hz), amplitude
    and frequency. Where it is `recorded`, the channels are.
    """

    seconds: float
    y: float | None = None
    z: float | None = None
    width: float | None = None
    recorded: bool = False
    press: float | None = None
    wave: tuple[float, float] | None = None


class ArmPhysics:
    """One object on the table, and the arm; `on_frame` is called 30 times a simulated second.

    The generator draws where the object lies, and how it is turned.
    """

    def __init__(
        self, parameters: ObjectParameters, rng: np.random.Generator, on_frame: "OnFrame | None"
    ) -> None:
        self.model = build_model(parameters)
        self.data = mujoco.MjData(self.model)
        self._rng = rng
        self._on_frame = on_frame
        self._object = self.model.body("object").id
        self._is_shell = self.model.body_rootid[self.model.geom_bodyid] == self._object
        self._pads = [self.model.geom(f"pad_{side}").id for side in ("left", "right")]
        self._z_limit = self.model.actuator("z").forcerange.copy()
        self._frames = 0
        self.put_back()
        self._show()

    @property
    def seconds(self) -> float:
        """Simulated time, s."""
        return float(self.data.time)

    @property
    def opening(self) -> tuple[float, float]:
        """Commanded and actual opening of each finger, m."""
        return float(self.data.ctrl[2]), float(self.data.qpos[_LEFT])

    @property
    def object_place(self) -> Floats:
        """Position of the object's middle, (3,) m."""
        return np.array(self.data.xpos[self._object])

    @property
    def upright(self) -> float:
        """Cosine of the object's tilt."""
        return float(self.data.xmat[self._object, 8])

    def put_back(self) -> None:
        """Reset the object to its place, and simulate until it rests; this costs no time."""
        now = self.data.time
        mujoco.mj_resetData(self.model, self.data)
        turn = self._rng.normal(0.0, 0.03)
        x, y = self._rng.normal(0.0, 0.002, 2)
        self._move_object(float(np.clip(turn, -0.1, 0.1)), np.clip((x, y), -0.004, 0.004))
        self.data.qpos[_Z : _LEFT + 2] = HIGH, OPEN, OPEN
        self.data.ctrl[:] = (0.0, HIGH, OPEN)
        self.move(Motion(_SETTLE), shown=False)
        self.data.time = now
        self.home = self.object_place

    def _move_object(self, turn: float, shift: Floats) -> None:
        """Turn the object and its content about the vertical, rad, and shift them, m."""
        cos = np.cos(turn)
        sin = np.sin(turn)
        spin = np.array([np.cos(turn / 2), 0.0, 0.0, np.sin(turn / 2)])
        for joint in range(self.model.njnt):
            if self.model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
                address = self.model.jnt_qposadr[joint]
                x, y = self.data.qpos[address : address + 2]
                self.data.qpos[address : address + 2] = cos * x - sin * y, sin * x + cos * y
                self.data.qpos[address : address + 2] += shift
                self.data.qpos[address + 3 : address + 7] = spin

    def held(self) -> bool:
        """Return whether the fingers are apart and both fingertips touch the object."""
        if self.data.qpos[_LEFT] < _APART:
            return False
        pairs = self.data.contact.geom
        return all(self._is_shell[pairs[(pairs == pad).any(axis=1)]].any() for pad in self._pads)

    def move(self, motion: Motion, *, shown: bool = True) -> Floats:
        """Execute a motion and return the channels of its time steps, (T, channels).

        A `RobotError` where the object fell off the table or came apart, or the state is not
        finite.
        """
        steps = round(motion.seconds / self.model.opt.timestep)
        begin = self.data.ctrl.copy()
        goals = (motion.y, motion.z, motion.width)
        end = np.array([b if goal is None else goal for b, goal in zip(begin, goals, strict=True)])
        limit = self._z_limit.copy()
        if motion.press is not None:
            limit[0] = -motion.press
        self.model.actuator("z").forcerange = limit
        channels = np.empty((steps, len(CHANNELS)))
        for step in range(steps):
            # Minimum jerk: 10 t^3 - 15 t^4 + 6 t^5, at rest at both ends.
            fraction = (step + 1) / steps
            smooth = fraction**3 * (10 - 15 * fraction + 6 * fraction**2)
            self.data.ctrl[:] = begin + smooth * (end - begin)
            if motion.wave is not None:
                height, hertz = motion.wave
                turn = 2 * np.pi * hertz * (step + 1) * self.model.opt.timestep
                self.data.ctrl[1] += height * np.sin(turn)
            mujoco.mj_step(self.model, self.data)
            channels[step] = self._sense()
            if shown:
                self._show()
        self.data.ctrl[:] = end
        if motion.press is not None:  # go on from where the press ended
            self.data.ctrl[1] = self.data.joint("z").qpos[0]
        self._check()
        return channels

    def _sense(self) -> Floats:
        data = self.data
        _, y, z = data.xpos[self._object]
        push, force, _ = data.actuator_force
        return np.array(
            (force, push, 2 * data.qpos[_LEFT], data.qpos[_Z], y, z, data.sensordata[0])
        )

    def _show(self) -> None:
        if self._on_frame is not None and self.data.time * FRAMES_PER_SECOND >= self._frames:
            self._frames = int(self.data.time * FRAMES_PER_SECOND) + 1
            self._on_frame(self)

    def _check(self) -> None:
        data = self.data
        if any(data.warning[kind].number for kind in _BROKEN) or not (
            np.isfinite(data.qpos).all() and np.isfinite(data.qvel).all()
        ):
            raise RobotError("the physics broke down: a position or speed is not finite")
        if self.object_place[2] < _FALLEN:
            raise RobotError("the object fell off the table")
        content = data.xpos[self._object + 1 :]
        if (np.abs(content - self.object_place) > _STRETCH).any():
            raise RobotError("the object came apart: its content is outside")


OnFrame = Callable[[ArmPhysics], None]

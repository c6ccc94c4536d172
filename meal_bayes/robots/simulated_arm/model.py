"""The MuJoCo model of one object on the robot's table."""

from importlib import resources
from itertools import product

import mujoco
import numpy as np

from meal_bayes.robots.simulated_arm.objects import CONTENTS, ObjectParameters

WALL = 0.002  # m, half the thickness of shell and lid
SHELL_GROUP = 2  # of the object's geoms; the robot and the table are in group 0
GIVE = 0.006  # m, how far a wall or the lid can be pressed in
_BALL_RADIUS = {CONTENTS[1]: 0.0115, CONTENTS[2]: 0.007}  # m
_SHELL, _BALL = 2, 4  # collision bits; the rest of the scene has bit 1
_PART_MASS = 0.012  # kg, of each side wall and of the lid
_PART_ARMATURE = 0.02  # kg, keeps stiff springs stable at the scene's time step


def build_model(parameters: ObjectParameters) -> mujoco.MjModel:
    """Build the scene with the object at its place.

    The shell's own contact parameters rule its contacts (priority 1), so friction is the object's.
    """
    scene = resources.files("meal_bayes.robots.simulated_arm") / "scene.xml"
    spec = mujoco.MjSpec.from_string(scene.read_text(encoding="utf-8"))
    body = spec.worldbody.add_body(name="object", pos=[0, 0, parameters.height / 2])
    body.add_freejoint(name="object")
    _add_shell(body, parameters)
    if parameters.content == "slab":
        inner = parameters.half_width - GIVE - 2 * WALL, parameters.half_depth - 2 * WALL, 0.01
        low = -parameters.height / 2 + 2 * WALL + inner[2]
        _add_box(body, "slab", inner, (0, 0, low), parameters, parameters.content_mass)
    _add_balls(spec, parameters)
    return spec.compile()


def _add_shell(body: mujoco.MjsBody, parameters: ObjectParameters) -> None:
    x, y, z = parameters.half_width, parameters.half_depth, parameters.height / 2
    mass = (parameters.shell_mass - 3 * _PART_MASS) / 3
    _add_box(body, "bottom", (x - GIVE, y, WALL), (0, 0, -z + WALL), parameters, mass)
    for side, sign in (("front", -1), ("back", 1)):
        place = (0.0, sign * (y - WALL), -2 * WALL)
        _add_box(body, side, (x - 2 * WALL, WALL, z - 4 * WALL), place, parameters, mass)
    for side, sign in (("left", -1), ("right", 1)):
        part = _add_part(body, f"wall_{side}", (-sign, 0, 0), parameters)
        size, place = (WALL, y, z - 2 * WALL), (sign * (x - WALL), 0.0, 0.0)
        _add_box(part, side, size, place, parameters, _PART_MASS)
    lid = _add_part(body, "lid", (0, 0, -1), parameters)
    _add_box(lid, "top", (x - 2 * WALL, y, WALL), (0, 0, z - WALL), parameters, _PART_MASS)


def _add_part(
    body: mujoco.MjsBody,
    name: str,
    inward: tuple[float, float, float],
    parameters: ObjectParameters,
) -> mujoco.MjsBody:
    """Add a wall or lid that gives inward against its spring."""
    part = body.add_body(name=name)
    damping = 1.4 * np.sqrt(parameters.stiffness * (_PART_MASS + _PART_ARMATURE))
    joint = part.add_joint(
        name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=inward, limited=True,
        range=[0, GIVE], armature=_PART_ARMATURE, solref_limit=[0.01, 1],
    )  # fmt: skip
    joint.stiffness = np.resize(parameters.stiffness, np.shape(joint.stiffness) or 1)
    joint.damping = np.resize(damping, np.shape(joint.damping) or 1)
    return part


def _add_box(
    body: mujoco.MjsBody,
    name: str,
    size: tuple[float, float, float],
    place: tuple[float, float, float],
    parameters: ObjectParameters,
    mass: float,
) -> None:
    body.add_geom(
        name=name, type=mujoco.mjtGeom.mjGEOM_BOX, size=size, pos=place, mass=mass,
        rgba=[*parameters.rgb, 1], friction=[parameters.friction, 0.02, 0.0001], priority=1,
        contype=_SHELL, conaffinity=1, group=SHELL_GROUP,
    )  # fmt: skip


def _add_balls(spec: mujoco.MjSpec, parameters: ObjectParameters) -> None:
    """Add the loose content, stacked on a grid inside the shell."""
    if not parameters.n_balls:
        return
    radius = _BALL_RADIUS[parameters.content]
    inner = parameters.half_width - 2 * WALL, parameters.half_depth - 2 * WALL
    axes = [_places(half, radius) for half in inner]
    layers = 2 * WALL + radius * (1 + 2.05 * np.arange(12))
    grid = [(x, y, z) for z, y, x in product(layers, axes[1], axes[0])]
    for number, place in enumerate(grid[: parameters.n_balls]):
        ball = spec.worldbody.add_body(name=f"ball_{number}", pos=place)
        ball.add_freejoint(name=f"ball_{number}")
        ball.add_geom(
            name=f"ball_{number}", type=mujoco.mjtGeom.mjGEOM_SPHERE, size=[radius, 0, 0],
            mass=parameters.content_mass / parameters.n_balls, rgba=[0.9, 0.75, 0.2, 1],
            condim=1, priority=2,
            solref=[0.005, 1], solimp=[0.9, 0.99, 0.001, 0.5, 2],
            contype=_BALL, conaffinity=1 | _SHELL | _BALL, group=SHELL_GROUP,
        )  # fmt: skip


def _places(half: float, radius: float) -> np.ndarray:
    """Return the ball centers along one axis of the cavity, m."""
    count = int(half // radius)
    return (np.arange(count) - (count - 1) / 2) * 2 * radius

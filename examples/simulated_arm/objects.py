"""The objects: parameters drawn from a seed, the attributes that follow from them, the physics."""

from dataclasses import dataclass
from itertools import product
from pathlib import Path
from typing import NamedTuple

import mujoco
import numpy as np

from simulated_arm.streams import stream

Vector = tuple[float, float, float]

HEAVY = 0.22  # kg, of shell and content
SOFT = 4000.0  # N/m, of a wall or the lid
SLIPPERY = 0.5  # coefficient of friction
TALL = 0.105  # m

CONTENTS = ("nothing", "few large balls", "many small balls", "slab")
_CONTENT_PROBABILITY = (0.35, 0.2, 0.25, 0.2)
LOOSE = CONTENTS[1:3]  # what moves inside

_COLORS = {"red": (0.80, 0.16, 0.14), "green": (0.16, 0.62, 0.22), "blue": (0.14, 0.26, 0.78)}

WALL = 0.002  # m, half the thickness of shell and lid
SHELL_GROUP = 2  # of the object's geoms; the robot and the table are in group 0
GIVE = 0.006  # m, how far a wall or the lid can be pressed in
_BALL_RADIUS = {CONTENTS[1]: 0.0115, CONTENTS[2]: 0.007}  # m
# Collision bits; the rest of the scene has bit 1.
_SHELL = 2
_BALL = 4
_PART_MASS = 0.012  # kg, of each side wall and of the lid
_PART_ARMATURE = 0.02  # kg, keeps stiff springs stable at the scene's time step


@dataclass(frozen=True, slots=True)
class ObjectParameters:
    """A closed box with springy side walls and lid, and what is inside.

    Half its width (along x, where the fingers close) and depth (y), and its height, m; masses of
    shell and content, kg; stiffness of each side wall and of the lid, N/m; the coefficient of
    sliding friction against fingers and table; the name of its color and its shade `rgb`, each in
    [0, 1]; one of `CONTENTS`, and how many balls are inside.
    """

    half_width: float
    half_depth: float
    height: float
    shell_mass: float
    content_mass: float
    stiffness: float
    friction: float
    color: str
    rgb: Vector
    content: str
    n_balls: int


def draw_object(seed: int, *path: str | int) -> ObjectParameters:
    """Draw the object of a named stream, such as ``draw_object(7, "new", 3)``.

    >>> draw_object(7, "new", 3) == draw_object(7, "new", 3)
    True
    """
    rng = stream(seed, "simulated object", *path)
    color = str(rng.choice(list(_COLORS)))
    shade = np.clip(np.array(_COLORS[color]) + rng.normal(0.0, 0.08, 3), 0.0, 1.0)
    content = str(rng.choice(CONTENTS, p=_CONTENT_PROBABILITY))
    large = int(rng.integers(2, 4))
    small = int(rng.integers(8, 13))
    return ObjectParameters(
        half_width=float(rng.uniform(0.028, 0.036)),
        half_depth=float(rng.uniform(0.028, 0.036)),
        height=float(rng.uniform(0.07, 0.14)),
        shell_mass=float(rng.uniform(0.08, 0.26)),
        content_mass=float(rng.uniform(0.05, 0.16)) * (content != CONTENTS[0]),
        stiffness=float(np.exp(rng.uniform(np.log(1500.0), np.log(12000.0)))),
        friction=float(np.exp(rng.uniform(np.log(0.25), np.log(1.0)))),
        color=color,
        rgb=(float(shade[0]), float(shade[1]), float(shade[2])),
        content=content,
        n_balls={CONTENTS[1]: large, CONTENTS[2]: small}.get(content, 0),
    )


def attributes_of(parameters: ObjectParameters) -> dict[str, bool]:
    """Return what is true of an object, by the thresholds of this module.

    Only who labels recordings and who checks answers calls this; no behavior does.
    """
    return {
        "heavy": parameters.shell_mass + parameters.content_mass > HEAVY,
        "soft": parameters.stiffness < SOFT,
        "slippery": parameters.friction < SLIPPERY,
        "full": parameters.content != CONTENTS[0],
        "rattles": parameters.content in LOOSE,
        "tall": parameters.height > TALL,
        **{color: parameters.color == color for color in _COLORS},
    }


def build_model(parameters: ObjectParameters) -> mujoco.MjModel:
    """Build the scene with the object at its place.

    The shell's own contact parameters rule its contacts (priority 1), so friction is the object's.
    """
    scene = Path(__file__).with_name("scene.xml").read_text(encoding="utf-8")
    spec = mujoco.MjSpec.from_string(scene)
    body = spec.worldbody.add_body(name="object", pos=[0, 0, parameters.height / 2])
    body.add_freejoint(name="object")
    _add_shell(body, parameters)
    if parameters.content == "slab":
        size = (parameters.half_width - GIVE - 2 * WALL, parameters.half_depth - 2 * WALL, 0.01)
        low = -parameters.height / 2 + 2 * WALL + size[2]
        box = Box("slab", size, position=(0, 0, low), mass=parameters.content_mass)
        _add_box(body, box, parameters)
    _add_balls(spec, parameters)
    return spec.compile()


def _add_shell(body: mujoco.MjsBody, parameters: ObjectParameters) -> None:
    """Add a bottom, front and back, and walls and a lid that give inward against their springs."""
    x = parameters.half_width
    y = parameters.half_depth
    z = parameters.height / 2
    stiffness = parameters.stiffness
    wall = (WALL, y, z - 2 * WALL)
    # Below the critical 2 sqrt(k m): a wall swings back once, as plastic does.
    damping = 1.4 * np.sqrt(stiffness * (_PART_MASS + _PART_ARMATURE))
    mass = (parameters.shell_mass - 3 * _PART_MASS) / 3
    bottom = Box("bottom", (x - GIVE, y, WALL), position=(0, 0, -z + WALL), mass=mass)
    _add_box(body, bottom, parameters)
    for side, sign in (("front", -1), ("back", 1)):
        size = (x - 2 * WALL, WALL, z - 4 * WALL)
        position = (0.0, sign * (y - WALL), -2 * WALL)
        _add_box(body, Box(side, size, position, mass), parameters)
    # Each of these slides inward on a joint of its own, against a spring.
    for name, side, inward, size, position in (
        ("wall_left", "left", (1, 0, 0), wall, (WALL - x, 0, 0)),
        ("wall_right", "right", (-1, 0, 0), wall, (x - WALL, 0, 0)),
        ("lid", "top", (0, 0, -1), (x - 2 * WALL, y, WALL), (0, 0, z - WALL)),
    ):
        part = body.add_body(name=name)
        part.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=inward,
            limited=True,
            range=[0, GIVE],
            armature=_PART_ARMATURE,
            solref_limit=[0.01, 1],
            stiffness=np.full(3, stiffness),
            damping=np.full(3, damping),
        )
        _add_box(part, Box(side, size, position, _PART_MASS), parameters)


class Box(NamedTuple):
    """A box of the shell or inside it: half sizes and middle, m, and mass, kg."""

    name: str
    size: Vector
    position: Vector
    mass: float


def _add_box(body: mujoco.MjsBody, box: Box, parameters: ObjectParameters) -> None:
    """Add a box to a body, with the color and the friction of the object."""
    body.add_geom(
        name=box.name,
        type=mujoco.mjtGeom.mjGEOM_BOX,
        size=box.size,
        pos=box.position,
        mass=box.mass,
        rgba=[*parameters.rgb, 1],
        friction=[parameters.friction, 0.02, 0.0001],
        priority=1,
        contype=_SHELL,
        conaffinity=1,
        group=SHELL_GROUP,
    )


def _add_balls(spec: mujoco.MjSpec, parameters: ObjectParameters) -> None:
    """Add the loose content, stacked on a grid inside the shell."""
    if not parameters.n_balls:
        return
    radius = _BALL_RADIUS[parameters.content]
    axes = []
    for half in (parameters.half_width - 2 * WALL, parameters.half_depth - 2 * WALL):
        count = int(half // radius)
        axes.append((np.arange(count) - (count - 1) / 2) * 2 * radius)
    layers = 2 * WALL + radius * (1 + 2.05 * np.arange(12))
    grid = [(x, y, z) for z, y, x in product(layers, axes[1], axes[0])]
    for number, position in enumerate(grid[: parameters.n_balls]):
        ball = spec.worldbody.add_body(name=f"ball_{number}", pos=position)
        ball.add_freejoint(name=f"ball_{number}")
        ball.add_geom(
            name=f"ball_{number}",
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[radius, 0, 0],
            mass=parameters.content_mass / parameters.n_balls,
            rgba=[0.9, 0.75, 0.2, 1],
            condim=1,  # without friction, so that balls roll
            priority=2,  # their contacts are their own, also with the shell
            solref=[0.005, 1],
            solimp=[0.9, 0.99, 0.001, 0.5, 2],
            contype=_BALL,
            conaffinity=1 | _SHELL | _BALL,
            group=SHELL_GROUP,
        )

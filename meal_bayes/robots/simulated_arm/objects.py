"""The objects: parameters drawn from a seed, and the attributes that follow from them."""

from dataclasses import dataclass

import numpy as np

from meal_bayes.seeds import stream

HEAVY = 0.22  # kg, of shell and content
SOFT = 4000.0  # N/m, of a wall or the lid
SLIPPERY = 0.5  # coefficient of friction
TALL = 0.105  # m

CONTENTS = ("nothing", "few large balls", "many small balls", "slab")
_CONTENT_PROBABILITY = (0.35, 0.2, 0.25, 0.2)
LOOSE = CONTENTS[1:3]  # what moves inside

_COLORS = {"red": (0.80, 0.16, 0.14), "green": (0.16, 0.62, 0.22), "blue": (0.14, 0.26, 0.78)}


@dataclass(frozen=True, slots=True)
class ObjectParameters:
    """A closed box with springy side walls and lid, and what is inside.

    Attributes
    ----------
    half_width, half_depth : float
        m, along x (where the fingers close) and y.
    height : float
        m.
    shell_mass, content_mass : float
        kg.
    stiffness : float
        N/m, of each side wall and of the lid.
    friction : float
        Sliding coefficient against fingers and table.
    color : str
        Name; `rgb` is its shade, each in [0, 1].
    content : str
        One of `CONTENTS`.
    n_balls : int
        Balls inside; 0 without loose content.
    """

    half_width: float
    half_depth: float
    height: float
    shell_mass: float
    content_mass: float
    stiffness: float
    friction: float
    color: str
    rgb: tuple[float, float, float]
    content: str
    n_balls: int

    @property
    def mass(self) -> float:
        """Mass of shell and content, kg."""
        return self.shell_mass + self.content_mass


def draw_object(seed: int, *path: str | int) -> ObjectParameters:
    """Draw the object of a named stream, such as ``draw_object(7, "new", 3)``.

    >>> draw_object(7, "new", 3) == draw_object(7, "new", 3)
    True
    """
    rng = stream(seed, "simulated object", *path)
    color = str(rng.choice(list(_COLORS)))
    shade = np.clip(np.array(_COLORS[color]) + rng.normal(0.0, 0.08, 3), 0.0, 1.0)
    content = str(rng.choice(CONTENTS, p=_CONTENT_PROBABILITY))
    large, small = int(rng.integers(2, 4)), int(rng.integers(8, 13))
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
        "heavy": parameters.mass > HEAVY,
        "soft": parameters.stiffness < SOFT,
        "slippery": parameters.friction < SLIPPERY,
        "full": parameters.content != CONTENTS[0],
        "rattles": parameters.content in LOOSE,
        "tall": parameters.height > TALL,
        **{color: parameters.color == color for color in _COLORS},
    }

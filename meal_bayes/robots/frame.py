"""Frames of a robot for the viewer; any robot may make them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SOLID, SHELL, BALL = range(3)


class Frame(NamedTuple):
    """The geometry of a robot and its surroundings, `seconds` after the trial began.

    B boxes and balls: centers (B,3) m, half sizes (B,3) m, quaternions (B,4) x, y, z, w, colors
    (B,3) in [0, 1], and shapes (B,) `SOLID`, `SHELL` (a transparent box) or `BALL`. C points of
    contact (C,3) m, and the forces (C,3) N that act there. The picture of the robot's camera,
    (rows, columns, 3) in [0, 1].
    """

    seconds: float
    centers: NDArray[np.float32]
    half_sizes: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    colors: NDArray[np.float32]
    shapes: NDArray[np.int8]
    contacts: NDArray[np.float32]
    forces: NDArray[np.float32]
    picture: NDArray[np.float32]

"""Frames of a robot for the viewer; any robot may make them."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SOLID, SHELL, BALL = range(3)


class Frame(NamedTuple):
    """The geometry of a robot and its surroundings at one time.

    Attributes
    ----------
    seconds : float
        s, since the trial began.
    centers, half_sizes, quaternions, colors : NDArray[np.float32]
        Of the boxes and balls: (B,3) m, (B,3) m, (B,4) x, y, z, w, and (B,3) in [0, 1].
    shapes : NDArray[np.int8]
        (B,) `SOLID` (a box), `SHELL` (a transparent box) or `BALL`.
    contacts, forces : NDArray[np.float32]
        (C,3) m, points of contact, and (C,3) N, what acts there.
    picture : NDArray[np.float32]
        (rows, columns, 3) in [0, 1], of the robot's camera.
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

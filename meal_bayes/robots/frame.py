"""What an onlooker sees of a body at one moment; any robot may give such frames to the viewer."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

SOLID, SHELL, BALL = range(3)


class Frame(NamedTuple):
    """One moment.

    Attributes
    ----------
    seconds : s, since the trial began.
    centers, half_sizes : (B,3) m, of the bodies.
    quaternions : (B,4), x, y, z, w.
    colors : (B,3) in [0, 1].
    kinds : (B,) `SOLID`, `SHELL` (a box that is looked into) or `BALL`.
    contacts : (C,3) m, where bodies touch.
    forces : (C,3) N, what acts there.
    picture : (rows, columns, 3) in [0, 1], of the robot's camera.
    """

    seconds: float
    centers: NDArray[np.float32]
    half_sizes: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    colors: NDArray[np.float32]
    kinds: NDArray[np.int8]
    contacts: NDArray[np.float32]
    forces: NDArray[np.float32]
    picture: NDArray[np.float32]

"""What an onlooker sees of the scene at one moment: bodies as boxes and balls, contact forces."""

from typing import NamedTuple

import mujoco
import numpy as np
from numpy.typing import NDArray

from meal_bayes.robots.simulated_arm.camera import take_picture
from meal_bayes.robots.simulated_arm.physics import Scene


class Frame(NamedTuple):
    """One moment, 30 a simulated second.

    Attributes
    ----------
    seconds : s, simulated time since the trial began.
    centers, half_sizes : (B,3) m, of the boxes; a ball is a box with `is_ball`.
    quaternions : (B,4), x, y, z, w.
    colors : (B,3) in [0, 1].
    is_ball : (B,).
    contacts : (C,3) m, where something touches.
    forces : (C,3) N, what acts there.
    picture : (rows, columns, 3) in [0, 1], of the robot's camera, without noise.
    """

    seconds: float
    centers: NDArray[np.float32]
    half_sizes: NDArray[np.float32]
    quaternions: NDArray[np.float32]
    colors: NDArray[np.float32]
    is_ball: NDArray[np.bool_]
    contacts: NDArray[np.float32]
    forces: NDArray[np.float32]
    picture: NDArray[np.float32]


def frame_of(scene: Scene) -> Frame:
    """Return what is seen now."""
    model, data = scene.model, scene.data
    ball = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    sizes = np.where(ball[:, None], model.geom_size[:, :1], model.geom_size)
    contacts, forces = _contacts(model, data)
    return Frame(
        scene.seconds,
        data.geom_xpos.astype(np.float32),
        sizes.astype(np.float32),
        np.array([_quaternion(matrix) for matrix in data.geom_xmat], np.float32),
        model.geom_rgba[:, :3].astype(np.float32),
        ball,
        contacts,
        forces,
        take_picture(scene).astype(np.float32),
    )


def _quaternion(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Turn a rotation matrix (9,) into x, y, z, w."""
    found = np.empty(4)
    mujoco.mju_mat2Quat(found, matrix)
    return np.roll(found, -1)


def _contacts(
    model: mujoco.MjModel, data: mujoco.MjData
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    places, forces, wrench = [], [], np.empty(6)
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, wrench)
        contact = data.contact[number]
        places.append(contact.pos.copy())
        forces.append(wrench[:3] @ contact.frame.reshape(3, 3))
    shape = (-1, 3)
    return (
        np.array(places, np.float32).reshape(shape),
        np.array(forces, np.float32).reshape(shape),
    )

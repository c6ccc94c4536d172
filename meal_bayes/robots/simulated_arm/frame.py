"""Frames of the scene for the viewer: boxes and balls, contact forces, the camera."""

import mujoco
import numpy as np
from numpy.typing import NDArray

from meal_bayes.robots.frame import BALL, SHELL, SOLID, Frame
from meal_bayes.robots.simulated_arm.camera import take_picture
from meal_bayes.robots.simulated_arm.model import SHELL_GROUP
from meal_bayes.robots.simulated_arm.physics import Scene


def frame_of(scene: Scene) -> Frame:
    """Return the present frame."""
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
        np.where(ball, BALL, np.where(model.geom_group == SHELL_GROUP, SHELL, SOLID)).astype(
            np.int8
        ),
        contacts,
        forces,
        take_picture(scene).astype(np.float32),
    )


def _quaternion(matrix: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the quaternion x, y, z, w of a rotation matrix (9,)."""
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

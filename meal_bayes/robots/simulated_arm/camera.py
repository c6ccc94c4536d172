"""What is seen: the camera's pictures by casting rays, without display or GPU, and frames."""

import mujoco
import numpy as np

from meal_bayes.robots.frame import BALL, SHELL, SOLID, Frame
from meal_bayes.robots.simulated_arm.objects import SHELL_GROUP
from meal_bayes.robots.simulated_arm.physics import Floats, Scene

SIZE = (48, 64)  # rows and columns of what the robot sees
PIXEL_NOISE = 0.05  # standard deviation, of intensities in [0, 1]
_LIGHT = np.array([0.4, -0.7, 0.6]) / np.linalg.norm([0.4, -0.7, 0.6])
_BACKGROUND = (0.86, 0.88, 0.91)
_DIFFERENT = 0.25  # by which a pixel with the object differs from one without
_FAR = 5.0  # m


def take_picture(scene: Scene, size: tuple[int, int] = SIZE, *, empty: bool = False) -> Floats:
    """Return the front camera's picture, (rows, columns, 3) in [0, 1], without noise.

    Of the `empty` table, as the robot remembers it, the object is left out.
    """
    model, data = scene.model, scene.data
    camera = model.camera("front").id
    rows, columns = size
    half = np.tan(np.deg2rad(model.cam_fovy[camera]) / 2)
    up = half * (1 - 2 * (np.arange(rows) + 0.5) / rows)
    right = half * columns / rows * (2 * (np.arange(columns) + 0.5) / columns - 1)
    local = np.stack([*np.meshgrid(right, up), np.full((rows, columns), -1.0)], axis=-1).reshape(
        -1, 3
    )
    rays = local @ data.cam_xmat[camera].reshape(3, 3).T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    shown = np.ones(6, dtype=np.uint8)
    shown[SHELL_GROUP] = not empty
    geoms, far = np.empty(len(rays), dtype=np.int32), np.empty(len(rays))
    normals = np.empty((len(rays), 3))
    mujoco.mj_multiRay(
        model, data, data.cam_xpos[camera], rays.ravel(), shown, 1, -1, geoms, far,
        normals.ravel(), len(rays), _FAR,
    )  # fmt: skip
    brightness = 0.55 + 0.45 * np.abs(normals @ _LIGHT)
    colors = model.geom_rgba[geoms, :3] * brightness[:, None]
    colors[geoms < 0] = _BACKGROUND
    picture: Floats = np.clip(colors, 0.0, 1.0).reshape(rows, columns, 3)
    return picture


def picture_features(scene: Scene, rng: np.random.Generator) -> dict[str, Floats]:
    """Return the object's mean color, (3,), and its height, width and area in pixels, (3,).

    The object is where a noisy picture differs from the memory of the empty table.
    """
    picture = take_picture(scene)
    picture += rng.normal(0.0, PIXEL_NOISE, picture.shape)
    difference = np.abs(picture - take_picture(scene, empty=True)).max(axis=2)
    mask = difference > _DIFFERENT
    rows, columns = mask.sum(axis=1) > 1, mask.sum(axis=0) > 1
    color = picture[mask].mean(axis=0) if mask.any() else np.zeros(3)
    return {
        "color": color,
        "shape": np.array([rows.sum(), columns.sum(), mask.sum()], dtype=float),
    }


def frame_of(scene: Scene) -> Frame:
    """Return the present frame for the viewer: boxes and balls, contact forces, the picture."""
    model, data = scene.model, scene.data
    ball = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    shell = model.geom_group == SHELL_GROUP
    places, forces, wrench = [], [], np.empty(6)
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, wrench)
        contact = data.contact[number]
        places.append(contact.pos.copy())
        forces.append(wrench[:3] @ contact.frame.reshape(3, 3))
    turns = np.empty((model.ngeom, 4))
    for turn, matrix in zip(turns, data.geom_xmat, strict=True):
        mujoco.mju_mat2Quat(turn, matrix)  # w, x, y, z
    return Frame(
        scene.seconds,
        data.geom_xpos.astype(np.float32),
        np.where(ball[:, None], model.geom_size[:, :1], model.geom_size).astype(np.float32),
        np.roll(turns, -1, axis=1).astype(np.float32),
        model.geom_rgba[:, :3].astype(np.float32),
        np.where(ball, BALL, np.where(shell, SHELL, SOLID)).astype(np.int8),
        np.array(places, np.float32).reshape(-1, 3),
        np.array(forces, np.float32).reshape(-1, 3),
        take_picture(scene).astype(np.float32),
    )

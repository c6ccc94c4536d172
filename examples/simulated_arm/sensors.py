"""The sensors: their noise, features (`BINS` a channel), pictures by casting rays, frames.

No picture needs a display or a GPU.
"""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from meal_bayes import Frame
from simulated_arm.objects import SHELL_GROUP
from simulated_arm.physics import CHANNELS, ArmPhysics, Floats

BINS = 10  # of a channel in time, each a feature


# Standard deviations of an error: of each sample (500 a second), and of a whole behavior.
NOISE = {
    "force": (0.25, 0.10),  # N, wrist
    "push": (1.0, 0.10),  # N, wrist
    "fingers": (0.002, 0.0005),  # m, opening
    "height": (0.0005, 0.0005),  # m, of the hand
    "object_y": (0.04, 0.001),  # m, the camera's tracker: 6 mm in .1 s
    "object_z": (0.04, 0.001),  # m, the same
    "load": (2.0, 0.15),  # N, load cell under the table
}
_CONTACT = 1.5  # N, at which the robot notes a contact
_SMOOTH = 15  # samples of the moving average that vibration is taken against
SIZE = (48, 64)  # rows and columns of what the robot sees
PIXEL_NOISE = 0.05  # standard deviation, of intensities in [0, 1]
_LIGHT = np.array([0.4, -0.7, 0.6]) / np.linalg.norm([0.4, -0.7, 0.6])
_BACKGROUND = (0.86, 0.88, 0.91)
_DIFFERENT = 0.25  # by which a pixel with the object differs from one without
_FAR = 5.0  # m

Channels = Mapping[str, Floats]
Modality = Callable[[Channels], Floats]  # makes its features, (BINS,)


def sense(channels: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """Return noisy measurements (T,) of the true channels (T, channels), by name."""
    measured = {}
    for name, values in zip(CHANNELS, channels.T, strict=True):
        white, bias = NOISE[name]
        error = bias * rng.standard_normal() + white * rng.standard_normal(len(values))
        measured[name] = values + error
    return measured


def _in_bins(values: Floats, statistic: Callable[[Floats], float] = np.mean) -> Floats:
    return np.array([statistic(part) for part in np.array_split(values, BINS)])


def _binned(channel: str) -> Modality:
    return lambda sensed: _in_bins(sensed[channel])


def _from_first(values: Floats) -> Floats:
    return np.asarray(_in_bins(values) - _in_bins(values)[0])


def _slip(sensed: Channels) -> Floats:
    """Compute how far the object slid in the fingers since the behavior began, (BINS,) m."""
    return _from_first(sensed["object_z"] - sensed["height"])


def _depth(sensed: Channels) -> Floats:
    """Compute how far the hand moved since the first contact, (BINS,) m."""
    smooth = np.convolve(sensed["force"], np.ones(_SMOOTH) / _SMOOTH, "same")
    touched = int(np.argmax(smooth < -_CONTACT))
    height = sensed["height"]
    return _in_bins(np.maximum(height[touched] - height, 0.0) * (np.arange(len(height)) > touched))


def _vibration(sensed: Channels) -> Floats:
    """Compute the standard deviation of the force about its moving average, (BINS,) N."""
    force = sensed["force"]
    smooth = np.convolve(force, np.ones(_SMOOTH) / _SMOOTH, "same")
    return _in_bins((force - smooth)[_SMOOTH:-_SMOOTH], np.std)


_FORCE = _binned("force")
MODALITIES: dict[str, dict[str, Modality]] = {
    "press": {"depth": _depth, "height": _binned("height"), "force": _FORCE},
    "push": {"force": _binned("push"), "flow": lambda sensed: _from_first(sensed["object_y"])},
    "grasp": {"fingers": _binned("fingers")},
    "lift": {"force": _FORCE, "slip": _slip},
    "hold": {"force": _FORCE, "slip": _slip},
    "shake": {"force": _FORCE, "vibro": _vibration, "slip": _slip},
    "lower": {"force": _FORCE},
    "drop": {"load": _binned("load")},
}


def features_of(behavior: str, channels: Floats, rng: np.random.Generator) -> dict[str, Floats]:
    """Return the features of recorded channels, modality -> (BINS,)."""
    sensed = sense(channels, rng)
    return {name: make(sensed) for name, make in MODALITIES[behavior].items()}


def take_picture(
    physics: ArmPhysics, size: tuple[int, int] = SIZE, *, empty: bool = False
) -> Floats:
    """Return the front camera's picture, (rows, columns, 3) in [0, 1], without noise.

    Of the `empty` table, as the robot remembers it, the object is left out.
    """
    model = physics.model
    data = physics.data
    camera = model.camera("front").id
    rows, columns = size
    half = np.tan(np.deg2rad(model.cam_fovy[camera]) / 2)
    # A ray through the middle of each pixel; the camera looks along its -z axis.
    up = half * (1 - 2 * (np.arange(rows) + 0.5) / rows)
    right = half * columns / rows * (2 * (np.arange(columns) + 0.5) / columns - 1)
    local = np.stack([*np.meshgrid(right, up), np.full((rows, columns), -1.0)], axis=-1)
    rays = local.reshape(-1, 3) @ data.cam_xmat[camera].reshape(3, 3).T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    visible = np.ones(6, dtype=np.uint8)  # by group of geoms
    visible[SHELL_GROUP] = not empty
    geoms = np.empty(len(rays), dtype=np.int32)
    far = np.empty(len(rays))
    normals = np.empty((len(rays), 3))
    mujoco.mj_multiRay(
        model,
        data,
        pnt=data.cam_xpos[camera],
        vec=rays.ravel(),
        geomgroup=visible,
        flg_static=1,
        bodyexclude=-1,
        geomid=geoms,  # written, -1 where a ray meets nothing
        dist=far,  # written
        normal=normals.ravel(),  # written
        nray=len(rays),
        cutoff=_FAR,
    )
    # Lambert's law over ambient light; of both sides, as normals point either way.
    brightness = 0.55 + 0.45 * np.abs(normals @ _LIGHT)
    colors = model.geom_rgba[geoms, :3] * brightness[:, None]
    colors[geoms < 0] = _BACKGROUND
    return np.asarray(np.clip(colors, 0.0, 1.0).reshape(rows, columns, 3))


def picture_features(physics: ArmPhysics, rng: np.random.Generator) -> dict[str, Floats]:
    """Return the object's mean color, (3,), and its height, width and area in pixels, (3,).

    The object is where a noisy picture differs from the memory of the empty table.
    """
    picture = take_picture(physics)
    picture += rng.normal(0.0, PIXEL_NOISE, picture.shape)
    difference = np.abs(picture - take_picture(physics, empty=True)).max(axis=2)
    mask = difference > _DIFFERENT
    rows = mask.sum(axis=1) > 1
    columns = mask.sum(axis=0) > 1
    color = picture[mask].mean(axis=0) if mask.any() else np.zeros(3)
    return {"color": color, "shape": np.array([rows.sum(), columns.sum(), mask.sum()], dtype=float)}


def frame_of(physics: ArmPhysics) -> Frame:
    """Return the present frame for the viewer: boxes and balls, contact forces, the picture."""
    model = physics.model
    data = physics.data
    ball = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    shell = model.geom_group == SHELL_GROUP
    wrenches = np.empty((data.ncon, 6))
    for number, wrench in enumerate(wrenches):
        mujoco.mj_contactForce(model, data, number, wrench)  # in the contact's own axes
    axes = data.contact.frame.reshape(-1, 3, 3)
    turns = np.empty((model.ngeom, 4))
    for turn, matrix in zip(turns, data.geom_xmat, strict=True):
        mujoco.mju_mat2Quat(turn, matrix)  # w, x, y, z
    sizes = np.where(ball[:, None], model.geom_size[:, :1], model.geom_size)
    shapes = np.where(ball, Frame.BALL, np.where(shell, Frame.SHELL, Frame.SOLID))
    return Frame(
        seconds=physics.seconds,
        centers=data.geom_xpos.astype(np.float32),
        half_sizes=sizes.astype(np.float32),
        quaternions=np.roll(turns, -1, axis=1).astype(np.float32),  # to x, y, z, w
        colors=model.geom_rgba[:, :3].astype(np.float32),
        shapes=shapes.astype(np.int8),
        contacts=data.contact.pos.astype(np.float32),
        forces=(wrenches[:, None, :3] @ axes)[:, 0].astype(np.float32),
        picture=take_picture(physics).astype(np.float32),
    )

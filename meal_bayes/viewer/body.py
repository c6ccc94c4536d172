"""The body in space: boxes, balls, contact forces, and what the robot's camera sees."""

from collections.abc import Iterable

import numpy as np
import rerun as rr

from meal_bayes.agents.trial import Trial
from meal_bayes.robots.frame import BALL, SHELL, SOLID, Frame
from meal_bayes.viewer.recorder import Recorder, Time

BODY, CAMERA, LOAD = "/body", "/camera", "/contact_force"
_METERS_A_NEWTON = 0.008  # how long a force is drawn
_LINE = 0.0008  # m
_FORCE = (235, 60, 40)


def add_body(to: Recorder, trial: Trial, frames: Iterable[Frame], *, number: int = 0) -> None:
    """Put the frames of a trial into a recording, each in the row of the step that it belongs to.

    Parameters
    ----------
    to : what rows are gathered in.
    trial : tells when each step ended.
    frames : in their order.
    number : position of the trial in its log.
    """
    ends = np.cumsum([step.cost for step in trial.steps])
    looks = False
    for frame in frames:
        row = int(np.searchsorted(ends, frame.seconds - 1e-6)) + (frame.seconds > 0)
        time = Time(number, min(row, len(ends)), frame.seconds)
        if not looks:
            _fix_looks(to, frame)
            looks = True
        _add_frame(to, frame, time)


def _fix_looks(to: Recorder, frame: Frame) -> None:
    """Fix what does not change: sizes and colors."""
    for kind, entity in ((SOLID, "robot"), (SHELL, "object")):
        own = frame.kinds == kind
        boxes = rr.Boxes3D.from_fields(
            half_sizes=frame.half_sizes[own],
            colors=(255 * frame.colors[own]).astype(np.uint8),
            fill_mode="solid" if kind == SOLID else "majorwireframe",
            radii=_LINE,
        )
        to.fix(f"{BODY}/{entity}", boxes)
    balls = frame.kinds == BALL
    if balls.any():
        looks = rr.Points3D.from_fields(
            radii=frame.half_sizes[balls, 0], colors=(255 * frame.colors[balls]).astype(np.uint8)
        )
        to.fix(f"{BODY}/content", looks)
    to.fix(f"{BODY}/forces", rr.Arrows3D.from_fields(colors=_FORCE, radii=2 * _LINE))
    to.fix(BODY, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    to.fix(LOAD, rr.SeriesLines(names="largest contact force, N", colors=_FORCE, widths=2))


def _add_frame(to: Recorder, frame: Frame, time: Time) -> None:
    for kind, entity in ((SOLID, "robot"), (SHELL, "object")):
        own = frame.kinds == kind
        to.add(
            f"{BODY}/{entity}",
            rr.Boxes3D,
            time,
            centers=frame.centers[own].tolist(),
            quaternions=frame.quaternions[own].tolist(),
        )
    balls = frame.kinds == BALL
    if balls.any():
        to.add(f"{BODY}/content", rr.Points3D, time, positions=frame.centers[balls].tolist())
    to.add(
        f"{BODY}/forces",
        rr.Arrows3D,
        time,
        origins=frame.contacts.tolist(),
        vectors=(_METERS_A_NEWTON * frame.forces).tolist(),
    )
    strength = np.linalg.norm(frame.forces, axis=1).max(initial=0.0)
    to.add(LOAD, rr.Scalars, time, scalars=[float(strength)])
    height, width = frame.picture.shape[:2]
    pixels = (255 * frame.picture).astype(np.uint8)
    shape = rr.components.ImageFormat(
        width=width, height=height, color_model="RGB", channel_datatype="U8"
    )
    to.add(CAMERA, rr.Image, time, buffer=[pixels.tobytes()], format=[shape])

"""The robot in space: boxes, balls, contact forces, and what its camera sees."""

from collections.abc import Iterable

import numpy as np
import rerun as rr

from meal_bayes.robots.robot import BALL, SHELL, SOLID, Frame
from meal_bayes.trials import Trial
from meal_bayes.viewer.recorder import Recorder, Time

ROBOT, CAMERA, FORCE = "/robot", "/camera", "/contact_force"
_BOXES = {SOLID: f"{ROBOT}/arm", SHELL: f"{ROBOT}/object"}
_BALLS, _ARROWS = f"{ROBOT}/content", f"{ROBOT}/forces"
_METERS_PER_NEWTON = 0.008  # how long a force is drawn
_LINE = 0.0008  # m
_RED = (235, 60, 40)


def add_robot(to: Recorder, trial: Trial, frames: Iterable[Frame], *, number: int = 0) -> None:
    """Add the frames of a trial, the `number`-th of its log, each in the row of its step.

    Steps end when as many seconds have passed as they cost.
    """
    ends = np.cumsum([step.cost for step in trial.steps])
    for index, frame in enumerate(frames):
        if index == 0:
            _add_static(to, frame)
        row = int(np.searchsorted(ends, frame.seconds - 1e-6)) + (frame.seconds > 0)
        _add_frame(to, frame, Time(number, min(row, len(ends)), frame.seconds))


def _add_static(to: Recorder, frame: Frame) -> None:
    """Add what does not change: sizes, colors and units."""
    colors = (255 * frame.colors).astype(np.uint8)
    for shape, entity in _BOXES.items():
        mask = frame.shapes == shape
        boxes = rr.Boxes3D.from_fields(
            half_sizes=frame.half_sizes[mask],
            colors=colors[mask],
            fill_mode="solid" if shape == SOLID else "majorwireframe",
            radii=_LINE,
        )
        to.add_static(entity, boxes)
    balls = frame.shapes == BALL
    if balls.any():
        points = rr.Points3D.from_fields(radii=frame.half_sizes[balls, 0], colors=colors[balls])
        to.add_static(_BALLS, points)
    to.add_static(_ARROWS, rr.Arrows3D.from_fields(colors=_RED, radii=2 * _LINE))
    to.add_static(ROBOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    to.add_static(FORCE, rr.SeriesLines(names="largest contact force, N", colors=_RED, widths=2))


def _add_frame(to: Recorder, frame: Frame, time: Time) -> None:
    for shape, entity in _BOXES.items():
        mask = frame.shapes == shape
        centers, quaternions = frame.centers[mask].tolist(), frame.quaternions[mask].tolist()
        to.add(entity, rr.Boxes3D, time, centers=centers, quaternions=quaternions)
    balls = frame.shapes == BALL
    if balls.any():
        to.add(_BALLS, rr.Points3D, time, positions=frame.centers[balls].tolist())
    vectors = (_METERS_PER_NEWTON * frame.forces).tolist()
    to.add(_ARROWS, rr.Arrows3D, time, origins=frame.contacts.tolist(), vectors=vectors)
    largest = np.linalg.norm(frame.forces, axis=1).max(initial=0.0)
    to.add(FORCE, rr.Scalars, time, scalars=[float(largest)])
    to.add_image(CAMERA, (255 * frame.picture).astype(np.uint8), time)

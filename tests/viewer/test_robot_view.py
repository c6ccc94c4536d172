"""The robot beside the beliefs: every frame is in the row of its step."""

import numpy as np
import pytest

from meal_bayes.robots.frame import BALL, SHELL, SOLID, Frame
from meal_bayes.viewer import write_recording


def frame(seconds):
    rng = np.random.default_rng(int(seconds * 10))
    shapes = np.array([SOLID, SHELL, SHELL, BALL, BALL, BALL], np.int8)
    half, contacts = np.full((6, 3), 0.5, np.float32), 2 * int(seconds > 0)
    return Frame(
        seconds, rng.normal(size=(6, 3)).astype(np.float32), half / 5,
        np.tile(np.array([0, 0, 0, 1], np.float32), (6, 1)), half, shapes,
        np.zeros((2, 3), np.float32)[:contacts],
        np.array([[0.0, 0.0, 3.0], [0.0, 4.0, 0.0]], np.float32)[:contacts],
        np.full((4, 6, 3), 0.5, np.float32),
    )  # fmt: skip


@pytest.fixture(scope="module")
def watched(trials, read_back, tmp_path_factory):
    trial = trials[0]
    frames = [frame(seconds) for seconds in np.arange(0.0, trial.cost + 1e-9, 0.5)]
    path = tmp_path_factory.mktemp("robot") / "robot.rrd"
    assert write_recording([trial], path, {}, frames=frames) == 1
    return trial, frames, read_back(path)


def test_every_frame_is_in_the_row_of_its_step(watched):
    trial, frames, rows = watched
    load = rows["/contact_force"]
    ends = np.cumsum([step.cost for step in trial.steps])
    assert len(load["step"]) == len(frames)
    for one, step in zip(frames, load["step"], strict=True):
        expected = 0 if one.seconds == 0 else 1 + int((ends < one.seconds - 1e-6).sum())
        assert step == min(expected, len(trial.steps))


def test_bodies_and_forces_are_the_frames(watched):
    _, frames, rows = watched
    shells = rows["/robot/object"]["Boxes3D:centers"]
    balls = rows["/robot/content"]["Points3D:positions"]
    for one, boxes, points in zip(frames, shells, balls, strict=True):
        np.testing.assert_allclose(boxes, one.centers[one.shapes == SHELL])
        np.testing.assert_allclose(points, one.centers[one.shapes == BALL])
    strength = rows["/contact_force"]["Scalars:scalars"]
    assert strength[0] == [0.0]
    assert strength[1] == pytest.approx([4.0])
    assert len(rows["/robot/forces"]["Arrows3D:vectors"][1]) == 2


def test_a_trial_without_frames_shows_no_robot(trials, read_back, tmp_path):
    write_recording([trials[0]], tmp_path / "plain.rrd", {})
    assert not any(entity.startswith("/robot") for entity in read_back(tmp_path / "plain.rrd"))

"""The arm goes through the states of its diagram, slips by itself, and repeats under a seed."""

import numpy as np
import pytest

from meal_bayes.domain import load_domain
from meal_bayes.errors import RobotError
from meal_bayes.robots import Outcome, Robot


def states(arm, *behaviors):
    return [arm.start(), *(arm.execute(behavior).state for behavior in behaviors)]


def test_it_is_a_robot_and_follows_its_diagram(sim, make_object):
    arm: Robot = sim.SimulatedArm(make_object(), 0)
    way = ("look", "press", "grasp", "lift", "hold", "shake", "lower", "lift", "drop", "push")
    assert states(arm, *way) == [
        "ready", "ready", "ready", "grasped", "lifted", "lifted", "lifted", "grasped", "lifted",
        "ready", "moved",
    ]  # fmt: skip
    assert arm.execute("reinit") == Outcome("ready", None)


def test_a_behavior_takes_the_simulated_seconds_that_it_costs(sim, make_object):
    arm = sim.SimulatedArm(make_object(), 0)
    arm.start()
    costs = {kind.name: kind.cost for kind in load_domain(sim.arm.DOMAIN).behaviors}
    for behavior in ("look", "press", "grasp", "lift", "hold", "shake", "lower", "lift", "drop"):
        before = arm.physics.seconds
        arm.execute(behavior)
        assert arm.physics.seconds - before == pytest.approx(costs[behavior])
    motions = sim.arm.BEHAVIORS
    seconds = {name: sum(motion.seconds for motion in motions[name]) for name in costs}
    assert seconds == pytest.approx(costs)


def test_what_it_cannot_do_is_refused(sim, make_object):
    arm = sim.SimulatedArm(make_object(), 0)
    assert arm.start() == "ready"
    with pytest.raises(RobotError, match="shake is not possible in the state 'ready'"):
        arm.execute("shake")
    with pytest.raises(RobotError, match="'shakes'"):
        arm.execute("shakes")


def test_a_heavy_slippery_object_slips_out_and_gives_no_features(sim, make_object):
    arm = sim.SimulatedArm(make_object(shell_mass=0.4, friction=0.25), 0)
    assert states(arm, "grasp", "lift") == ["ready", "grasped", "lifted"]
    outcome = arm.execute("shake")
    assert outcome.state in ("ready", "moved")
    assert outcome.features is None


@pytest.mark.long
def test_equal_seeds_repeat_everything_and_others_do_not(sim, make_object):
    def felt(seed):
        arm = sim.SimulatedArm(
            make_object(content="many small balls", n_balls=9, content_mass=0.1), seed, "again"
        )
        arm.start()
        return [arm.execute(name).features for name in ("look", "grasp", "lift", "shake")]

    first = felt(5)
    second = felt(5)
    other = felt(6)
    for a, b, c in zip(first, second, other, strict=True):
        for modality in a:
            np.testing.assert_array_equal(a[modality], b[modality])
            assert (a[modality] != c[modality]).any()


def test_the_kth_execution_has_its_own_noise_whatever_else_was_done(sim, make_object):
    def seen(*before):
        arm = sim.SimulatedArm(make_object(), 5)
        arm.start()
        for behavior in before:
            arm.execute(behavior)
        return arm.execute("look").features["color"]

    assert seen() == pytest.approx(seen("press"), abs=1e-4)
    assert (seen() != seen("look")).all()


def _push_off_the_table(physics):
    physics.data.joint("object").qpos[:3] = (0.5, 0.0, -0.3)


def _break_the_state(physics):
    physics.data.joint("object").qvel[0] = np.nan


def _spill(physics):
    physics.data.joint("ball_0").qpos[:3] = (0.1, 0.1, 1.8)


@pytest.mark.parametrize(
    ("meddle", "said"),
    [
        (_push_off_the_table, "fell off the table"),
        (_break_the_state, "not finite"),
        (_spill, "came apart"),
    ],
)
def test_a_fault_of_the_physics_is_a_robot_error(sim, make_object, meddle, said):
    balls = make_object(content="many small balls", n_balls=9, content_mass=0.1)
    arm = sim.SimulatedArm(balls, 0)
    arm.start()
    meddle(arm.physics)
    with pytest.raises(RobotError, match=said):
        arm.execute("look")


def test_a_gripper_that_jams_is_a_robot_error(sim, make_object):
    arm = sim.SimulatedArm(make_object(), 0)
    arm.start()
    arm.physics.model.actuator("grip").forcerange = (0.0, 0.0)  # no motor
    arm.physics.model.joint("left").damping = 1e6
    arm.physics.model.joint("right").damping = 1e6
    arm.physics.data.joint("left").qpos[0] = arm.physics.data.joint("right").qpos[0] = 0.0
    with pytest.raises(RobotError, match="gripper jams"):
        arm.execute("look")


def test_physics_warnings_leave_no_file_behind(sim, make_object, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arm = sim.SimulatedArm(make_object(), 0)
    arm.start()
    _break_the_state(arm.physics)
    with pytest.raises(RobotError):
        arm.execute("look")
    assert list(tmp_path.iterdir()) == []


def test_frames_come_thirty_times_a_second(sim, make_object):
    frames = []
    arm = sim.SimulatedArm(
        make_object(), 0, on_frame=lambda physics: frames.append(physics.seconds)
    )
    arm.start()
    arm.execute("hold" if arm.execute("grasp").state == "lifted" else "lift")
    assert len(frames) == pytest.approx(30 * 4.0, abs=2)  # grasp 2.5 s, lift 1.5 s

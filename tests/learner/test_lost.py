"""A robot whose trial was broken off during a behavior is nowhere in particular."""

import contextlib
import itertools

import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.learner import Learner, recall
from meal_bayes.planners import unvalued
from meal_bayes.robots import Outcome

LOOK, LIFT, RESET = range(3)


class Breaks:
    """A driver that raises in the middle of its n-th behavior, when the arm has moved."""

    def __init__(self, after, fault):
        self.left = after
        self.fault = fault
        self.state = "table"

    def start(self):
        return "table"

    def execute(self, behavior):
        self.state = {"lift": "held", "reset": "table"}.get(behavior, self.state)
        if self.left == 0:
            raise self.fault
        self.left -= 1
        return Outcome(self.state)


def broken_off(learner, after, fault, learn):
    """Drive a trial by commands, alternately up and down, until the driver raises."""
    robot = Breaks(after, fault)
    with contextlib.suppress(type(fault)), learner.begin(
        "full", state="table", commanded=True, learn=learn
    ) as session:  # fmt: skip
        for action in itertools.cycle((LIFT, RESET)):
            session.command(unvalued(session.momdp, action))
            session.observe(robot.execute(session.behavior))


@pytest.mark.parametrize("learn", [True, False])
@pytest.mark.parametrize("fault", [RuntimeError("stuck"), KeyboardInterrupt()], ids=repr)
@pytest.mark.parametrize("after", [0, 1, 2])
def test_no_trial_begins_in_a_state_that_nobody_knows(after, fault, learn, dataset, make, tmp_path):
    learner = make.learner(dataset, "greedy", logs=tmp_path)
    broken_off(learner, after, fault, learn)
    learner.save(tmp_path / "saved")
    loaded = Learner.load(tmp_path / "saved", logs=None)
    heirs = [learner, loaded]
    if learn:  # tests are not recalled
        heirs.append(make.learner(dataset, "greedy", logs=None))
        recall(heirs[-1], tmp_path)
    for heir in heirs:
        with pytest.raises(SettingsError, match=r"not known.*state='table'"):
            heir.begin("red")
        heir.begin("red", state="table", commanded=True).cancel()


def test_a_trial_that_is_given_up_leaves_the_robot_anywhere(dataset, make, tmp_path):
    learner = make.learner(dataset, "greedy", logs=tmp_path)
    broken_off(learner, 0, RuntimeError("stuck"), learn=True)
    (log,) = tmp_path.rglob("*.mcap")
    other = make.learner(dataset, "greedy", logs=None)
    other.give_up(log)
    with pytest.raises(SettingsError, match="not known"):
        other.begin("red")


def test_an_answer_leaves_the_robot_where_it_was(dataset, make):
    learner = make.learner(dataset, "greedy", logs=None)
    broken_off(learner, 0, RuntimeError("stuck"), learn=True)
    session = learner.begin("red", state="table", max_steps=1, max_cost=0.0)
    assert session.over
    learner.begin("red").cancel()

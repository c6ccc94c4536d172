"""A robot whose trial was broken off during a behavior is nowhere in particular."""

import contextlib
import copy
import itertools

import pytest

from meal_bayes.errors import RobotError, SettingsError
from meal_bayes.learner import Learner, recall
from meal_bayes.learner.question import LOST
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
    heirs = [learner, loaded, make.learner(dataset, "greedy", logs=None)]
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


@pytest.mark.parametrize("name", ["", "1.mcap"], ids=["dated", "undated"])
def test_a_trial_that_is_given_up_says_nothing_of_a_robot_seen_later(name, dataset, make, tmp_path):
    first = make.learner(dataset, "greedy", logs=None)
    session = first.begin("full", state="table", commanded=True, log=tmp_path / "first" / name)
    session.command(unvalued(session.momdp, LIFT))
    session.observe(Outcome("held"))
    session._recorder._file.close()  # as if the process had ended
    (draft,) = tmp_path.rglob("*.active")

    restarted = make.learner(dataset, "greedy", logs=None)
    restarted.begin("red", state="table", commanded=True).cancel()
    restarted.give_up(draft)
    restarted.begin("red", commanded=True).cancel()  # it is on the table, as it was last
    assert len(restarted.experience.executions) == 1


def test_an_answer_leaves_the_robot_where_it_was(dataset, make):
    learner = make.learner(dataset, "greedy", logs=None)
    broken_off(learner, 0, RuntimeError("stuck"), learn=True)
    session = learner.begin("red", state="table", max_steps=1, max_cost=0.0)
    assert session.over
    learner.begin("red").cancel()


class Starts:
    """A driver whose start() returns a state, or raises; and whose first behavior raises."""

    def __init__(self, state):
        self.state = state

    def start(self):
        if isinstance(self.state, BaseException):
            raise self.state
        return self.state

    def execute(self, behavior):
        raise OSError(behavior)


STARTS = ["held", "table", "nowhere", OSError("no arm"), KeyboardInterrupt()]


@pytest.mark.parametrize("find", [False, True])
@pytest.mark.parametrize("state", STARTS, ids=repr)
def test_the_state_that_a_robot_starts_in_is_known(dataset, make, state, find):
    """The first behavior does not move it, so that it is there yet when this raises."""
    learner = make.learner(dataset, make.agent("reset" if state == "held" else "look"))
    learner.begin("red", state="held", commanded=True).cancel()
    with pytest.raises((OSError, RobotError, KeyboardInterrupt)):
        learner.find("red", {"a": Starts(state)}) if find else learner.ask("red", Starts(state))
    expected = {"held": LOST, "table": "table"}.get(state, LOST)
    assert learner._robot_state == expected
    if expected == LOST:
        with pytest.raises(SettingsError, match="not known"):
            learner.begin("red")
    else:
        learner.begin("red").cancel()


def test_a_start_that_needs_no_behavior_is_known(dataset, make):
    learner = make.learner(dataset, "greedy")
    learner.ask("red", Starts("held"), max_cost=0.0)
    with pytest.raises(SettingsError, match="left the robot in state 'held'"):
        learner.begin("red")


def left(learner, state, learn, **options):
    """Leave the robot in a state at the end of a trial with an answer."""
    session = learner.begin("full", state="table", commanded=True, learn=learn, **options)
    for action, after in [(LOOK, "table"), (LIFT, "held")][: 1 + (state == "held")]:
        session.command(unvalued(session.momdp, action))
        session.observe(Outcome(after))
    session.command(unvalued(session.momdp, session.momdp.n_behaviors))


def starts_in(learner):
    """Return the state in which a trial can begin; LOST where there is none."""
    with contextlib.suppress(SettingsError):
        learner.begin("red").cancel()
        return "table"
    return learner._robot_state


@pytest.mark.parametrize("learn", [True, False])
@pytest.mark.parametrize("named", [False, True])
@pytest.mark.parametrize("states", [("held", "table"), ("table", "held")])
def test_the_last_trial_of_all_says_where_the_robot_is(
    dataset, make, tmp_path, states, named, learn
):
    """Also a test, and also where logs of earlier trials are recalled later."""
    folders = [tmp_path / "first", tmp_path / "last"]
    first = make.learner(dataset, "greedy")
    for folder, state in zip(folders, states, strict=True):
        left(first, state, learn, log=folder / "1.mcap" if named else folder)
    first.save(tmp_path / "saved")
    loaded = Learner.load(tmp_path / "saved", logs=None)
    for order in (folders, folders[::-1], [tmp_path]):
        for heir in (make.learner(dataset, "greedy"), loaded, first):
            for folder in order:
                recall(heir, folder)
            assert starts_in(copy.deepcopy(heir)) == states[-1]


def test_a_trial_that_went_on_after_the_learner_was_saved_says_where_the_robot_is(
    dataset, make, tmp_path
):
    learner = make.learner(dataset, "greedy", logs=tmp_path / "logs")
    session = learner.begin("full", state="table", commanded=True)
    learner.save(tmp_path / "saved")
    session.command(unvalued(session.momdp, LIFT))
    session.observe(Outcome("held"))
    session.command(unvalued(session.momdp, session.momdp.n_behaviors))
    loaded = Learner.load(tmp_path / "saved", logs=None)
    recall(loaded, tmp_path / "logs")
    assert starts_in(loaded) == "held"

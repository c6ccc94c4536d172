"""`Learner.find`: replays, a robot of one's own, by hand; logs, limits, faults, wrong input."""

import os
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.errors import LogError, QueryError, RobotError, SettingsError
from meal_bayes.learner import Learner
from meal_bayes.planners import Prospector
from meal_bayes.robots import Outcome, RobotPerObject
from meal_bayes.trial_log import read_search, read_trials
from meal_bayes.trials import run_search

BOXES = ("light_blue_beans", "medium_brown_rice", "heavy_green_glass", "heavy_blue_beans")


@pytest.fixture(scope="module")
def learner():
    return Learner("roc36", agent="olfc", logs=None).fit(load_percepts("roc36"))


def actions(search):
    return {
        name: [step.decision.action for step in trial.steps]
        for name, trial in search.trials.items()
    }


def test_it_claims_the_one_that_is_heavy_and_blue(learner):
    search = learner.find("Which of these is heavy and blue?", BOXES)
    assert search.claim == "heavy_blue_beans"
    assert search.success is True
    assert search.reward == pytest.approx(500 - search.cost)
    claimed = search.trials[search.claim]
    assert claimed.report.tolist() == [True]
    assert claimed.success is True
    for name in search.turns:
        if name != search.claim:
            assert search.trials[name].report is None
    assert search.cost == pytest.approx(sum(trial.cost for trial in search.trials.values()))


def test_none_of_them_is_an_answer(learner):
    search = learner.find("heavy", BOXES[:2])
    assert search.claim is None
    assert search.success is True
    assert "none of them (right)" in repr(search)


def test_equal_seeds_give_equal_searches(learner):
    first = learner.find("heavy and blue", BOXES)
    second = learner.find("heavy and blue", BOXES)
    assert actions(first) == actions(second)
    assert first.turns == second.turns


def test_one_object_is_explored_as_in_the_question(learner):
    for name in BOXES:
        search = learner.find("heavy and blue", [name])
        asked = learner.ask("heavy and blue", name, answer="yes or no", payoffs=(500, -500, 0, 0))
        found = [action for action in actions(search)[name] if action < asked.momdp.n_behaviors]
        alone = [
            step.decision.action
            for step in asked.steps
            if step.decision.action < asked.momdp.n_behaviors
        ]
        assert found == alone


def test_labels_of_the_objects_of_a_search_say_nothing_of_each_other(learner):
    table = learner.table
    labels = table.labels.copy()
    rows = [table.objects.index(name) for name in BOXES]
    labels[rows] = labels[rows[::-1]]
    others = Learner("roc36", agent="olfc", logs=None).fit(replace(table, labels=labels))
    sessions = [each.begin_find("heavy and blue", BOXES).sessions for each in (learner, others)]
    for name in BOXES:
        momdps = [each[name].momdp for each in sessions]
        np.testing.assert_array_equal(momdps[0].prior, momdps[1].prior)
        np.testing.assert_array_equal(momdps[0].confusion, momdps[1].confusion)


def test_turning_that_costs_too_much_is_left_alone(learner):
    search = learner.find("heavy", BOXES, turn_cost=1000.0)
    assert search.turns == ()
    assert search.claim is None
    assert search.success is False
    cheap = learner.find("heavy", BOXES, turn_cost=5.0)
    spent = sum(trial.cost for trial in cheap.trials.values())
    assert cheap.cost == pytest.approx(spent + 5.0 * len(cheap.turns))


def test_a_held_object_is_put_down_before_another_is_taken(learner):
    search = learner.find("heavy", BOXES)
    leave = set(learner.domain.leave)
    for name in search.turns:
        trial = search.trials[name]
        if name != search.claim:
            assert trial.momdp.x_names[trial.steps[-1].x] in leave


def test_limits_are_of_the_whole_search(learner):
    search = learner.find("heavy", BOXES, max_steps=3)
    assert sum(step.cost > 0 for t in search.trials.values() for step in t.steps) <= 3
    assert not search.ended
    search = learner.find("heavy", BOXES, max_cost=4.0)
    assert search.cost <= 4.0
    search = learner.find("heavy", BOXES, max_cost=4.0, turn_cost=5.0)
    assert search.turns == ()


def test_the_trials_are_logged_by_object(learner, tmp_path):
    search = learner.find("heavy and blue", BOXES, log=tmp_path)
    logged = {trial.task.object_name: trial for trial in read_trials(tmp_path)}
    assert set(logged) == set(search.turns) | {search.claim}
    for name, trial in logged.items():
        np.testing.assert_array_equal(trial.truth, search.trials[name].truth)
        assert [s.decision.action for s in trial.steps] == actions(search)[name]
        assert trial.momdp.reports.payoffs.right_no == 0.0


class Table:
    """Objects on a table, by their replays, with a switch that breaks the robot."""

    def __init__(self, session, learner, fails_after=1000):
        replays = {name: learner.replay(each.task) for name, each in session.sessions.items()}
        self._robot = RobotPerObject(replays)
        self._left = fails_after

    def turn_to(self, name):
        return self._robot.turn_to(name)

    def execute(self, behavior):
        self._left -= 1
        if self._left < 0:
            raise RobotError("the arm is stuck")
        return self._robot.execute(behavior)


def test_a_search_is_driven_by_hand(learner):
    whole = learner.find("heavy and blue", BOXES)
    session = learner.begin_find("heavy and blue", BOXES)
    table = Table(session, learner)
    while not session.over:
        assert "none; under way" in repr(session)
        assert session.search.success is None
        if session.turn is not None:
            assert session.behavior is None
            with pytest.raises(SettingsError, match="No behavior is under way"):
                session.observe(Outcome("x0"))
            session.turned(table.turn_to(session.turn))
        else:
            with pytest.raises(SettingsError, match="No turn is under way"):
                session.turned("x0")
            session.observe(table.execute(session.behavior))
    assert actions(session.search) == actions(whole)
    assert session.search.claim == whole.claim


@pytest.mark.parametrize("state", ["term", "x9", None])
def test_an_object_is_in_no_state_where_no_robot_can_be(learner, state):
    session = learner.begin_find("heavy and blue", BOXES)
    with pytest.raises(RobotError, match="x0"):
        session.turned(state)
    with pytest.raises(SettingsError, match="No behavior is under way"):
        session.fail()
    session.turned("x0")
    while session.turn is None:
        with pytest.raises(RobotError, match="x0"):
            session.observe(Outcome(state))
        session.fail()
        if session.over:
            return
    with pytest.raises(RobotError, match="x0"):
        session.turned(state)


def test_a_robot_that_breaks_ends_all_trials_and_the_search(learner, tmp_path):
    session = learner.begin_find("heavy and blue", BOXES, log=tmp_path)
    with pytest.raises(RobotError, match="stuck"):
        run_search(session, Table(session, learner, fails_after=2))
    assert session.over
    assert "the arm is stuck" in session.search.ended
    assert session.search.success is None
    (trial,) = read_trials(tmp_path)
    assert "the arm is stuck" in trial.ended
    assert len(trial.steps) == 2


@pytest.mark.parametrize("part", ["on_step", "planner", "log"])
def test_what_breaks_between_two_behaviors_ends_the_search(learner, monkeypatch, tmp_path, part):
    """Nobody waits for a robot that waits for it; what it did is in the logs."""
    steps = []

    def broken(*args, **options):
        if len(steps) == 9:
            raise OSError("no more")
        return prospect(*args) if args[1:] else None

    prospect = Prospector.prospect
    session = learner.begin_find(
        "heavy and blue", BOXES, log=tmp_path / "it",
        on_step=lambda step: (steps.append(step), part == "on_step" and broken(step)),
    )  # fmt: skip
    if part == "planner":
        monkeypatch.setattr(Prospector, "prospect", broken)
    if part == "log":
        monkeypatch.setattr(os, "fsync", broken)
    with pytest.raises((OSError, LogError), match="no more"):
        run_by_hand(session, Table(session, learner))
    assert session.over
    assert "no more" in session.search.ended
    assert len(steps) == 9
    assert sum(bool(trial.steps) for trial in session.search.trials.values()) > 1
    if part == "log":
        for one in (session, *session.sessions.values()):
            if one._recorder is not None:
                one._recorder._file.close()
    else:
        assert read_search(tmp_path / "it").ended == session.search.ended
        assert sum(len(trial.steps) for trial in read_trials(tmp_path / "it")) == 9


def run_by_hand(session, table):
    while not session.over:
        if session.turn is not None:
            session.turned(table.turn_to(session.turn))
        else:
            session.observe(table.execute(session.behavior))


def test_failures_leave_the_state_and_the_search_goes_on(learner):
    session = learner.begin_find("heavy", BOXES[2:])
    with session:
        session.turned("x0")
        first = session.behavior
        session.fail()
        trial = session.search.trials[session.object]
        assert trial.steps[0].observation is None
        assert trial.steps[0].x == trial.steps[0].next_x
        assert session.behavior == first
    assert session.search.ended == "left before the answer"


@pytest.mark.parametrize(
    ("objects", "match"),
    [
        ([], "0 objects"),
        (["heavy_blue_beans", "heavy_blue_beans"], "listed twice"),
        (["caf\u00e9", "cafe\u0301"], "look the same"),  # an accent coded in two ways
        ("heavy_blue_beans", "give names"),
        (["heavy_blue_beans", 3], "give names"),
        (0, "expected 1 to"),
        (True, "give names"),
        (None, "give names"),
        (["", "heavy_blue_beans"], "is empty"),
        (["no_such_object"], "no_such_object"),
        (3, "sensors"),
    ],
)
def test_wrong_objects_are_one_line(learner, objects, match):
    with pytest.raises(SettingsError, match=match) as fault:
        learner.find("heavy", objects)
    assert "\n" not in str(fault.value)


def test_where_nobody_is_left_to_learn_from_it_is_said(learner):
    table = learner.table
    heavy = table.labels[:, table.domain.columns(["heavy"])[0]] == 1
    names = np.array(table.objects)
    with pytest.warns(UserWarning, match="the table has none that is heavy: how such an object"):
        learner.begin_find("heavy", names[heavy].tolist())
    with pytest.warns(UserWarning, match="the table has none that is not heavy"):
        learner.begin_find("heavy or blue", names[~heavy].tolist())
    with pytest.raises(SettingsError, match=r"whether it is heavy: nobody is left.*fewer"):
        learner.find("heavy", names.tolist())


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"payoffs": (1, 2, 3, 4)}, "two numbers"),
        ({"payoffs": (-500, 500)}, "has the least"),
        ({"payoffs": ("a", 0)}, "give numbers"),
        ({"payoffs": 5}, "two numbers"),
        ({"none": 500.0}, "nothing would be searched"),
        ({"none": float("nan")}, "give numbers"),
        ({"none": -900.0}, "has the least"),
        ({"turn_cost": -1}, "turn_cost"),
        ({"turn_cost": "far"}, "turn_cost"),
        ({"max_cost": "30"}, "max_cost"),
        ({"max_cost": float("nan")}, "max_cost"),
        ({"truth": 5}, "truth"),
        ({"max_steps": 1.5}, "max_steps"),
        ({"max_steps": "a", "log": "never made"}, "max_steps"),
        ({"log": 5}, "log is 5; give a path"),
        ({"truth": {"nobody": {"heavy": True}}}, "none of the objects"),
    ],
)
def test_wrong_options_are_one_line(learner, options, match):
    with pytest.raises((SettingsError, QueryError), match=match) as fault:
        learner.find("heavy", BOXES, **options)
    assert "\n" not in str(fault.value)


def test_an_agent_without_values_is_refused():
    unvalued = Learner("roc36", agent="predefined", logs=None).fit(load_percepts("roc36"))
    with pytest.raises(SettingsError, match="compares no values"):
        unvalued.find("heavy", BOXES)


def test_a_learner_finds_with_a_robot_and_learns(dataset, make, tmp_path):
    learner = make.learner(dataset, "olfc", logs=tmp_path)
    arms = RobotPerObject({"1": make.arm(), "2": make.arm()})
    search = learner.find("Which one is red?", 2, arms, truth={"1": {"red": True}}, learn=True)
    assert set(search.trials) == {"1", "2"}
    assert len({trial.task.object_name for trial in search.trials.values()}) == 2
    for name in search.turns:
        assert search.trials[name].task.key in learner.experience.trials
    with pytest.raises(SettingsError, match="turn_to"):
        learner.find("red", 2, make.arm())

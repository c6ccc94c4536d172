"""Trials with a live robot: what is wrong is no percept, and no step is ever lost."""

import itertools
import math
import os
import re
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.datasets import Dataset
from meal_bayes.domain import domain_from_table
from meal_bayes.errors import LogError, RobotError, SettingsError
from meal_bayes.evaluation import summarize
from meal_bayes.learner import Learner
from meal_bayes.learner.views import attempts
from meal_bayes.robots import Outcome, OutcomeChecker
from meal_bayes.trial_log import check_log, read_trials, recover_log, salvage

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
PLAN = ("look", "lift", "reset", "look")

GOOD = np.array([40.0, 60.0, 190.0])
WRONG = {
    "nan": ({"color": [math.nan, 60, 190]}, "found NaN or infinity"),
    "too large for float32": ({"color": [1e39, 60, 190]}, "found NaN or infinity"),
    "too long": ({"color": [*GOOD, 1.0]}, r"shape \(4,\); expected \(3,\)"),
    "unknown modality": ({"colour": GOOD}, r"color is not among \['colour'\]"),
    "no modality": ({}, r"color is not among \[\]"),
    "words": ({"color": ["4_0", "60", "190"]}, "found text"),  # 40 to NumPy
    "masked": ({"color": np.ma.array(GOOD, mask=[1, 0, 0])}, "found masked values"),
    "ragged": ({"color": [[1, 2], [3]]}, "found no array of numbers"),
    "not by modality": (GOOD, r"not \{modality: numbers\}"),
}


@pytest.mark.parametrize("kind", WRONG)
def test_what_is_no_percept_moves_no_belief_and_is_warned_of(dataset, make, tmp_path, kind):
    features, says = WRONG[kind]
    learner = make.learner(dataset, make.agent("look", **make.ours))
    path = tmp_path / "a.mcap"
    trial = learner.ask("red", make.faulty(Outcome("table", features)), log=path)
    step = trial.steps[0]
    assert step.observation is None
    np.testing.assert_array_equal(step.belief.log_odds, trial.first_belief.log_odds)
    (back,) = read_trials(path)
    for logged in (trial, back):
        assert pytest.approx(1.0) == logged.steps[0].cost
        assert re.search(says, logged.steps[0].warning)
        assert logged.steps[0].warning.startswith("no percept of look: ")
    assert not trial.ended


@pytest.mark.parametrize("surplus", [{}, {"force": [1.0]}])
def test_a_good_percept_has_no_warning(dataset, make, surplus):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    trial = learner.ask("red", make.faulty(Outcome("table", {"color": GOOD, **surplus})))
    assert trial.steps[0].observation is not None
    assert not any(step.warning for step in trial.steps)


@pytest.mark.parametrize("weight", [None, [math.nan], [1.0, 2.0]])
def test_a_percept_is_made_of_the_modalities_that_are_there(make, weight):
    look, *others = make.kitchen["behaviors"]
    two = {**make.kitchen, "behaviors": [{**look, "modalities": ["color", "weight"]}, *others]}
    plain = make.dataset()
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(*plain.features["look", "color"].shape[:2], 1)).astype(np.float32)
    dataset = Dataset(
        domain_from_table(two), plain.objects, {**plain.features, ("look", "weight"): noise},
        plain.labels,
    )  # fmt: skip
    learner = make.learner(dataset, make.agent("look", "look", **make.ours))
    features = {"color": GOOD} if weight is None else {"color": GOOD, "weight": weight}
    with pytest.warns(UserWarning, match="look by color alone: weight") as caught:
        trial = learner.ask("red", make.faulty(Outcome("table", features)), truth={"red": False})
    assert len(caught) == 1  # a trial
    assert trial.success
    assert all(step.observation is not None for step in trial.steps[:2])
    assert "by color alone" in repr(trial)


class Breaks(Exception):
    """A driver's own error."""


def breaking(make, after, fault):
    """Make an arm whose driver fails after some behaviors."""
    arm = make.arm()
    execute = arm.execute

    def executed(behavior):
        if len(arm.executed) == after:
            raise fault
        return execute(behavior)

    arm.execute = executed
    return arm


@pytest.mark.parametrize("after", range(4))
@pytest.mark.parametrize(
    "fault", [Breaks("the gripper is hot"), KeyboardInterrupt(), SystemExit(3)]
)
def test_an_exception_is_raised_once_the_log_is_whole(dataset, make, tmp_path, after, fault):
    learner = make.learner(dataset, make.agent(*PLAN, **make.ours))
    path = tmp_path / "a.mcap"
    with pytest.raises(type(fault)):
        learner.ask("red", breaking(make, after, fault), log=path, truth={"red": False})
    assert check_log(path).whole
    (trial,) = read_trials(path)
    assert [trial.momdp.behavior_names[s.decision.action] for s in trial.steps] == [*PLAN[:after]]
    assert trial.ended == f"robot error: {type(fault).__name__}{f': {fault}' * bool(str(fault))}"
    assert trial.report is None
    assert trial.success is None


@pytest.mark.parametrize(
    ("outcome", "says"),
    [
        (Outcome("tabel"), "did you mean 'table'"),
        (Outcome(None), "state"),
        (Outcome("term"), "'term', .*expected one of table, held; return the state"),
        (Outcome("term", {"color": [1.0, 2.0, 3.0]}), "'term', .*expected one of table, held"),
        (("table", None), r"return an Outcome\(state, features\)"),
        (None, r"return an Outcome\(state, features\)"),
    ],
)
def test_an_unknown_state_ends_the_trial(dataset, make, tmp_path, outcome, says):
    learner = make.learner(dataset, make.agent(*PLAN, **make.ours))
    path = tmp_path / "a.mcap"
    with pytest.raises(RobotError, match=says):
        learner.ask("red", make.faulty(outcome), log=path)
    (trial,) = read_trials(path)
    assert trial.ended.startswith("robot error: RobotError: execute('look')")
    assert trial.steps == ()


@pytest.mark.parametrize("state", [99, "term", None, np.array(["table", "term"])])
def test_an_unknown_state_at_the_start(dataset, make, tmp_path, state):
    robot = make.faulty(None)
    robot.start = lambda: state
    with pytest.raises(RobotError, match=r"start\(\)"):
        make.learner(dataset).ask("red", robot, log=tmp_path / "a.mcap")
    (trial,) = read_trials(tmp_path / "a.mcap")
    assert trial.ended.startswith("robot error: RobotError: start()")


KILLED = """
import os, runpy, signal, sys
from pathlib import Path
sys.path.insert(0, {here!r})
import conftest as make
last, path = int(sys.argv[1]), sys.argv[2]
arm = make.Arm()
execute = arm.execute
def executed(behavior):
    if len(arm.executed) == last:
        os.kill(os.getpid(), signal.SIGKILL)
    return execute(behavior)
arm.execute = executed
learner = make.make_learner(make.make_dataset(), make.agent_of(*{plan!r}, **make.OURS))
learner.ask("red", arm, log=path)
"""


@pytest.mark.parametrize("step", [2, *(pytest.param(k, marks=pytest.mark.long) for k in (0, 1, 3))])
def test_a_kill_at_every_step_loses_no_earlier_step(dataset, make, tmp_path, step):
    code = KILLED.format(here=str(HERE), plan=PLAN)
    path = tmp_path / "a.mcap"
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(
        [sys.executable, "-c", code, str(step), str(path)], env=environment, check=False
    )
    assert done.returncode == -signal.SIGKILL
    assert not path.exists()
    (active,) = tmp_path.glob("a.w*.mcap.active")
    expected = make.learner(dataset, make.agent(*PLAN, **make.ours)).ask("red", make.arm())
    (trial,) = salvage(active)
    assert trial.ended
    assert trial.success is None
    assert len(trial.steps) == step
    for saved, wanted in zip(trial.steps, expected.steps, strict=False):
        assert saved.decision.action == wanted.decision.action
        np.testing.assert_array_equal(saved.observation, wanted.observation)
        np.testing.assert_array_equal(saved.belief.log_prob, wanted.belief.log_prob)
    (again,) = read_trials(recover_log(active))
    assert (len(again.steps), again.ended) == (step, trial.ended)


def test_logs_of_a_session_stand_in_one_folder(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look", **make.ours), logs=tmp_path)
    for name in (None, "mug", "a/b"):
        learner.ask("red", make.arm(), object_name=name)
    names = [path.name for path in sorted((tmp_path / "kitchen").iterdir())]
    for name, part in zip(
        names, ("object_[0-9a-f]{16}-[0-9a-f]{8}", "mug", "a_b-[0-9a-f]{8}"), strict=True
    ):
        assert re.fullmatch(rf"\d{{8}}-\d{{6}}-\d{{6}}-{part}-[0-9a-f]{{6}}\.mcap", name)


def test_live_trials_are_clustered_by_the_names_of_objects(dataset, make):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    trials = []
    for n in range(12):
        options = {"truth": {"red": n % 2 == 0}, "object_name": f"o{n % 5}"}
        trials.append(learner.ask("red", make.arm(red=n % 2 == 0, seed=n), **options))
    assert math.isfinite(summarize(trials)[0].accuracy_se)


def test_a_person_who_is_asked_answers_by_name():
    table = {
        "name": "asking",
        "attributes": ["red", "full"],
        "behaviors": [{"name": "ask", "cost": 9.0, "answer_accuracy": 0.9}],
        "diagram": {
            "states": ["x0"],
            "start": "x0",
            "effects": [{"from": "x0", "do": "ask", "to": "x0"}],
        },
    }
    domain = domain_from_table(table)
    for outcome, answers, warned in (
        (Outcome("x0", answers={"red": True}), {"red": True}, False),
        (Outcome("x0", answers={"red": "yes"}), None, True),
        (Outcome("x0", answers={"blue": True}), None, True),
        (Outcome("x0", {"color": [1.0]}), None, True),
        (Outcome("x0"), None, False),
    ):
        result = OutcomeChecker(domain).execute(0, outcome)
        assert result.answers == answers
        assert bool(result.warning) == warned
        assert result.instance is None


def test_two_trials_about_one_object_at_once_have_two_logs(dataset, make, tmp_path):
    learner = make.learner(dataset, logs=tmp_path)
    with learner.begin("red", "mug"), learner.begin("red", "mug"):
        pass
    assert len(list(tmp_path.glob("kitchen/*-mug-*.mcap"))) == 2
    assert len(list((tmp_path / "kitchen").iterdir())) == 2


def test_a_folder_that_cannot_be_made_is_told(dataset, make, tmp_path):
    (tmp_path / "kitchen").touch()
    learner = make.learner(dataset, logs=tmp_path)
    with pytest.raises(LogError, match=r"kitchen.* cannot be written"):
        learner.begin("red")


def test_what_is_sensed_in_a_motion_that_failed_is_left_aside(dataset, make):
    learner = make.learner(dataset)
    with pytest.warns(UserWarning, match="yielded nothing several times"):
        trial = learner.ask("full", make.faulty(Outcome("table", {"force": [5.5]})), learn=True)
    lifts = [step for step in trial.steps if step.decision.action == 1]
    assert 2 <= len(lifts) <= 3
    assert {step.warning for step in lifts} == {"it failed: what it sensed is left aside"}
    assert attempts(learner.experience)[1].tolist() == [len(lifts), 0]


def test_a_way_that_the_diagram_does_not_have_is_no_success(dataset, make):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    with pytest.warns(UserWarning, match="the diagram excludes"):
        learner.ask("red", make.faulty(Outcome("held")))
    assert attempts(learner.experience)[0].tolist() == [1, 0]


def test_an_outcome_counts_once_where_a_callback_raises(dataset, make):
    def broken(step):
        raise OSError

    learner = make.learner(dataset, make.agent("look", "look", **make.ours))
    session = learner.begin("red", on_step=broken)
    for fault in (OSError, SettingsError):
        with pytest.raises(fault):
            session.observe(Outcome("table", {"color": GOOD}))
    assert len(session.steps) == 1


def test_a_trial_that_is_over_is_not_driven_again(dataset, make, tmp_path):
    """Its process ended between the name of the whole log and the end of the draft before it."""
    learner = make.learner(dataset, make.agent("look", "look", **make.ours), logs=tmp_path)
    arm = make.arm()
    session = learner.begin("red", state=arm.start())
    session.observe(arm.execute(session.behavior))
    draft = session._recorder.active_path
    left = draft.read_bytes()
    session.observe(arm.execute(session.behavior))
    assert session.over
    draft.write_bytes(left)
    for name in (None, draft):
        with pytest.raises(LogError, match="nothing to resume"):
            learner.resume(name)


@pytest.mark.parametrize("ticks", [True, False])
def test_a_clock_among_the_features_of_a_robot_is_named_once(make, ticks):
    """It has no name by which it could be known, but grows with every trial."""
    times = itertools.count(17.0, 0.25)
    steady = np.random.default_rng(3)

    class Timed(make.arm):
        def execute(self, behavior):
            outcome = super().execute(behavior)
            tick = next(times) if ticks else steady.normal()
            features = {name: [*values, tick] for name, values in outcome.features.items()}
            return Outcome(outcome.state, features)

    learner = Learner(make.kitchen, agent=make.agent("look", **make.ours), logs=None)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        for number in range(16):
            red = bool(number % 2)
            trial = learner.ask("red", Timed(red=red, seed=number), object_name=f"cup {number}")
            learner.tell(trial, {"red": red})
        learner.refit()
    texts = [str(warning.message) for warning in caught]
    assert len(texts) == ticks
    assert all("color of look: column 4 of 4 only grows" in text for text in texts)

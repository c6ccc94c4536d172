"""What is no path, name, trial or function where a learner expects one: one error, no trial."""

import unicodedata

import pytest

from meal_bayes import Learner, MealBayesError, Outcome, load_domain, load_percepts, read_trials
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.learner import recall
from meal_bayes.trial_log import Logs, check_log, log_info, read_feedback, read_header, salvage

NO_PATHS = [3, 3.0, None, True, b"logs", ["logs"], ("a", "b"), {}, "", "a\0b", object()]
READERS = {
    "read_trials": read_trials,
    "Logs": Logs,
    "log_info": log_info,
    "check_log": check_log,
    "read_header": read_header,
    "read_feedback": read_feedback,
    "salvage": salvage,
    "load_percepts": load_percepts,
    "Learner.load": Learner.load,
}


@pytest.fixture
def learner(dataset, make):
    return make.learner(dataset, make.agent("look"))


@pytest.mark.parametrize("value", NO_PATHS)
@pytest.mark.parametrize("name", READERS)
def test_what_is_no_path_is_told_to_who_reads(name, value):
    with pytest.raises(SettingsError, match="give a path"):
        READERS[name](value)


@pytest.mark.parametrize("value", NO_PATHS)
def test_what_is_no_path_is_told_to_a_learner(learner, make, value):
    arm = make.arm()
    calls = [lambda: learner.save(value), lambda: recall(learner, value)]
    if value is not None:
        calls += [
            lambda: Learner(learner.domain, logs=value),
            lambda: learner.ask("red", arm, log=value),
            lambda: learner.begin("red", log=value),
            lambda: learner.resume(value),
        ]
    for call in calls:
        with pytest.raises(SettingsError, match="give a path"):
            call()
    assert not arm.executed
    if not isinstance(value, dict):
        with pytest.raises(SettingsError, match=r"give a path|Unknown domain"):
            load_domain(value)


@pytest.mark.parametrize("value", [5, 2.5, None, b"mug", ["mug"], ("mug",), {"mug": 1}, print])
def test_what_is_no_trial_nor_name_is_told(learner, make, value):
    trial = learner.ask("red", make.arm(), object_name="mug")
    for call in (
        lambda: learner.forget(value),
        lambda: learner.tell(value, {"red": True}),
        lambda: learner.record(value),
        lambda: learner.record("mug"),
        lambda: learner.forget(trial.task),
        lambda: learner.forget(trial, recordings=value),
        lambda: learner.save("mind", overwrite=value),
    ):
        with pytest.raises(SettingsError):
            call()


@pytest.mark.parametrize("value", [5, "print", [], {}, b"", True])
def test_what_cannot_be_called_is_told_before_the_robot_moves(learner, make, value):
    arm = make.arm()
    with pytest.raises(SettingsError, match="on_step"):
        learner.ask("red", arm, on_step=value)
    with pytest.raises(SettingsError, match="seed is"):
        learner.begin("red", seed=value if not value else "3")
    assert not arm.executed


@pytest.mark.parametrize("name", ["", " mug", "mug ", "a\nb", "a\x00b", "m" * 201, 5, b"mug"])
def test_an_object_that_cannot_be_told_of_is_not_asked_about(learner, make, name):
    arm = make.arm()
    with pytest.raises(MealBayesError, match="name"):
        learner.ask("red", arm, object_name=name)
    assert not arm.executed


@pytest.mark.parametrize("form", ["NFC", "NFD"])
@pytest.mark.parametrize("change", ["{}\u200b", "caf\u00e9  1", "caf\u00e9\u00a01", "{}\ufeff"])
def test_an_object_is_not_two_by_what_cannot_be_seen(learner, make, form, change):
    name = unicodedata.normalize(form, "caf\u00e9 1")
    learner.ask("red", make.arm(), object_name=name)
    others = {
        unicodedata.normalize("NFD" if form == "NFC" else "NFC", name),
        change.format(name),
    } - {name}
    for other in others:
        arm = make.arm()
        for call in (
            lambda other=other, arm=arm: learner.ask("red", arm, object_name=other),
            lambda other=other: learner.tell(other, {"red": True}),
        ):
            with pytest.raises(QueryError, match="cannot be seen"):
                call()
        assert not arm.executed
    assert len(learner.experience.objects) == 13


@pytest.mark.parametrize("number", ["1", 1.0, True, -2, 2**31, 2**70, (1,), float("nan"), b"1"])
def test_a_recording_that_is_none_costs_its_percept_alone(dataset, make, tmp_path, number):
    learner = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    outcomes = iter((number, None))
    robot = make.faulty(
        lambda: Outcome("table", {"color": [9.0, 9.0, 9.0]}, recording=next(outcomes))
    )
    trial = learner.ask("red", robot)
    assert [step.observation is None for step in trial.steps[:2]] == [True, False]
    assert "recording" in trial.steps[0].warning
    assert [len(each.steps) for each in Logs(tmp_path).trials()] == [len(trial.steps)]

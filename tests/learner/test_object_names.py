"""Names that cannot be told apart and recordings that are none: one error or warning, no trial."""

import unicodedata
import warnings
from dataclasses import replace

import pytest

from meal_bayes import Learner, MealBayesError, Outcome
from meal_bayes.errors import QueryError
from meal_bayes.learner import recall
from meal_bayes.perception import build_percept_table
from meal_bayes.trial_log import Logs


@pytest.fixture
def learner(dataset, make):
    return make.learner(dataset, make.agent("look"))


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


@pytest.mark.parametrize(
    ("name", "other"), [("caf\u00e9", "cafe\u0301"), ("a\u00a0b", "a b"), ("a b", "a  b")]
)
def test_no_door_lets_in_an_object_that_looks_like_another(dataset, make, tmp_path, name, other):
    """After the refusal all is as before: the learner works, and a saved copy can be read."""
    theirs = make.learner(dataset, make.agent("look"), logs=tmp_path / "theirs")
    trial = theirs.ask("red", make.arm(), object_name=other)
    theirs.tell("cup 1", {"red": True})
    learner = make.learner(dataset, make.agent("look"), logs=tmp_path / "ours")
    learner.ask("red", make.arm(), object_name=name)
    named = replace(make.dataset(1), objects=(other, *dataset.objects[1:]))
    table = build_percept_table(named)
    rows = len(learner.experience.instances), len(learner.experience.feedback)
    for call in (
        lambda: learner.fit(named),
        lambda: learner.fit(table),
        lambda: learner.record(trial),
        lambda: recall(learner, tmp_path / "theirs"),
        lambda: recall(make.learner(dataset, make.agent("look")), tmp_path),
    ):
        with pytest.raises(QueryError, match="cannot be seen"):
            call()
    assert rows == (len(learner.experience.instances), len(learner.experience.feedback))
    assert other not in learner.experience.objects
    learner.refit().save(tmp_path / "saved")
    saved = Learner.load(tmp_path / "saved", agent=make.agent("look"), logs=None)
    saved.ask("red", make.arm())


def test_trials_that_are_open_at_once_are_of_objects_that_look_different(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look"))
    session = learner.begin("red", "a b")
    with pytest.raises(QueryError, match="cannot be seen"):
        learner.begin("red", "a  b")
    session.cancel()
    theirs = make.learner(dataset, make.agent("look"), logs=tmp_path)
    theirs.begin("red", "a  b")._recorder._file.close()  # as the end of its process does
    learner.ask("red", make.arm(), object_name="a b")
    with pytest.raises(QueryError, match="cannot be seen"):
        learner.resume(tmp_path, state="table")
    assert learner.give_up(tmp_path).task.object_name == "a  b"
    assert "a  b" not in learner.experience.objects
    learner.refit()


def test_a_name_may_come_back_in_another_form_when_it_was_forgotten(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look"), logs=tmp_path)
    trial = learner.ask("red", make.arm(), object_name="a b")
    learner.tell("a b", {"red": True})
    learner.forget("a b")
    learner.forget(trial, recordings=True)
    learner.ask("red", make.arm(), object_name="a  b")
    back = make.learner(dataset, make.agent("look"))
    recall(back, tmp_path)
    assert {*back.experience.met} == {*dataset.objects, "a  b"}


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


@pytest.mark.parametrize(
    ("name", "warned"),
    [("mgu", "beside mug"), ("nobdy", "beside mug"), ("mug 2", None), ("mugs", "mean 'mug'")],
)
def test_a_label_of_an_object_that_nobody_met_is_told(dataset, make, name, warned):
    """A new object is legitimate; before any is met nothing is said."""
    nobody = Learner(dataset.domain, agent="bayes", logs=None)
    nobody.tell("nobdy", {"red": True})
    learner = Learner(dataset.domain, agent=make.agent("look", **make.ours), logs=None)
    for other in ("mug", "mug 1"):
        learner.ask("red", make.arm(), object_name=other)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        learner.tell(name, {"red": True})
    texts = [str(warning.message) for warning in caught]
    assert len(texts) == (warned is not None)
    assert all(repr(name) in text and warned in text for text in texts)
    assert learner.experience.labels_of_trial(("told", name))[0] == 1

"""A trial that was forgotten with its recordings has never been: nothing counts it any more."""

import warnings
from dataclasses import fields, is_dataclass

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes.agents import Agent
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.learner import Learner, recall, views
from meal_bayes.planners import Untouched
from meal_bayes.robots import Outcome

pytestmark = pytest.mark.filterwarnings(
    "ignore:There is no recording", "ignore:According to the logs"
)

NAMES = ("mug", "pot", "cup 1", None)
ROBOTS = ("senses", "fails", "answers at once")


def ask(learner, make, number, name, robot):
    """Ask about an object, by streams of the number, what robots of some kind sense of it."""
    learner.agent = make.agent("look", "look", "lift", **make.ours)
    if robot == "answers at once":
        learner.agent = Agent("still", lambda domain, query: Untouched(), **make.ours)
    arm = make.faulty(Outcome("table")) if robot == "fails" else make.arm(seed=number)
    return learner.ask("red", arm, object_name=name, key=number)


def assert_same(ours, theirs):
    """Check that two values are equal, field by field."""
    if is_dataclass(ours):
        for field in fields(ours):
            assert_same(getattr(ours, field.name), getattr(theirs, field.name))
    else:
        np.testing.assert_array_equal(np.asarray(ours), np.asarray(theirs))


def next_decisions(learner, make, name):
    """Return what an agent that values exploration decides of the next object."""
    learner.agent = "bayes"
    trial = learner.ask("red, full", make.arm(seed=99), object_name=name, key=99)
    return [[s.decision.action, *s.decision.values.tolist()] for s in trial.steps]


EVENTS = st.lists(
    st.tuples(
        st.sampled_from(NAMES),
        st.sampled_from(ROBOTS),
        st.dictionaries(st.sampled_from(("red", "full")), st.booleans()),
        st.booleans(),  # whether it is forgotten
    ),
    min_size=1,
    max_size=5,
)


@pytest.mark.long
@given(events=EVENTS, later=st.booleans())
@example(events=[("pot", "answers at once", {"red": True}, True)], later=False)
@example(events=[("pot", "senses", {}, True), ("mug", "senses", {"red": True}, False)], later=True)
@settings(max_examples=max(settings().max_examples // 10, 4), deadline=None)
def test_a_forgotten_trial_has_never_been(dataset, make, events, later):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of what fails
        ours = make.learner(dataset)
        theirs = make.learner(dataset)
        forgotten = []
        for number, (name, robot, labels, forgets) in enumerate(events):
            for learner in (ours,) if forgets else (ours, theirs):
                trial = ask(learner, make, number, name, robot)
                learner.tell(trial, labels)
                if forgets and later:
                    forgotten.append(trial)
                elif forgets:
                    learner.forget(trial, recordings=True)
        for trial in forgotten:
            ours.forget(trial, recordings=True)
        for learner in (ours, theirs):
            learner.agent = "bayes"
            learner.refit()
        assert repr(ours.experience) == repr(theirs.experience)
        task = ours.task("red", "mug")
        fits = [learner.fitted(learner.agent) for learner in (ours, theirs)]
        for name in (None, "mug", "pot"):
            assert_same(*(fit.progress(task, name) for fit in fits))
        decided = [next_decisions(learner, make, "mug") for learner in (ours, theirs)]
    np.testing.assert_equal(*decided)


@pytest.mark.parametrize("robot", ROBOTS)
def test_a_trial_is_forgotten_once(dataset, make, tmp_path, robot):
    learner = make.learner(dataset, logs=tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        trial = ask(learner, make, 0, "mug", robot)
    learner.forget(trial, recordings=True)
    assert views.trials_before(learner.experience, ()) == 0
    with pytest.raises(SettingsError, match="has no labels or recordings"):
        learner.forget(trial, recordings=True)
    again = make.learner(dataset)
    assert recall(again, tmp_path) == []
    assert views.trials_before(again.experience, ()) == 0
    learner.save(tmp_path / "it.mind")
    loaded = Learner.load(tmp_path / "it.mind", agent=learner.agent, logs=None)
    assert views.trials_before(loaded.experience, ()) == 0


def test_the_name_of_a_forgotten_object_is_nobody_s(dataset, make):
    """A slip of the pen that was forgotten neither stands in the way nor is offered again."""
    learner = make.learner(dataset)
    slips = ("saucers", "caf\N{LATIN SMALL LETTER E WITH ACUTE}")
    for number, name in enumerate(slips):
        learner.forget(ask(learner, make, number, name, "senses"), recordings=True)
    with warnings.catch_warnings():
        warnings.filterwarnings("error", ".*saucers")  # it is not known any more
        learner.tell("saucer", {"red": True})  # of which it was a typo
        learner.tell("cafe\N{COMBINING ACUTE ACCENT}", {"red": True})  # which looks the same
    for name in slips:
        with pytest.raises((QueryError, SettingsError), match="Unknown object"):
            learner.forget(name)


def test_recordings_are_not_forgotten_by_a_name(dataset, make):
    learner = make.learner(dataset, make.agent("look"))
    trial = learner.ask("red", make.arm(), object_name="cup")
    learner.tell("cup", {"red": True})
    with pytest.raises(SettingsError, match=r"forget\(trial, recordings=True\)"):
        learner.forget("cup", recordings=True)
    assert learner.experience.labels_of_trial(("told", "cup"))[0] == 1
    learner.forget(trial, recordings=True)
    assert len(learner.experience.instances_of_trial(trial.task.key)) == 0


@pytest.mark.parametrize("call", ["record", "forget"])
@pytest.mark.parametrize("value", [5, None, b"cup", ["cup"]])
def test_what_is_no_trial_is_refused(dataset, call, value):
    learner = Learner(dataset.domain, agent="prior", logs=None)
    with pytest.raises(SettingsError, match="class Trial"):
        getattr(learner, call)(value)

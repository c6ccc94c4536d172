"""A session takes one call at a time, of whichever thread; a second one changes nothing."""

import copy
import threading
from unittest.mock import Mock

import numpy as np
import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.planners import unvalued
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import Logs, check_log
from meal_bayes.trials.session import Recorder

SEEN = Outcome("table", {"color": [9.0, 9.0, 9.0]})
CALLS = {
    "observe": lambda session: session.observe(SEEN),
    "fail": lambda session: session.fail(),
    "cancel": lambda session: session.cancel(),
    "start": lambda session: session.start("table"),
    "command": lambda session: session.command(unvalued(session.momdp, 0)),
    "record": lambda session: session.record(Mock(spec=Recorder)),
    "the end of its block": lambda session: session.__exit__(None, None, None),
}


class Watcher:
    """A callback that does something in the midst of a session's first step."""

    def __init__(self):
        self.session = None
        self.what = None
        self.happened = []

    def __call__(self, step):
        what = self.what
        self.what = None
        if what is not None:
            try:
                self.happened.append(what(self.session))
            except SettingsError as error:
                self.happened.append(error)


def in_a_thread(call):
    """Return a call as another thread makes it, whose error is raised here."""

    def called(session):
        caught = []

        def run():
            try:
                call(session)
            except SettingsError as error:
                caught.append(error)

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        thread.join(60)
        assert not thread.is_alive()
        if caught:
            raise caught[0]

    return called


WAYS = {"callback": lambda call: call, "thread": in_a_thread}


@pytest.fixture
def watcher():
    return Watcher()


@pytest.fixture
def unlogged(dataset, make):
    return make.learner(dataset, make.agent("look", "look"))


@pytest.fixture
def learner(dataset, make, tmp_path):
    return make.learner(dataset, make.agent("look", "look"), logs=tmp_path)


def check_refused(watcher, name):
    (error,) = watcher.happened
    assert isinstance(error, SettingsError)
    assert "accepts one call at a time" in str(error)
    assert str(error).lower().startswith(name)


@pytest.mark.quick(7)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("name", CALLS)
def test_a_call_inside_another_is_refused_and_changes_nothing(
    learner, watcher, tmp_path, name, way
):
    plain = learner.begin("red", key="k")
    session = learner.begin("red", key="k", on_step=watcher)
    watcher.session = session
    watcher.what = WAYS[way](CALLS[name])
    for each in (plain, session):
        while each.behavior is not None:
            each.observe(SEEN)
    check_refused(watcher, "cancel" if "end" in name else name.replace("fail", "observe"))
    actions = [[step.decision.action for step in each.trial.steps] for each in (plain, session)]
    assert actions[0] == actions[1]
    np.testing.assert_array_equal(session.report, plain.report)
    assert [len(trial.steps) for trial in Logs(tmp_path).trials()] == [len(actions[0])] * 2
    assert all(check_log(path).whole for path in (tmp_path / "kitchen").glob("*.mcap"))


def test_an_error_of_its_block_is_told_though_another_call_is_inside(unlogged, watcher):
    session = unlogged.begin("red", on_step=watcher)
    watcher.session = session

    def left(session):
        with session:
            raise SettingsError("of the block")

    watcher.what = in_a_thread(left)
    session.observe(SEEN)
    (error,) = watcher.happened
    assert str(error) == "of the block"
    assert "accepts one call at a time" in error.__notes__[0]
    assert session.behavior == "look"


def test_a_session_takes_the_next_call_after_one_that_raised(unlogged):
    session = unlogged.begin("red")
    for _ in range(2):
        with pytest.raises(SettingsError, match="late or twice"):
            session.observe(SEEN, step=7)
    session.observe(SEEN, step=0)
    assert len(session.steps) == 1


def test_a_copy_made_inside_a_call_acts_alone(unlogged, watcher):
    session = unlogged.begin("red", on_step=watcher)
    watcher.session = session
    watcher.what = copy.deepcopy
    session.observe(SEEN)
    (twin,) = watcher.happened
    twin.cancel()
    assert twin.over
    assert not session.over


def test_a_failure_is_of_the_behavior_that_was_under_way(unlogged, monkeypatch):
    """Another thread may give an outcome between what `fail` reads and what it does."""
    session = unlogged.begin("red")
    observe = type(session).observe

    def later(self, outcome, *, step=None):
        monkeypatch.setattr(type(session), "observe", observe)
        session.observe(SEEN)
        observe(self, outcome, step=step)

    monkeypatch.setattr(type(session), "observe", later)
    with pytest.raises(SettingsError, match="late or twice"):
        session.fail()
    assert len(session.steps) == 1

"""Logs stay where they were named, also where the process changes its folder meanwhile."""

import contextlib

import pytest

from meal_bayes import Learner, Outcome
from meal_bayes.errors import SettingsError
from meal_bayes.learner import recall
from meal_bayes.trial_log import ACTIVE, Logs

pytestmark = pytest.mark.filterwarnings("ignore:There is no recording")


def seen(number):
    return Outcome("table", {"color": [60.0 * number, 40.0, 90.0]})


def asked(learner, elsewhere):
    """Ask with a robot whose driver changes the folder before it answers."""
    session = learner.begin("red", "mug")
    while session.behavior is not None:
        with elsewhere():
            session.observe(seen(len(session.steps)))
    return session.trial


@pytest.fixture
def elsewhere(tmp_path, monkeypatch):
    """Another folder, for a block."""
    home = tmp_path / "home"
    other = tmp_path / "other"
    for folder in (home, other):
        folder.mkdir()
    monkeypatch.chdir(home)

    @contextlib.contextmanager
    def inside():
        monkeypatch.chdir(other)
        yield
        monkeypatch.chdir(home)

    return inside


@pytest.mark.parametrize("log", [None, "own/a.mcap"])
def test_a_trial_and_its_labels_stay_together(dataset, make, tmp_path, elsewhere, log):
    agent = make.agent("look", "look", **make.ours)
    learner = make.learner(dataset, agent, logs="logs")
    trial = asked(learner, elsewhere)
    named = learner.ask("red", make.faulty(seen(1)), object_name="pot", log=log)
    with elsewhere():
        learner.tell(trial, {"red": True})
        learner.tell(named, {"red": False})
        learner.tell("cup", {"full": True})
    assert not list((tmp_path / "other").iterdir())
    assert not list(tmp_path.rglob(f"*{ACTIVE}"))
    heir = make.learner(dataset, agent)
    places = ["logs"] if log is None else ["logs", "own"]
    assert len(recall(heir, *places)) == 2
    with elsewhere():
        heir.forget(trial)
    for key in (trial.task.key, named.task.key, ("told", "cup")):
        told = [each.experience.labels_of_trial(key).tolist() for each in (learner, heir)]
        assert (told[0] == told[1]) == (key != trial.task.key)
    judged = {each.task.key: each.success for each in Logs(*places).trials()}
    assert all(success is not None for success in judged.values())


def test_a_trial_is_resumed_in_another_folder(dataset, make, tmp_path, elsewhere):
    agent = make.agent("look", "look", **make.ours)
    first = make.learner(dataset, agent, logs="logs")
    session = first.begin("red", "mug")
    session.observe(seen(0))
    session._recorder._file.close()  # as the end of its process did
    again = make.learner(dataset, agent, logs="logs")
    with elsewhere():
        resumed = again.resume(state="table")
        while resumed.behavior is not None:
            resumed.observe(seen(1))
    assert [len(trial.steps) for trial in Logs("logs").trials()] == [3]
    assert not list((tmp_path / "other").iterdir())


def test_a_folder_that_is_gone_is_told(make, tmp_path, monkeypatch):
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    with pytest.raises(SettingsError, match="not exist any more; give a path that begins with /"):
        Learner(make.kitchen, logs="logs")
    Learner(make.kitchen, logs=tmp_path / "logs")

"""A trial that somebody else drives, and that a callback, a planner or the disk breaks off."""

import dataclasses

import pytest

from meal_bayes import Outcome
from meal_bayes.agents import Agent
from meal_bayes.errors import LogError, RobotError, SettingsError
from meal_bayes.planners import Predefined, unvalued
from meal_bayes.trial_log import ACTIVE, Logs, TrialWriter


class Broken(Exception):
    """What a callback raises."""


class Untold(Exception):
    """An exception of another package that cannot be shown as text."""

    def __str__(self):
        raise AttributeError("details")


FAULTS = [
    Broken("x"), KeyboardInterrupt(), SystemExit(2), MemoryError(), GeneratorExit(), Untold()
]  # fmt: skip


def seen(state="table"):
    return Outcome(state, {"color": [9.0, 9.0, 9.0]})


def raised_at(step, fault):
    """Return a callback that raises at a step."""
    steps = iter(range(99))

    def on_step(_):
        if next(steps) == step:
            raise fault

    return on_step


def driven(session):
    """Show a session the same until it is over."""
    while session.behavior is not None:
        session.observe(seen())


def check_over(session, learner, folder, steps, why):
    """Check that a trial is over, whole in its log, and known to its learner."""
    assert session.over
    assert session.behavior is None
    assert session.trial.ended.startswith(why)
    assert not list(folder.rglob(f"*{ACTIVE}"))
    assert [len(trial.steps) for trial in Logs(folder).trials()] == [steps]
    assert len(learner.experience.executions) == min(steps, 2)
    with pytest.raises(SettingsError, match="over"):
        session.observe(seen())


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: type(fault).__name__)
@pytest.mark.parametrize("step", [0, 1, 2])
def test_a_callback_that_raises_ends_the_trial(dataset, make, tmp_path, step, fault):
    learner = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    session = learner.begin("red", on_step=raised_at(step, fault))
    with pytest.raises(type(fault)) as caught:
        driven(session)
    assert "meal-bayes log show" in caught.value.__notes__[0]
    check_over(session, learner, tmp_path, step + 1, f"on_step error: {type(fault).__name__}")


def test_a_callback_that_drives_its_own_trial_ends_it(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    session = learner.begin("red", on_step=lambda _: session.observe(seen()))
    with pytest.raises(SettingsError, match="one call at a time"):
        session.observe(seen())
    check_over(session, learner, tmp_path, 1, "on_step error: SettingsError")


class Failing:
    """A planner, and its policy, that raises at one of its decisions."""

    def __init__(self, step):
        self.step = step

    def solve(self, momdp, rng):
        self.policy = Predefined(("look", "look")).solve(momdp, rng)
        return self

    def decide(self, history, rng):
        if len(history.actions) == self.step:
            raise Broken
        return self.policy.decide(history, rng)


@pytest.mark.parametrize("step", [0, 1, 2])
def test_a_planner_that_raises_ends_the_trial(dataset, make, tmp_path, step):
    agent = Agent("failing", lambda domain, query: Failing(step))
    learner = make.learner(dataset, agent, logs=tmp_path)
    with pytest.raises(Broken):
        driven(learner.begin("red"))
    (trial,) = Logs(tmp_path).trials()
    assert trial.ended.startswith("planner error: Broken")
    assert len(trial.steps) == step
    assert not list(tmp_path.rglob(f"*{ACTIVE}"))


def test_a_full_disk_is_what_ends_the_trial(dataset, make, tmp_path, monkeypatch):
    learner = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    session = learner.begin("red")
    put = TrialWriter._put

    def full(writer, messages, **options):
        writer._open = False
        with writer._faults_named():
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(TrialWriter, "_put", full)
    with pytest.raises(LogError, match="No space left"):
        session.observe(seen())
    monkeypatch.setattr(TrialWriter, "_put", put)
    assert session.over
    assert session.trial.ended.startswith("log error: LogError")
    assert len(learner.experience.executions) == 0


@pytest.mark.parametrize("decision", [None, 0, "look", ["look"], (0,)])
def test_a_command_is_a_decision(dataset, make, decision):
    session = make.learner(dataset, make.agent("look")).begin("red", commanded=True)
    with pytest.raises(SettingsError, match="takes a Decision"):
        session.command(decision)
    assert not session.over
    assert dataclasses.is_dataclass(session.trial)


@pytest.mark.parametrize("on_step", [None, lambda step: None], ids=["silent", "watched"])
def test_whoever_drives_is_not_taken_for_a_callback(dataset, make, tmp_path, on_step):
    learner = make.learner(dataset, make.agent("look"), logs=tmp_path)
    session = learner.begin("red", commanded=True, on_step=on_step)

    def drive():
        with session:
            session.command(unvalued(session.momdp, 0))
            session.observe(seen())
            raise Broken("hot")

    with pytest.raises(Broken):
        drive()
    assert session.trial.ended == "robot error: Broken: hot"


def test_a_trial_that_a_fault_ended_is_named_and_goes_on(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    with pytest.raises(Broken):
        driven(learner.begin("red", "mug", on_step=raised_at(0, Broken("x"))))
    (log,) = tmp_path.rglob("*.mcap")
    with pytest.raises(LogError, match=r"red of mug.*on_step error: Broken.*resume\('") as caught:
        learner.resume()
    assert repr(str(log)) in str(caught.value)
    session = learner.resume(log, state="table")
    driven(session)
    assert len(session.steps) == 3
    with pytest.raises(LogError, match=r"nothing to resume\. The file of a learner"):
        learner.resume()


@pytest.mark.parametrize("steps", range(3))
def test_a_robot_that_was_moved_is_not_commanded(dataset, make, tmp_path, steps):
    agent = make.agent("lift", "reset", "look")
    learner = make.learner(dataset, agent, logs=tmp_path)
    session = learner.begin("red", "mug")
    arm = make.arm()
    arm.start()
    for _ in range(steps):
        session.observe(arm.execute(session.behavior))
    session._recorder._file.close()  # as the end of its process did
    other = "held" if arm.state == "table" else "table"
    with pytest.raises(SettingsError, match=rf"resume\(state='{arm.state}'\)"):
        learner.resume()
    with pytest.raises(RobotError, match=r"resume\(state=\)"):
        learner.resume(state="nowhere")
    with pytest.raises(LogError, match=rf"Bring it to '{arm.state}'.*give_up\(\)"):
        learner.resume(state=other)
    resumed = learner.resume(state=arm.state)  # whoever was refused holds nothing
    assert len(resumed.steps) == steps
    assert resumed.behavior == session.behavior
    resumed.cancel()
    assert not list(tmp_path.rglob(f"*{ACTIVE}"))

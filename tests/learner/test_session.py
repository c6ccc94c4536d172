"""Sessions: a trial driven from outside, from threads and asyncio, across restarts."""

import threading
from concurrent.futures import ThreadPoolExecutor
from functools import partial

import numpy as np
import pytest

from meal_bayes.errors import LogError, RobotError, SettingsError
from meal_bayes.learner import Learner
from meal_bayes.planners import unvalued
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import Logs, check_log, read_trials, salvage
from meal_bayes.trials import trials_frame

PLAN = ("look", "lift", "reset", "look", "lift")


def drive(session, arm):
    while session.behavior is not None:
        session.observe(arm.execute(session.behavior))
    return session.trial


def started(arm):
    arm.start()
    return arm


def assert_same(first, second):
    """Check that two trials are equal but for the object's name."""
    assert [s.decision.action for s in first.steps] == [s.decision.action for s in second.steps]
    np.testing.assert_array_equal(first.report, second.report)
    for a, b in zip(first.steps, second.steps, strict=True):
        np.testing.assert_array_equal(a.observation, b.observation)
        np.testing.assert_array_equal(a.belief.log_prob, b.belief.log_prob)


@pytest.fixture
def learner(dataset, make, tmp_path):
    return make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)


def logs_of(folder):
    return sorted((folder / "kitchen").glob("*.mcap"))


def test_a_session_makes_the_trial_of_ask(learner, make):
    asked = learner.ask("red", make.arm(), key="k")
    trial = drive(learner.begin("red", state="table", key="k"), started(make.arm()))
    assert_same(trial, asked)
    assert trial.report is not None
    assert trial.task.key != asked.task.key


def test_every_step_is_on_disk_before_the_next_behavior_is_named(learner, make, tmp_path):
    session = learner.begin("red")
    arm = started(make.arm())
    (draft,) = (tmp_path / "kitchen").glob("*.active")
    for number in range(len(PLAN)):
        (trial,) = salvage(draft)
        assert len(trial.steps) == number
        session.observe(arm.execute(session.behavior))
    assert session.behavior is None
    (path,) = logs_of(tmp_path)
    assert check_log(path).whole


def test_a_failed_behavior_changes_nothing_but_the_cost(learner):
    session = learner.begin("red")
    session.fail()
    (step,) = session.steps
    assert step.observation is None
    assert step.x == step.next_x
    assert step.cost == 1.0
    assert session.behavior == "lift"
    session.cancel()


def test_limits_bring_the_best_report(learner, make):
    whole = learner.ask("red", make.arm(), key="k")
    for options, limit in (({"max_steps": 2}, "max_steps = 2"), ({"max_cost": 4.5}, "4.5 s")):
        trial = learner.ask("red", make.arm(), key="k", **options)
        assert len(trial.steps) == 3
        for text in (
            repr(trial), trial.to_frame().warning.iloc[-1], trials_frame([trial]).warnings[0],
        ):  # fmt: skip
            assert f"{limit} was reached" in text
        np.testing.assert_array_equal(trial.report, trial.last_belief.best_report)
        assert trial.cost < whole.cost
    assert len(learner.ask("red", make.arm(), max_cost=0.5).steps) == 1
    assert "was reached" not in repr(whole)
    for wrong in ({"max_steps": "a"}, {"max_steps": 2.5}, {"max_steps": -1}, {"max_cost": "a"},
                  {"max_cost": float("nan")}):  # fmt: skip
        with pytest.raises(SettingsError, match="; give "):
            learner.begin("red", state="table", **wrong)


def test_a_cancelled_session_is_logged_without_a_report(learner, make, tmp_path):
    session = learner.begin("red")
    arm = started(make.arm())
    session.observe(arm.execute(session.behavior))
    session.cancel()
    session.cancel()  # once more does nothing
    (path,) = logs_of(tmp_path)
    (trial,) = read_trials(path)
    assert (trial.ended, trial.report, len(trial.steps)) == ("cancelled", None, 1)
    assert session.behavior is None
    with pytest.raises(SettingsError, match="No behavior is in progress"):
        session.observe(Outcome("table"))


def test_a_session_left_in_the_middle_says_so(learner, tmp_path):
    with learner.begin("red"):
        pass
    with pytest.raises(ZeroDivisionError) as caught, learner.begin("red"):
        1 / 0  # noqa: B018
    assert "meal-bayes log show" in caught.value.__notes__[0]
    ended = [trial.ended for path in logs_of(tmp_path) for trial in read_trials(path)]
    assert ended == [
        "left before the answer", "robot error: ZeroDivisionError: division by zero"
    ]  # fmt: skip


def test_a_trial_begins_once(learner):
    with pytest.raises(SettingsError, match="has begun"), learner.begin("red") as session:
        session.start("table")


def test_an_outcome_that_comes_late_or_twice_is_refused_where_its_step_is_named(learner, make):
    arm = started(make.arm())
    session = learner.begin("red")
    outcome = arm.execute(session.behavior)
    session.observe(outcome, step=0)
    for again in (lambda: session.observe(outcome, step=0), lambda: session.fail(step=2)):
        with pytest.raises(SettingsError, match="late or twice"):
            again()
    assert len(session.steps) == 1
    session.observe(arm.execute(session.behavior), step=1)
    assert len(session.steps) == 2
    session.cancel()


@pytest.mark.quick(3)
@pytest.mark.parametrize("steps", range(len(PLAN) + 1))
def test_a_restart_goes_on_as_if_undisturbed(learner, make, tmp_path, steps):
    learner.save(tmp_path / "mind")

    def loaded():
        return Learner.load(tmp_path / "mind", agent=learner.agent, logs=tmp_path)

    whole = loaded()
    undisturbed = drive(whole.begin("red"), started(make.arm()))
    first = loaded().begin("red", truth={"red": False})
    arm = started(make.arm())
    for _ in range(steps):
        if first.behavior is not None:
            first.observe(arm.execute(first.behavior))
    if first.over:
        with pytest.raises(LogError, match="nothing to resume"):
            learner.resume(logs_of(tmp_path)[-1])
        return
    (draft,) = (tmp_path / "kitchen").glob("*.active")
    again = loaded()
    with pytest.raises(LogError, match="is open in this process"):
        again.resume(draft)
    first._recorder._file.close()  # as the end of its process did
    second = again.resume(state=arm.state)
    with pytest.raises(LogError, match=r"is open in|nothing to resume"):
        loaded().resume(draft)  # one process drives
    assert_same(drive(second, arm), undisturbed)
    assert second.trial.task == first.task
    (log,) = [path for path in logs_of(tmp_path) if second.task.object_name[7:] in path.name]
    (trial,) = read_trials(log)
    assert_same(trial, undisturbed)
    assert trial.success is not None
    assert not draft.exists()
    for mind, done in ((whole, undisturbed), (again, second.trial)):
        mind.tell(done, {"red": False, "full": True})
        mind.refit()
    for context, sensed in whole.experience.features.items():
        np.testing.assert_equal(again.experience.features[context], sensed)
    counts = [mind.knowledge().posterior.counts for mind in (whole, again)]
    np.testing.assert_array_equal(*counts)  # of what was not asked, too


@pytest.mark.parametrize("steps", [0, 1])
def test_a_resumption_that_ended_too_is_resumed_from_the_furthest_draft(
    dataset, make, tmp_path, steps
):
    """The second process had written so many of the first one's steps again, or gone on."""
    learner = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    first = learner.begin("red")
    arm = started(make.arm())
    for _ in range(2):
        first.observe(arm.execute(first.behavior))
    first._recorder._file.close()
    again = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    second = again.resume(state=arm.state)
    for _ in range(steps):
        second.observe(arm.execute(second.behavior))
    second._recorder._file.close()
    second._recorder._resumed.release()
    assert len(list(tmp_path.rglob("*.active"))) == 2
    last = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    third = last.resume(first._recorder.active_path, state=arm.state)  # any draft names the trial
    assert len(third.steps) == 2 + steps
    drive(third, arm)
    assert len(logs_of(tmp_path)) == 1
    assert not list(tmp_path.rglob("*.active"))


@pytest.mark.parametrize("seed", [None, 5])
def test_a_restart_draws_by_the_seed_that_the_trial_was_begun_with(dataset, make, tmp_path, seed):
    whole, first, again = (
        make.learner(dataset, "random", logs=tmp_path / name) for name in ("a", "b", "b")
    )
    undisturbed = drive(whole.begin("red", seed=seed), started(make.arm()))
    session = first.begin("red", seed=seed)
    arm = started(make.arm())
    if session.behavior is not None:
        session.observe(arm.execute(session.behavior))
    if not session.over:
        session._recorder._file.close()
        session = again.resume(state=arm.state)
    assert_same(drive(session, arm), undisturbed)


def test_a_restart_goes_on_being_commanded(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    first = learner.begin("red", commanded=True)
    arm = started(make.arm())
    first.command(unvalued(first.momdp, learner.domain.behavior_index("lift")))
    first.observe(arm.execute("lift"))
    first._recorder._file.close()
    again = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    second = again.resume(state="held")
    # As none can be that decides by itself.
    second.command(unvalued(second.momdp, learner.domain.behavior_index("reset")))
    assert second.behavior == "reset"
    second.cancel()


def test_a_restart_with_other_knowledge_goes_on_from_the_log(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    session = learner.begin("red")
    arm = started(make.arm())
    session.observe(arm.execute("look"))
    other = make.learner(dataset, make.agent("lift", **make.ours), logs=tmp_path)
    (draft,) = (tmp_path / "kitchen").glob("*.active")
    session._recorder._file.close()
    resumed = other.resume(draft, state="table")
    with pytest.warns(UserWarning, match="step 0, .* look, but the agent would now choose lift"):
        assert resumed.behavior is None  # it answers at once
    assert resumed.steps[0].decision.action == session.steps[0].decision.action
    resumed.cancel()
    assert len(other.experience.executions) == 1
    assert not list(tmp_path.rglob("*.active"))


@pytest.mark.parametrize("steps", [1, 2])
def test_a_resumed_trial_that_is_cancelled_is_not_planned(
    dataset, make, tmp_path, monkeypatch, steps
):
    agent = make.agent(*PLAN, **make.ours)
    learner = make.learner(dataset, agent, logs=tmp_path)
    session = learner.begin("red")
    arm = started(make.arm())
    for _ in range(steps):
        session.observe(arm.execute(session.behavior))
    session._recorder._file.close()
    again = make.learner(dataset, agent, logs=tmp_path)
    decided = []
    monkeypatch.setattr("meal_bayes.trials.session.decide", lambda *_: decided.append(1))
    again.resume(state=arm.state).cancel("not wanted")
    assert not decided
    assert not list(tmp_path.rglob("*.active"))
    (log,) = tmp_path.rglob("*.mcap")
    (trial,) = read_trials(log)
    assert (len(trial.steps), trial.ended) == (steps, "not wanted")
    assert len(again.experience.executions) == steps


def test_a_trial_is_given_up_without_its_agent(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
    session = learner.begin("red")
    session.observe(started(make.arm()).execute("look"))
    session._recorder._file.close()
    for levels in (2, 4):  # of others the steps mean other things
        agent = make.agent("look", **{**make.ours, "levels": levels})
        other = make.learner(dataset, agent, logs=tmp_path)
        if levels == 2:
            with pytest.raises(LogError, match=r"4 levels.*give_up\(\)"):
                other.resume(state="table")
    trial = other.give_up()
    assert (len(trial.steps), trial.ended) == (1, "cancelled")
    assert len(other.experience.executions) == 1
    assert not list(tmp_path.rglob("*.active"))
    with pytest.raises(LogError, match="nothing to resume"):
        other.give_up()


def test_a_restart_knows_how_the_trial_was_begun(dataset, make, tmp_path):
    agent = make.agent("reset", *PLAN, **make.ours)
    learner = make.learner(dataset, agent, logs=tmp_path)
    first = learner.begin("red", state="held", max_steps=2, max_cost=2.0, learn=False)
    (draft,) = (tmp_path / "kitchen").glob("*.active")
    recorded = len(learner.experience.instances)
    first._recorder._file.close()
    second = make.learner(dataset, agent, logs=tmp_path).resume(draft, state="held")
    assert second.behavior == "reset"  # as on the table it is not allowed
    arm = make.arm()
    arm.state = "held"
    trial = drive(second, arm)
    assert trial.steps[-1].warning == "the best answer when max_steps = 2 was reached"
    assert len(learner.experience.instances) == recorded


@pytest.mark.long
def test_eight_threads_disturb_nothing(dataset, make, tmp_path):
    learner = make.learner(dataset, logs=tmp_path)
    plain = make.learner(dataset)

    def many(thread):
        return [
            drive(learner.begin("red", key=k), started(make.arm(seed=k)))
            for k in range(25 * thread, 25 * thread + 25)
        ]

    with ThreadPoolExecutor(8) as pool:
        done = [trial for trials in pool.map(many, range(8)) for trial in trials]
    for k, trial in enumerate(done):
        assert_same(trial, plain.ask("red", make.arm(seed=k), key=k))
    assert sum(len(group.outcomes) for group in Logs(tmp_path).groups()) == 200
    assert len(logs_of(tmp_path)) == 200
    assert len({trial.task.key for trial in done}) == 200


def test_a_session_begun_in_one_thread_goes_on_in_another(learner, make):
    session = learner.begin("red")
    arm = started(make.arm())
    for _ in PLAN:
        thread = threading.Thread(target=lambda: session.observe(arm.execute(session.behavior)))
        thread.start()
        thread.join()
    assert session.report is not None


def test_two_sessions_have_no_object_and_no_trial_in_common(dataset, make, tmp_path):
    trials = []
    for _ in range(2):
        learner = make.learner(dataset, make.agent(*PLAN, **make.ours), logs=tmp_path)
        trials += [learner.ask("red", make.arm()) for _ in range(3)]
    assert len({trial.task.key for trial in trials}) == 6
    assert len({trial.task.object_name for trial in trials}) == 6


@pytest.mark.parametrize("state", ["term", "tabel", "", 0])
def test_a_trial_neither_begins_nor_goes_on_where_no_robot_can_be(learner, make, tmp_path, state):
    with pytest.raises(RobotError, match=r"table, held|did you mean 'table'|expected one of"):
        learner.begin("red", key="k", state=state)
    assert not list(tmp_path.rglob("*.*"))  # no log of what has not begun
    with learner.begin("red", key="k") as session:
        with pytest.raises(RobotError):
            session.observe(Outcome(state))
        assert session.behavior == "look"  # it is waited for still
        trial = drive(session, started(make.arm()))
    assert trial.report is not None


def test_several_broken_trials_are_listed(learner, tmp_path):
    sessions = [learner.begin("red", object_name=name) for name in ("mug", "cup")]
    for session in sessions:
        session._recorder._file.close()
    with pytest.raises(LogError, match=r"2 interrupted trials: red of (mug|cup)"):
        learner.resume()
    with pytest.raises(LogError, match="no interrupted trial"):
        learner.resume(tmp_path / "none")


ENDS = {
    "cancelled": lambda session, arm: session.cancel(),
    "failed": lambda session, arm: session.fail(),
    "abandoned": lambda session, arm: None,
    "answered": drive,
}


@pytest.mark.parametrize("end", ENDS)
def test_a_trial_does_not_begin_where_the_robot_is_not(dataset, make, tmp_path, end):
    plan = ("look", "lift") if end == "answered" else ("look", "lift", "reset")
    agent = make.agent(*plan, **make.ours)
    learner = make.learner(dataset, agent, logs=tmp_path)
    arm = started(make.arm())
    session = learner.begin("red", learn=end != "answered")
    for _ in range(2):
        if session.behavior:
            session.observe(arm.execute(session.behavior))
    ENDS[end](session, arm)
    learner.save(tmp_path / "mind")
    for heir in (learner, Learner.load(tmp_path / "mind", agent=agent, logs=None)):
        with pytest.raises(SettingsError, match=r"state 'held'.*begin\(\.\.\., state='held'\)"):
            heir.begin("red")
        assert heir.ask("red", make.arm()).report is not None  # start() says where it is
        heir.begin("red", state="table", commanded=True).cancel()
        heir.begin("red").cancel()
    session.cancel()


@pytest.mark.parametrize("resumed", [False, True])
@pytest.mark.parametrize("named", [False, True])
def test_a_trial_that_is_open_in_this_process_is_ended_by_its_session(
    learner, tmp_path, named, resumed
):
    session = learner.begin("red")
    if resumed:
        session._recorder._file.close()
        session = learner.resume(state="table")
    log = next(tmp_path.rglob("*.active")) if named else None
    for call in (learner.give_up, partial(learner.resume, state="table")):
        with pytest.raises(LogError, match=r"open in this process.*cancel\(\)"):
            call(log)
    session.cancel()
    assert not list(tmp_path.rglob("*.active"))

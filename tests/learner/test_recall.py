"""What people told, in logs: of tests, of another's trials, taken back, told again by `recall`."""

import contextlib

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from meal_bayes.errors import SettingsError
from meal_bayes.learner import Learner, recall
from meal_bayes.learner.views import attempts
from meal_bayes.perception import build_percept_table
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import Logs

PLAN = ("look", "lift", "reset", "look", "lift")


def test_tests_are_no_experience_and_their_labels_are_of_the_object(dataset, make, tmp_path):
    agent = make.agent("look", **make.ours)
    first = make.learner(dataset, agent, logs=tmp_path)
    again = make.learner(dataset, agent)
    test = first.ask("red", make.arm(), object_name="mug", learn=False)
    taught = first.ask("red", make.arm(), object_name="mug")
    assert [trial.task.key for trial in recall(again, tmp_path)] == [taught.task.key]
    assert len(again.experience.executions) == len(taught.steps) - 1
    first.tell(test, {"red": True})
    assert first.experience.labels_of_trial(("told", "mug"))[0] == 1
    assert len(first.experience.executions) == 1
    first.forget(test)
    assert first.experience.labels_of_trial(("told", "mug"))[0] == -1


@pytest.mark.filterwarnings("ignore:There is no recording")
def test_what_is_told_stands_in_the_logs(dataset, make, tmp_path):
    """As told of a trial, of an object, taken back, of a test; and in a log that was named."""
    learner = make.learner(dataset, make.agent("look", **make.ours), logs=tmp_path / "logs")
    trials = [
        learner.ask("red", make.arm(), object_name="mug", learn=learn, log=log)
        for learn, log in ((True, None), (False, None), (True, tmp_path / "own" / "a.mcap"))
    ]

    def truths(folder):
        logged = {
            trial.task.key: int(trial.truth[0])
            for group in Logs(tmp_path / folder).groups()
            for trial in group.trials
        }
        return [logged[trial.task.key] for trial in trials if trial.task.key in logged]

    assert truths("logs") == [-1, -1]
    learner.tell(trials[0], {"red": True, "full": False})
    assert truths("logs") == [1, -1]
    learner.tell(trials[1], {"red": False})  # a test's labels are of the object
    assert truths("logs") == [0, 0]
    learner.forget("mug")
    assert truths("logs") == [1, -1]
    learner.tell(trials[2], {"red": None})
    assert truths("own") == [-1]
    learner.tell(trials[2], {"red": True})
    assert truths("own") == [1]
    learner.tell(trials[2], {"red": True})  # nothing new
    assert len(list((tmp_path / "own").rglob("*.feedback.mcap"))) == 1
    unlogged = make.learner(dataset, make.agent("look", **make.ours))
    unlogged.tell("mug", {"red": True})
    assert len(list(tmp_path.rglob("*.feedback.mcap"))) == 4


TELLINGS = st.lists(
    st.tuples(
        st.sampled_from((0, 1, 2, "mug", "cup 1")),  # a trial, or an object by its name
        st.dictionaries(st.sampled_from(("red", "full")), st.booleans(), max_size=2),
    ),
    max_size=8,
)


@given(tellings=TELLINGS, saved=st.integers(0, 8))
@example(
    tellings=[("mug", {"full": True}), (0, {"red": False, "full": False}), ("mug", {"full": True})],
    saved=2,
)  # what is told again is the latest again
@example(tellings=[(0, {"red": True}), (1, {"red": False}), (0, {"full": False})], saved=0)
@settings(max_examples=max(settings().max_examples // 5, 4))
def test_no_label_is_lost_with_what_was_not_saved(dataset, make, tmp_path_factory, tellings, saved):
    """A learner of an earlier moment, and a new one, hold what the one that ended held."""
    folder = tmp_path_factory.mktemp("logs")
    agent = make.agent("look", **make.ours)
    first = make.learner(dataset, agent, logs=folder)
    trials = [first.ask("red", make.arm(seed=n), object_name="mug") for n in range(3)]
    for number, (whose, labels) in enumerate(tellings):
        if number == saved:
            first.save(folder / "mind")
        trial = trials[whose] if isinstance(whose, int) else whose
        if labels:
            first.tell(trial, labels)
        else:  # take back what was told
            with contextlib.suppress(SettingsError):
                first.forget(trial)
    heirs = [make.learner(dataset, agent, logs=None)]
    if (folder / "mind").exists():
        heirs.append(Learner.load(folder / "mind", agent=agent, logs=None))
    for heir in heirs:
        recall(heir, folder)
        text = repr(heir)
        recall(heir, folder)  # again changes nothing
        assert repr(heir) == text
        for name in ("labels", "object_labels"):
            expected = getattr(first.experience, name).values
            np.testing.assert_array_equal(getattr(heir.experience, name).values, expected)


def test_labels_are_rebuilt_from_logs(dataset, make, tmp_path):
    agent = make.agent("look", **make.ours)
    first = make.learner(dataset, agent, logs=tmp_path)
    again = make.learner(dataset, agent)
    trials = [first.ask("red", make.arm(seed=n), object_name="mug") for n in range(3)]
    first.tell(trials[0], {"red": True, "full": True})
    first.tell(trials[1], {"red": False})
    first.forget(trials[1])
    first.tell("mug", {"full": False})
    recall(again, tmp_path)
    for key in (*(trial.task.key for trial in trials), ("told", "mug")):
        expected = first.experience.labels_of_trial(key)
        np.testing.assert_array_equal(again.experience.labels_of_trial(key), expected)
    rows = first.experience.labels.values
    np.testing.assert_array_equal(again.experience.labels.values[: len(rows)], rows)


def test_a_trial_of_another_learner_keeps_its_own_percepts(dataset, make):
    first, second = (make.learner(dataset, make.agent("look", **make.ours)) for _ in range(2))
    mine = first.ask("red", make.arm(red=True, seed=1))
    second.ask("red", make.arm(red=False, seed=2))
    second.tell(mine, {"red": True})
    (row,) = second.experience.instances_of_trial(mine.task.key)
    assert second.experience.levels.values[row, 0] == mine.steps[0].observation[0]
    features = second.experience.features["look", "color"][row]  # not of its own trial
    np.testing.assert_array_equal(features, mine.steps[0].sensed.features["color"])


def test_a_trial_that_was_known_in_part_is_recorded_to_its_end(dataset, make, tmp_path):
    """As it was under way, and whole: each step once."""
    agent = make.agent("look", "look", "lift", **make.ours)
    driver = make.learner(dataset, agent, logs=tmp_path)
    other = make.learner(dataset, agent)
    arm = make.arm()
    session = driver.begin("red", "mug", state=arm.start())
    session.observe(arm.execute(session.behavior))
    other.tell(session.trial, {"red": False})
    assert len(other.experience.executions) == 1
    while session.behavior:
        session.observe(arm.execute(session.behavior))
    assert [trial.task.key for trial in recall(other, tmp_path)] == [session.task.key]
    assert recall(other, tmp_path) == []
    other.record(session.trial)
    driver.tell(session.trial, {"red": False})
    for name in ("executions", "labels"):
        expected = getattr(driver.experience, name).values
        np.testing.assert_array_equal(getattr(other.experience, name).values, expected)


def test_a_replay_shows_recordings_that_were_given_and_adds_none(dataset, make, tmp_path):
    """What was told of a replay holds of the recordings of its object, and can be taken back."""
    table = build_percept_table(dataset)
    agent = make.agent("look", "lift", "reset", "look", **make.ours)
    replayer = Learner(dataset.domain, agent=agent, logs=tmp_path).fit(table)
    trials = [replayer.ask("red", dataset.objects[o]) for o in (0, 0, 3)]
    given = make.learner(dataset, agent)
    empty = Learner(dataset.domain, agent=agent, logs=None)
    count = len(given.experience.instances)
    replayer.tell(trials[2], {"full": False})
    for learner in (given, empty):
        recall(learner, tmp_path)
        recall(learner, tmp_path)
    assert len(given.experience.instances) == count
    executions = given.experience.executions.values
    assert (executions["instance"] >= 0).sum() == 3 * len({t.task.key for t in trials})
    assert given.experience.labels_of_trial(trials[2].task.key)[1] == 0
    assert len(empty.experience.instances) == 3 * len({t.task.key for t in trials})


WORDS = st.sampled_from([True, False, "yes", "no", None])
SAID = st.dictionaries(st.sampled_from(("red", "full")), WORDS, max_size=2)


@settings(max_examples=max(settings().max_examples // 2, 8))
@given(
    shown=st.lists(st.tuples(SAID, st.booleans()), min_size=1, max_size=5),
    asked=st.sampled_from((["red"], ["full"], ["red", "full"])),
    levels=st.sampled_from((2, 4)),
)
@example(shown=[({"red": True}, False)] * 3, asked=["red", "full"], levels=4)
@example(shown=[({"red": True}, False)] * 3, asked=["full"], levels=2)
def test_what_a_detector_said_is_recalled_and_nothing_else(
    make, tmp_path_factory, shown, asked, levels
):
    """What it did not name was shown at even odds: no percept, neither live nor from logs."""
    folder = tmp_path_factory.mktemp("logs")
    agent = make.agent("look", **{**make.ours, "levels": levels})
    live = Learner(make.kitchen, agent=agent, logs=folder, refit_every=None)
    for said, sensed in shown:
        features = {"color": [9.0, 9.0, 9.0]} if sensed else None
        robot = make.faulty(Outcome("table", features, percepts=said or None))
        live.tell(live.ask(asked, robot), {"red": True, "full": False})
    heir = Learner(make.kitchen, agent=agent, logs=None, refit_every=None)
    recall(heir, folder)
    for learner in (live, heir):
        learner.refit()
    for name in ("executions", "detected"):
        expected = getattr(live.experience, name).values
        np.testing.assert_array_equal(getattr(heir.experience, name).values, expected)
    counts = [learner.knowledge().posterior.counts for learner in (live, heir)]
    np.testing.assert_array_equal(*counts)


def test_the_experience_is_rebuilt_from_logs(dataset, make, tmp_path):
    agent = make.agent(*PLAN, **make.ours)
    first = make.learner(dataset, agent, logs=tmp_path)
    again = make.learner(dataset, agent)
    names = ["mug", "glass", None, "mug"]
    trials = [first.ask("red", make.arm(seed=n), object_name=name) for n, name in enumerate(names)]
    recalled = recall(again, tmp_path)
    assert [trial.task for trial in recalled] == [trial.task for trial in trials]
    for learner, told in ((first, trials), (again, recalled)):
        for number, trial in enumerate(told):
            learner.tell(trial, {"red": number % 2 == 0})
    before = first.experience
    after = again.experience
    for name in ("executions", "feedback", "object_labels"):
        np.testing.assert_array_equal(getattr(before, name).values, getattr(after, name).values)
    np.testing.assert_array_equal(attempts(before), attempts(after))
    np.testing.assert_array_equal(before.levels.values[:, 0], after.levels.values[:, 0])
    for context, sensed in before.features.items():
        np.testing.assert_equal(after.features[context], sensed)
    for learner in (first, again):
        alpha = learner.knowledge().posterior.concentration[0]
        np.testing.assert_array_equal(alpha, first.knowledge().posterior.concentration[0])
    assert recall(again, tmp_path) == []  # once

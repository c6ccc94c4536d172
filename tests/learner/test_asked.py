"""Keys of random streams: after a restart no question repeats those of another."""

import copy
from functools import partial

import numpy as np
import pytest

from meal_bayes import Learner, MealBayesError, Outcome
from meal_bayes.errors import LogError
from meal_bayes.learner import recall
from meal_bayes.learner.question import QuestionCounts
from meal_bayes.learner.views import attempts
from meal_bayes.trial_log import Logs


def seen():
    return Outcome("table", {"color": [9.0, 9.0, 9.0]})


def killed(session):
    """Let go of what the process of a session held when it died."""
    session._recorder._file.close()


def begin(learner, how, key=None):
    """Begin a trial of a kind, about an object of a name; perhaps by streams of one's own."""
    return learner.begin("red", "mug", state="table", learn=how == "lesson", key=key)


def streams_of(session):
    """Return what names the random streams of a session."""
    return {session.key}


KEYS = [None, "mine", 2, "test 2"]  # of which a person names all but one


@pytest.mark.quick(3)
@pytest.mark.parametrize("between", [0, 2])
@pytest.mark.parametrize("key", KEYS)
@pytest.mark.parametrize("how", ["lesson", "test"])
def test_a_question_after_a_resumed_one_repeats_no_stream(
    dataset, make, tmp_path, how, key, between
):
    first = make.learner(dataset, "greedy", logs=tmp_path / "logs")
    first.save(tmp_path / "it.mind")
    before = [begin(first, how) for _ in range(between)]  # which the file does not know
    asked = set().union(*map(streams_of, before))
    for each in before:
        each.cancel()
    session = begin(first, how, key)
    began = streams_of(session)
    killed(session)
    again = Learner.load(tmp_path / "it.mind", logs=tmp_path / "logs")
    resumed = again.resume(state="table")
    assert streams_of(resumed) == began
    for _ in range(3):
        later = begin(again, how)
        undisturbed = begin(first, how)
        assert streams_of(later) == streams_of(undisturbed)  # as if its process had not died
        assert not streams_of(later) & (began | asked)
        later.cancel()
        undisturbed.cancel()
    resumed.cancel()
    recalled = make.learner(dataset, "greedy")
    recall(recalled, tmp_path / "logs")
    assert not streams_of(begin(recalled, how)) & (began | asked)


def test_a_learner_that_was_loaded_elsewhere_is_told_where_to_look(dataset, make, tmp_path):
    first = make.learner(dataset, "greedy", logs=tmp_path / "here")
    first.save(tmp_path / "it.mind")
    session = begin(first, "lesson")
    killed(session)
    again = Learner.load(tmp_path / "it.mind", logs=tmp_path / "there")
    (tmp_path / "there" / first.domain.name).mkdir(parents=True)
    with pytest.raises(LogError, match=r"does not contain the folder of its logs: name the folder"):
        again.resume()
    again.resume(tmp_path / "here", state="table").cancel()


def test_labels_are_logged_beside_a_trial_that_was_recalled(dataset, make, tmp_path):
    first = make.learner(dataset, make.agent("look", "look"), logs=tmp_path / "here")
    session = first.begin("red", "mug")
    while session.behavior is not None:
        session.observe(seen())
    first.save(tmp_path / "it.mind")
    agent = make.agent("look", "look")
    again = Learner.load(tmp_path / "it.mind", agent=agent, logs=tmp_path / "there")
    recall(again, tmp_path / "here")
    again.tell(session.trial, {"red": True})
    assert not (tmp_path / "there").exists()
    assert [trial.truth.tolist() for trial in Logs(tmp_path / "here").trials()] == [[1]]


def test_resuming_in_the_learner_that_began_it_counts_once(dataset, make, tmp_path):
    learner = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    session = learner.begin("red")
    killed(session)
    before = copy.copy(learner._questions)
    learner.resume(state="table").cancel()
    assert learner._questions == before


def test_a_learner_that_recalls_its_logs_repeats_none_of_their_streams(dataset, make, tmp_path):
    first = make.learner(dataset, make.agent("look", "look"), logs=tmp_path)
    asked = set()
    for learn in (True, True, False):
        session = first.begin("red", learn=learn)
        asked |= streams_of(session)
        while session.behavior is not None:
            session.observe(seen())
    again = make.learner(dataset, make.agent("look", "look"), logs=None)
    recall(again, tmp_path)
    for learn in (True, False):
        assert not streams_of(again.begin("red", learn=learn)) & asked


@pytest.mark.parametrize("name", ["mug", None])
@pytest.mark.parametrize("learn", [True, False])
def test_a_task_that_is_asked_twice_is_two_trials(dataset, make, tmp_path, name, learn):
    learner = make.learner(dataset, make.agent("look"), logs=tmp_path)
    task = learner.task("red", name)
    trials = [learner.ask(task, make.arm(seed=seed), learn=learn) for seed in range(3)]
    assert trials[0].task.key == task.key
    assert len({trial.task.key for trial in trials}) == 3
    if learn:
        learner.tell(trials[1], {"red": True})
        shown = [learner.experience.instances_of_trial(trial.task.key) for trial in trials]
        red = [learner.experience.labels.values[rows, 0].tolist() for rows in shown]
        assert red == [[-1], [1], [-1]]
    assert len([*Logs(tmp_path).trials()]) == 3
    recalled = make.learner(dataset, make.agent("look"), logs=None)
    keys = [trial.task.key for trial in recall(recalled, tmp_path)]
    assert keys == [trial.task.key for trial in trials if learn]


@pytest.mark.parametrize(
    ("streams", "lessons", "tests"),
    [
        (("d", "live", 4, "cup", "red"), 5, 0),
        (("d", "live", "test 4", "cup", "red"), 0, 5),
        (("d", "live", "mine 4", "cup", "red"), 0, 0),
        (("d", "ask", "4", "red"), 0, 0),
        ((), 0, 0),
    ],
)
def test_only_keys_that_were_counted_count(streams, lessons, tests):
    questions = QuestionCounts()
    questions.count_resumed({"streams": list(streams)})
    assert (questions.lessons, questions.tests) == (lessons, tests)


REFUSED = [
    {"truth": {"red": 5}},
    {"truth": {"blue": True}},
    {"truth": [1, 0]},
    {"log": "there.mcap"},
]


@pytest.mark.parametrize("options", REFUSED, ids=str)
@pytest.mark.parametrize("how", ["ask", "begin"])
def test_a_trial_that_is_refused_was_none(dataset, make, tmp_path, how, options):
    agent = make.agent("look")
    learner = make.learner(dataset, agent, logs=tmp_path / "logs")
    if "log" in options:
        options = {"log": tmp_path / options["log"]}
        options["log"].touch()
    key = learner._questions.next_key(learn=True)
    call = partial(learner.ask, robot=make.arm()) if how == "ask" else learner.begin
    with pytest.raises(MealBayesError):
        call("red", **options)
    if "truth" in options:
        assert learner._questions.next_key(learn=True) == key
    learner.ask("red", make.arm(), object_name="mug")
    learner.tell("mug", {"red": True})
    heir = make.learner(dataset, agent)
    recall(heir, tmp_path / "logs")
    assert learner.experience.trials == heir.experience.trials
    assert not learner._under_way
    np.testing.assert_array_equal(attempts(learner.experience), attempts(heir.experience))

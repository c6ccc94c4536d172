"""The record: what was executed, and what was said, in any order; what nobody should say."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.arrays import Rows
from meal_bayes.datasets import Instance, make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.experiments.online import Recordings
from meal_bayes.learner import Experience, Learner, implied
from meal_bayes.learner.experience import key_of_name
from meal_bayes.learner.views import attempts, labeled, labels_for, labels_of, sizes, training
from meal_bayes.robots import Outcome

TOY = load_domain("toy")
OBJECTS = 4
RECORDINGS = 3
DATASET = make_synthetic(
    TOY, objects=OBJECTS, recordings=RECORDINGS, dimensions=2, rng=np.random.default_rng(0)
)
NAMES = TOY.behavior_names


def execute(experience, trial, o, e, r):
    """Record an execution that shows recording r, or fails."""
    instance = None if r is None else DATASET.instance(o, NAMES[e], r)
    levels = None if r is None else np.array([o % 2, r % 2], np.int8)
    experience.add_execution(
        (trial,), DATASET.objects[o], e, success=int(r is not None), instance=instance,
        levels=levels,
    )  # fmt: skip


LABELS = st.tuples(st.integers(-1, 1), st.integers(-1, 1))
EXECUTIONS = st.lists(
    st.tuples(st.integers(0, 1), st.none() | st.integers(0, RECORDINGS - 1)), max_size=5
)
TRIALS = st.lists(st.tuples(st.integers(0, OBJECTS - 1), EXECUTIONS, LABELS), max_size=8)


@given(trials=TRIALS, memory=st.booleans(), forgotten=st.sets(st.integers(0, 7)))
def test_d_holds_what_was_shown_with_its_labels(trials, memory, forgotten):
    """A ledger of instances and labels, by hand, says the same."""
    experience = Experience(TOY)
    shown = {}
    told = {}
    for t, (o, executions, labels) in enumerate(trials):
        for e, r in executions:
            execute(experience, t, o, e, r)
            if r is not None:
                shown.setdefault((o, e, r), []).append(t)
        experience.add_labels((t,), DATASET.objects[o], np.array(labels, np.int8))
        told[t] = {p: value for p, value in enumerate(labels) if value >= 0}
    for t in sorted(forgotten & {t for t, labels in told.items() if labels}):
        experience.forget((t,))
        told[t] = {}
    known = {}
    for t, (o, _, _) in enumerate(trials):
        known.setdefault(o, {}).update(told[t])
    labels = labels_of(experience, memory=memory)
    dataset, rows, d = training(experience, labels, sizes(experience))
    places = experience.instances.values[["object", "behavior", "recording"]][rows]
    names = {number: name for name, number in experience.objects.items()}
    held = {}
    for (o, e, r), labels in zip(places.tolist(), d.labels.tolist(), strict=True):
        at = DATASET.objects.index(names[o]), e, r
        held[at] = {p: value for p, value in enumerate(labels) if value >= 0}
    expected = {}
    for place, in_trials in shown.items():
        expected[place] = {}
        for t in in_trials:
            expected[place].update(known[place[0]] if memory else told[t])
    assert held == expected
    for name, o in experience.objects.items():
        labels = experience.object_labels.values[o]
        of_object = {p: v for p, v in enumerate(labels.tolist()) if v >= 0}
        assert of_object == known.get(DATASET.objects.index(name), {})
    counts = labeled(experience, memory=memory)
    assert counts.sum() == sum(len(labels) for labels in expected.values())
    for (behavior, modality), values in dataset.features.items():
        for place in expected:
            if NAMES[place[1]] == behavior:
                o = dataset.objects.index(DATASET.objects[place[0]])
                assert DATASET.features[behavior, modality][place[0], place[2]] in values[o]


def test_what_was_given_is_given_once():
    experience = Experience(TOY)
    for _ in range(2):
        experience.add_dataset(DATASET)
    dataset, _, d = training(experience, labels_of(experience, memory=False), sizes(experience))
    for context, values in DATASET.features.items():
        np.testing.assert_array_equal(np.sort(dataset.features[context], 1), np.sort(values, 1))
    np.testing.assert_array_equal(d.labels, DATASET.labels[d.object])
    assert labeled(experience, memory=False, given=False).sum() == 0


def test_instances_of_a_robot_are_each_new():
    experience = Experience(TOY)
    for number in range(3):
        instance = Instance(-1, "look", 0, DATASET.instance(0, "look", number).features)
        levels = np.array([0, 1], np.int8)
        experience.add_execution(("t",), "cup", 0, success=1, instance=instance, levels=levels)
    assert experience.instances.values["recording"].tolist() == [-1] * 3
    assert len(experience.executions) == 3


def test_attempts_count_what_is_known_to_have_failed_or_succeeded():
    experience = Experience(TOY)
    for success in (1, 0, -1, 1):
        experience.add_execution(("t",), "cup", 1, success=success)
    assert attempts(experience).tolist() == [[0, 0], [1, 2], [0, 0]]


class TestRecordings:
    def test_they_come_once_each_and_then_again(self):
        recordings = Recordings(DATASET, np.random.default_rng(3))
        first = [recordings.supply(o)[0] for o in range(OBJECTS)]
        assert all(sorted(order) == list(range(RECORDINGS)) for order in first)
        assert len({tuple(order) for order in first}) > 1

    def test_ones_that_are_not_there_are_never_handed_out(self):
        features = {context: values.copy() for context, values in DATASET.features.items()}
        for (behavior, _), values in features.items():
            values[(0, slice(1, None)) if behavior == "look" else 1] = np.nan
        ragged = type(DATASET)(TOY, DATASET.objects, features, DATASET.labels)
        recordings = Recordings(ragged, np.random.default_rng(3))
        for o in range(OBJECTS):
            for e, count in enumerate(ragged.recording_counts[o, :2]):
                assert sorted(recordings.supply(o)[e]) == list(range(count))


@pytest.mark.parametrize(
    ("report", "truth", "told"),
    [
        ([1], [1], [1]),
        ([1], [0], [0]),
        ([0], [1], [1]),
        ([0], [0], [0]),
        ([1, 0], [1, 0], [1, 0]),
        ([1, 0], [1, 1], [-1, -1]),
        ([0, 1], [1, 0], [-1, -1]),
    ],
)
def test_a_verdict_teaches_what_it_implies(report, truth, told):
    assert implied(np.array(report, bool), right=report == truth).tolist() == told


def test_another_value_of_a_group_replaces_the_earlier_one():
    learner = Learner("roc36", agent="greedy", logs=None)
    learner.tell("jar", {"content": "rice"})
    learner.tell("jar", {"beans": True})
    known = dict(
        zip(learner.domain.attributes, labels_for(learner.experience, ["jar"])[0], strict=True)
    )
    assert (known["rice"], known["beans"]) == (0, 1)


def test_no_label_leaves_a_group_without_a_value_or_with_two():
    learner = Learner("roc36", agent="greedy", logs=None)
    values = learner.domain.groups["content"]
    for name in values[:-1]:
        learner.tell("jar", {name: False})
    last = learner.domain.attribute_index(values[-2])
    assert learner.experience.labels_of_trial(key_of_name("jar"))[last] == 0
    with pytest.raises(QueryError, match="'jar' would be none of 'content'"):
        learner.tell("jar", {values[-1]: False})
    experience = learner.experience
    for number, name in enumerate(values[:3]):
        experience.add_labels((number,), "can", learner.domain.labels({name: True}))
    experience.forget((1,))  # by which the first value was not true
    columns = list(learner.domain.columns(values[:3]))
    assert labels_for(experience, ["can"])[0, columns].tolist() == [0, 0, 1]
    learner.refit()


class Arm:
    def start(self):
        return "x0"

    def execute(self, behavior):
        return Outcome("x0")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda learner: learner.ask("red", Arm), "A robot is an object with start"),
        (lambda learner: learner.begin("red", key=1.5), r"key is 1\.5; give text"),
        (lambda learner: learner.begin("red", object_name=3), "must be text; found 3"),
        (lambda learner: learner.begin(3), "A question is a sentence or names; found 3"),
        (lambda learner: learner.tell(3, {"red": True}), "must be text; found 3"),
        (lambda learner: learner.tell("cup", {"red": [1, 0]}), "^red: "),
        (lambda learner: Learner("toy", reward=1e100), "reward is 1e\\+100; give a finite number"),
    ],
)
def test_values_of_other_types_are_one_line(call, message):
    with pytest.raises((SettingsError, QueryError), match=message):
        call(Learner("toy", logs=None))


TABLES = ("instances", "levels", "detected", "scores", "labels")


@pytest.mark.parametrize("after", [False, True])
@pytest.mark.parametrize("number", range(8))
def test_an_interruption_leaves_no_part_of_a_row(
    number, after, dataset, make, tmp_path, monkeypatch
):
    """Ctrl-C may come before or after any of the tables gets its row."""
    learner = make.learner(dataset, "greedy")
    calls = iter(range(1000))
    extend = Rows.extend

    def interrupted(rows, more):
        now = next(calls) == number
        if now and not after:
            raise KeyboardInterrupt
        extend(rows, more)
        if now:
            raise KeyboardInterrupt

    arm = make.arm()

    def ask_again():
        for _ in range(3):
            learner.ask("red, full", arm, object_name="a new cup")

    monkeypatch.setattr(Rows, "extend", interrupted)
    with pytest.raises(KeyboardInterrupt):
        ask_again()
    monkeypatch.undo()
    record = learner.experience
    assert {len(getattr(record, name)) for name in TABLES} == {len(record.instances)}
    assert len(record.object_labels) == len(record.objects)
    assert all(max(rows, default=0) < len(record.instances) for rows in record.features.values())
    learner.tell(learner.ask("red", make.arm()), {"red": False})
    learner.save(tmp_path / "mind")
    assert repr(Learner.load(tmp_path / "mind", logs=None).experience) == repr(record)


@pytest.mark.parametrize("said", [{"red": False}, {"red": True}, {"full": False}, None])
def test_recordings_that_are_given_again_revert_no_correction(dataset, make, said):
    """Only a label that the data set did not give before is new."""
    learner = make.learner(dataset, "greedy")
    name = dataset.objects[3]  # red and full
    if said is None:
        learner.forget(name)
    else:
        learner.tell(name, said)
    corrected = learner.experience.object_labels.values.copy()
    rows = len(learner.experience.feedback)
    learner.fit(dataset)
    np.testing.assert_array_equal(learner.experience.object_labels.values, corrected)
    assert len(learner.experience.feedback) == rows
    labels = dataset.labels.copy()
    labels[3, 1] = labels[4, 0] = 1 - labels[3, 1]
    learner.fit(replace(dataset, labels=labels))
    corrected[[3, 4], [1, 0]] = labels[[3, 4], [1, 0]]
    np.testing.assert_array_equal(learner.experience.object_labels.values, corrected)

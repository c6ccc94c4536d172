"""What a person told of a trial when it was over: written beside it, read with it."""

import dataclasses
import math
import multiprocessing
import os
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.errors import LogError, SettingsError
from meal_bayes.trial_log import (
    Feedback,
    Follower,
    Logs,
    TrialWriter,
    check_log,
    log_files,
    log_info,
    read_feedback,
    read_trials,
    write_feedback,
    write_trials,
)
from meal_bayes.trials import Trial, TrialOutcomes

NAMES = st.text(st.characters(exclude_categories=("C", "Z")), min_size=1, max_size=12)
KEYS = st.none() | st.lists(NAMES | st.integers(-(2**40), 2**40), min_size=1).map(tuple)
LABELS = st.dictionaries(NAMES, st.sampled_from([-1, 0, 1]), min_size=1, max_size=5)
FEEDBACK = st.builds(Feedback, NAMES, LABELS, KEYS)


@pytest.fixture
def answered(make) -> Trial:
    """A trial that was answered, and of whose truth nothing is known."""
    trials = make.trials(20, 5, steps=3, edges=1)
    trial = next(trial for trial in trials if trial.report is not None and not trial.ended)
    return trial.with_truth(np.full(len(trial.truth), -1, np.int8))


def labels_of(trial: Trial, values) -> dict[str, int]:
    return dict(zip(trial.task.query.attributes, map(int, values), strict=True))


@settings(max_examples=15)
@given(entries=st.lists(FEEDBACK, max_size=4))
def test_what_is_read_is_what_was_told_in_that_order(entries, tmp_path_factory):
    folder = tmp_path_factory.mktemp("told")
    paths = [write_feedback(folder, entry, header={"data": "kitchen"}) for entry in entries]
    assert read_feedback(folder) == entries
    assert [read_feedback(path) for path in paths] == [[entry] for entry in entries]
    assert all(check_log(path).whole for path in paths)


@given(entry=FEEDBACK, place=st.floats(0, 1, exclude_max=True), bit=st.none() | st.integers(0, 7))
def test_a_damaged_log_is_refused_or_says_the_same(entry, place, bit, tmp_path_factory):
    path = write_feedback(tmp_path_factory.mktemp("told"), entry, header={})
    data = bytearray(path.read_bytes())
    at = int(place * len(data))
    if bit is None:
        del data[at:]
    else:
        data[at] ^= 1 << bit
    path.write_bytes(data)
    if check_log(path).problems:
        with pytest.raises(LogError, match=re.escape(str(path))):
            read_feedback(path)
    else:
        assert read_feedback(path) == [entry]


@settings(max_examples=20)
@given(
    tellings=st.lists(
        st.tuples(st.booleans(), st.integers(0, 1), st.sampled_from([-1, 0, 1])), max_size=8
    )
)
def test_a_later_label_replaces_an_earlier_one(tellings, make, tmp_path_factory):
    """By hand: what was last told of the trial or of its object, but for what was taken back."""
    trial = make.trials(1, 5, steps=1, edges=0)[0]
    trial = trial.with_truth(np.full(len(trial.truth), -1, np.int8))
    names = trial.task.query.attributes
    folder = tmp_path_factory.mktemp("told")
    write_trials(folder / "a.mcap", [trial], header={})
    holds: dict[tuple[str, bool], tuple[int, int]] = {}
    for number, (by_name, place, label) in enumerate(tellings):
        name = names[place % len(names)]
        holds.pop((name, by_name), None)
        if label >= 0:
            holds[name, by_name] = (number, label)
        key = None if by_name else trial.task.key
        write_feedback(folder, Feedback(trial.task.object_name, {name: label}, key), header={})
    (group,) = Logs(folder).groups()
    for name, value in labels_of(trial, group.trials[0].truth).items():
        entries = [holds[name, by_name] for by_name in (False, True) if (name, by_name) in holds]
        assert value == (max(entries)[1] if entries else -1)


def test_a_trial_is_judged_and_rewarded_by_what_was_told(answered, tmp_path):
    write_trials(tmp_path / "a.mcap", [answered], header={})
    before = (tmp_path / "a.mcap").read_bytes()
    assert answered.success is None
    assert math.isnan(answered.reward)
    for right in (True, False):
        values = answered.report if right else ~answered.report
        told = Feedback(answered.task.object_name, labels_of(answered, values), answered.task.key)
        write_feedback(tmp_path, told, header={})
        (group,) = Logs(tmp_path).groups()
        assert group.trials[0].success is right
        worth = answered.momdp.correct if right else answered.momdp.incorrect
        assert group.outcomes.reward[0] == pytest.approx(worth - answered.cost)
        assert group.outcomes.success[0] == right
    # The trial's own log says what it said, and is as it was.
    assert (tmp_path / "a.mcap").read_bytes() == before
    (trial,) = read_trials(tmp_path)
    assert trial.success is None


def test_what_is_told_of_one_trial_is_of_no_other(answered, tmp_path):
    other = dataclasses.replace(answered, task=dataclasses.replace(answered.task, key=("other",)))
    write_trials(tmp_path / "a.mcap", [answered, other], header={})
    labels = labels_of(answered, answered.report)
    write_feedback(
        tmp_path, Feedback(answered.task.object_name, labels, answered.task.key), header={}
    )
    (group,) = Logs(tmp_path).groups()
    assert [trial.success for trial in group.trials] == [True, None]
    write_feedback(tmp_path, Feedback(answered.task.object_name, labels), header={})  # of both
    (group,) = Logs(tmp_path).groups()
    assert [trial.success for trial in group.trials] == [True, True]


def test_logs_of_feedback_are_no_trials(answered, tmp_path):
    write_trials(tmp_path / "a.mcap", [answered], header={})
    told = write_feedback(tmp_path, Feedback("mug", {"heavy": 1, "beans": -1}), header={})
    assert log_files(tmp_path) == [tmp_path / "a.mcap"]
    assert len(list(Follower(tmp_path).poll())) == 1
    assert log_info(told).form == "feedback"
    with pytest.raises(LogError, match="contains labels of trials; name one of"):
        list(Logs(told).groups())
    for name, form in (("b.feedback.mcap", "full"), ("b.mcap", "feedback")):
        with pytest.raises(SettingsError, match=r"\.feedback\.mcap are for logs of feedback"):
            TrialWriter(tmp_path / name, {}, form)


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        (lambda: Feedback("", {"heavy": 1}), "name"),
        (lambda: Feedback("mug", {}), "0 labels"),
        (lambda: Feedback("mug", {"heavy": 2}), "expected 1, 0 or -1"),
        (lambda: Feedback("mug", {"heavy": -1}, recordings=True), "for a trial"),
        (lambda: Feedback("mug", {"heavy": 1}, ("a",), recordings=True), "with its labels"),
    ],
)
def test_what_nobody_can_tell_is_refused(entry, message):
    with pytest.raises(LogError, match=message):
        entry()


def test_a_damaged_one_is_named_and_the_others_are_read(answered, tmp_path):
    write_trials(tmp_path / "a.mcap", [answered], header={})
    labels = labels_of(answered, answered.report)
    paths = [
        write_feedback(tmp_path, Feedback(answered.task.object_name, labels), header={})
        for _ in range(2)
    ]
    paths[0].write_bytes(paths[0].read_bytes()[:-40])
    logs = Logs(tmp_path)
    (group,) = logs.groups()
    assert group.trials[0].success
    assert [str(paths[0]) in problem for problem in logs.problems] == [True]


def test_two_processes_tell_at_once_and_one_is_killed(tmp_path):
    """Forked, as a start of Python would take seconds; the last label of one is cut off."""

    def tell(name: str, killed: bool) -> None:
        for number in range(10):
            if killed and number == 9:
                TrialWriter._put = lambda *_, **__: os._exit(9)
            write_feedback(tmp_path, Feedback(name, {"heavy": number % 2}), header={})

    context = multiprocessing.get_context("fork")
    processes = [context.Process(target=tell, args=each) for each in (("a", False), ("b", True))]
    for process in processes:
        process.start()
    for process in processes:
        process.join()
    assert [process.exitcode for process in processes] == [0, 9]
    entries = read_feedback(tmp_path)
    for name, count in (("a", 10), ("b", 9)):
        labels = [entry.labels["heavy"] for entry in entries if entry.object_name == name]
        assert labels == [number % 2 for number in range(count)]
    assert len(list(tmp_path.rglob("*.active"))) == 1


def test_outcomes_of_a_compact_log_stay_as_they_are(answered, tmp_path):
    write_trials(tmp_path / "a.mcap", [TrialOutcomes.of([answered])], header={})
    labels = labels_of(answered, answered.report)
    write_feedback(tmp_path, Feedback(answered.task.object_name, labels), header={})
    (group,) = Logs(tmp_path).groups()
    assert not group.outcomes.judged[0]

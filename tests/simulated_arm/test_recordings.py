"""Through the public `Learner`: recorded once, asked about new objects, learning live."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.errors import RobotError
from meal_bayes.learner import Learner
from meal_bayes.seeds import stream
from meal_bayes.trial_log import read_trials

ATTRIBUTES = ("heavy", "tall", "soft", "red", "rattles")


@pytest.fixture(scope="module")
def training(sim, tmp_path_factory):
    return sim.training_recordings(16, 1, cache=tmp_path_factory.getbasetemp() / "arm")


def accuracy(sim, data, truths=None):
    """Ask one attribute of each of 30 new objects."""
    learner = Learner(sim.arm.DOMAIN, agent="greedy", logs=None).fit(data)
    right = []
    for number in range(30):
        attribute = ATTRIBUTES[number % len(ATTRIBUTES)]
        trial = sim.ask_new(learner, attribute, 5, number)
        truth = trial.truth[0] if truths is None else truths[number]
        right.append(trial.report[0] == truth)
    return np.mean(right)


@pytest.mark.long
def test_recordings_are_made_once_and_kept(sim, training, monkeypatch, tmp_path_factory):
    assert len(training.objects) == 16
    monkeypatch.setattr("simulated_arm.recordings.record_object", None)  # it is not called again
    again = sim.training_recordings(16, 1, cache=tmp_path_factory.getbasetemp() / "arm")
    for context, values in training.features.items():
        np.testing.assert_array_equal(again.features[context], values)


@pytest.mark.long
@pytest.mark.filterwarnings("ignore:.*yielded nothing:UserWarning")  # a slip of the hand
def test_random_labels_bring_accuracy_to_the_base_rate(sim, training):
    data = training
    rng = stream(0, "labels by a coin")
    labels = rng.integers(0, 2, data.labels.shape).astype(np.int8)
    for group in data.domain.groups.values():  # of which exactly one stays true
        columns = data.domain.columns(group)
        labels[:, columns] = rng.permutation(data.labels[:, columns])
    truths = rng.integers(0, 2, 30)
    by_chance = accuracy(sim, replace(data, labels=labels), truths)
    assert abs(by_chance - 0.5) < 2 * np.sqrt(0.25 / 30)
    assert accuracy(sim, data) > 0.5 + 2 * np.sqrt(0.25 / 30)


@pytest.mark.long
def test_a_fault_of_the_body_is_logged_and_life_goes_on(sim, tmp_path, monkeypatch):
    execute = sim.SimulatedArm.execute

    def failing(arm, behavior):
        if "00002" in {path.stem for path in tmp_path.glob("*.active")} | {
            path.name[:5] for path in tmp_path.glob("00002*")
        } and not list(tmp_path.glob("00003*")):
            raise RobotError("the object fell off the table")
        return execute(arm, behavior)

    monkeypatch.setattr(sim.SimulatedArm, "execute", failing)
    learner = Learner(sim.arm.DOMAIN, agent="random_legal", seed=3, logs=None)
    done = list(sim.learn_live(learner, 3, 3, logs=tmp_path))
    fault = "robot error: RobotError: the object fell off the table"
    assert [trial.ended for trial in done] == ["", fault, ""]
    (broken,) = read_trials(tmp_path / "00002.mcap")
    assert broken.ended == fault
    assert broken.report is None

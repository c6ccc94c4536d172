"""What live trials teach: labels before and after them, odd readings, new sensors, forgetting."""

import dataclasses
import math
import warnings

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.datasets import Dataset, checked_features
from meal_bayes.domain import domain_from_table
from meal_bayes.errors import DataError, RobotError, SettingsError
from meal_bayes.learner import Learner
from meal_bayes.learner.views import labels_for
from meal_bayes.robots import Outcome


def test_labels_reach_what_a_trial_shows_before_and_after_them(dataset, make):
    learner = make.learner(dataset, make.agent("look", "look", **make.ours))
    arm = make.arm(red=True)
    session = learner.begin("red", object_name="mug")
    session.observe(Outcome(arm.start(), arm.execute("look").features))
    learner.tell(session.trial, {"red": True})
    session.observe(arm.execute("look"))
    rows = learner.experience.instances_of_trial(session.task.key)
    assert learner.experience.labels.values[rows, 0].tolist() == [1, 1]
    learner.tell("mug", {"full": True})  # by its name: all that it has shown
    assert learner.experience.labels.values[rows, 1].tolist() == [1, 1]


def test_labels_by_name_teach_as_those_of_trials_do(dataset, make):
    beliefs = []
    for by_name in (False, True):
        learner = Learner(dataset.domain, agent=make.agent("look", **make.ours), logs=None)
        for number in range(12):
            name = f"cup {number}"
            red = number % 2 == 0
            trial = learner.ask("red", make.arm(red=red, seed=number), object_name=name)
            learner.tell(name if by_name else trial, {"red": red})
        test = learner.ask("red", make.arm(red=True, seed=99), learn=False)
        beliefs.append(test.last_belief.positive)
    np.testing.assert_array_equal(*beliefs)
    assert beliefs[0][0] > 0.6


def test_to_forget_a_word_restores_the_label_of_the_data(dataset, make):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    before = labels_for(learner.experience, ["cup 1"]).tolist()
    trial = learner.ask("red", make.arm(), object_name="cup 1")
    learner.tell(trial, {"red": False})
    assert labels_for(learner.experience, ["cup 1"]).tolist() != before
    assert repr(learner.experience).endswith(" 25 labels, 1 of them contradicted")
    learner.tell(trial, {"red": False})
    assert repr(learner.experience).endswith(" 25 labels, 1 of them contradicted")
    learner.forget(trial)
    assert labels_for(learner.experience, ["cup 1"]).tolist() == before


ODD = [[], [9.0] * 7, [math.nan] * 3, "red", [[1.0], [2.0, 3.0]], None, {"a": 1}, [9.0] * 2]
JUNK = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=3) | st.binary(),
    lambda parts: st.lists(parts, max_size=4) | st.dictionaries(st.text(max_size=3), parts),
    max_leaves=6,
)
# A sensor's numbers, whole outcomes, and what is none.
READINGS = st.one_of(
    st.builds(lambda value: Outcome("table", {"color": value}), st.sampled_from(ODD) | JUNK),
    st.builds(Outcome, st.just("table") | JUNK, JUNK, answers=JUNK, percepts=JUNK),
    JUNK,
)


def is_color(outcome):
    """Return whether an outcome is a right one after all: three numbers."""
    try:
        values = checked_features(outcome.features["color"])
    except (AttributeError, KeyError, TypeError, DataError):
        return False
    return outcome.percepts is not None or values.shape == (3,)


@given(
    outcome=READINGS.filter(lambda outcome: not is_color(outcome)),
    moment=st.integers(0, 5),
    seed=st.integers(0, 99),
)
@settings(max_examples=settings().max_examples * 2 // 5)  # 1,000: --hypothesis-profile=bars
def test_one_odd_reading_costs_one_reading(make, outcome, moment, seed):
    domain = domain_from_table(make.kitchen)
    learner = Learner(domain, agent=make.agent("look", **make.ours), logs=None)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        for number in range(6):
            arm = make.arm(red=number % 2 == 0, seed=seed + number)
            robot = make.faulty(outcome) if number == moment else arm
            try:
                trial = learner.ask("red", robot, object_name=f"mug {number}")
            except RobotError:
                assert number == moment
            else:
                learner.tell(trial, {"red": number % 2 == 0})
        learner.refit()
    perception = learner.fitted(learner.agent).perception
    assert len(perception.classifiers["look"].spaces["color"].rows) == 5
    assert learner.knowledge().posterior.counts[0, 0].sum() == 5


def test_a_new_sensor_wins_by_its_number_and_odd_recordings_are_named_once(dataset, make):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    wide = {
        context: np.concatenate([values, values], axis=-1)
        for context, values in dataset.features.items()
    }
    one = {context: np.array(values) for context, values in wide.items()}
    for values in one.values():
        values[1:] = values[:, 1:] = np.nan
    odd = Dataset(dataset.domain, dataset.objects, one, dataset.labels, partial=True)
    before = learner.knowledge().posterior.counts
    with pytest.warns(UserWarning, match="look color of .cup 0. has 6 features, most have 3"):
        learner.fit(odd)
    np.testing.assert_array_equal(learner.knowledge().posterior.counts, before)
    learner.refit()  # says nothing any more
    with pytest.warns(UserWarning, match="has 3 features, most have 6"):
        learner.fit(dataclasses.replace(dataset, features=wide))
    assert learner.fitted(learner.agent).expected_sizes["look", "color"] == 6
    assert "36" not in repr(learner)


def test_the_recordings_of_a_trial_can_be_forgotten(dataset, make):
    learner = make.learner(dataset, make.agent("look", **make.ours))
    fresh = learner.knowledge().posterior.counts
    trial = learner.ask("red", make.arm(), object_name="mug")
    learner.tell(trial, {"red": True})
    learner.refit()
    assert learner.knowledge().posterior.counts.sum() == fresh.sum() + 1
    learner.forget(trial, recordings=True)
    np.testing.assert_array_equal(learner.knowledge().posterior.counts, fresh)
    assert repr(learner.experience).startswith("72 recordings of 12 objects, 24 labels")
    with pytest.raises(SettingsError, match="has no labels or recordings"):
        learner.forget(trial, recordings=True)


def test_trials_of_other_behaviors_are_refused(dataset, make):
    trial = make.learner(dataset, make.agent("look", **make.ours)).ask("red", make.arm())
    table = make.kitchen | {"behaviors": make.kitchen["behaviors"][::-1]}
    other = Learner(domain_from_table(table), agent=make.agent("look", **make.ours), logs=None)
    with pytest.raises(SettingsError, match="has the behaviors look, lift, reset"):
        other.tell(trial, {"red": True})
    assert len(other.experience.executions) == 0


def test_a_sensor_of_two_values_is_no_dead_one_while_it_has_shown_one(make):
    """Warnings are errors here; of eight equal recordings there is one."""
    learner = Learner(domain_from_table(make.kitchen), agent=make.agent("look"), logs=None)
    for number in range(7):
        trial = learner.ask("red", make.faulty(Outcome("table", {"color": np.ones(3)})))
        learner.tell(trial, {"red": number % 2 == 0})
    learner.refit()
    learner.tell(
        learner.ask("red", make.faulty(Outcome("table", {"color": np.ones(3)}))), {"red": True}
    )
    with pytest.warns(UserWarning, match="None of the features of"):
        learner.refit()

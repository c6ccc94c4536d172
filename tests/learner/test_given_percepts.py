"""A detector that the robot brings is believed from the first object on, as far as it is right."""

from pathlib import Path

import numpy as np
import pytest

from meal_bayes import Learner, Outcome

pytestmark = pytest.mark.filterwarnings("ignore:'lift' yielded nothing several times")
KITCHEN = Path(__file__).parents[2] / "examples" / "kitchen.toml"


class Detecting:
    """A robot whose camera says whether a cup is red, and is always right."""

    def __init__(self, red):
        self.red = red
        self.looks = 0

    def start(self):
        return "table"

    def execute(self, behavior):
        self.looks += behavior == "look"
        percepts = {"red": self.red} if behavior == "look" else None
        return Outcome("held" if behavior == "lift" else "table", percepts=percepts)


def met(learner, *, red, **options):
    """Ask of a cup and tell what it was; return how often it was looked at, and the trial."""
    robot = Detecting(red)
    trial = learner.ask("Is it red?", robot, **options)
    learner.tell(trial, {"red": red})
    return robot.looks, trial


def test_a_detector_that_was_right_twelve_times_is_looked_at_on_the_thirteenth_cup():
    """Of twelve cups none was red, so that no label says what it shows of red ones."""
    learner = Learner(KITCHEN, reward=300, logs=None)
    assert all(met(learner, red=False)[0] for _ in range(12))
    looks, trial = met(learner, red=True)
    assert looks > 0
    assert trial.last_belief.positive[0] > 0.2  # six times the base rate
    # One red cup was told: the next is found to be red in a test, too, which learns nothing.
    looks, trial = met(learner, red=True, learn=False)
    assert looks > 0
    assert trial.answer == {"red": True}


def test_a_detector_is_not_asked_again_and_again_about_one_object():
    """What it says twice of one object is hardly more than what it said once."""
    learner = Learner(KITCHEN, reward=300, logs=None)
    for _ in range(12):
        met(learner, red=False)
    assert 0 < met(learner, red=True)[0] <= 15


def test_what_a_detector_says_counts_before_the_first_label():
    learner = Learner(KITCHEN, reward=100, logs=None)
    learner.ask("Is it red?", Detecting(red=False))
    known = learner.knowledge().posterior
    look = learner.domain.behavior_index("look")
    assert known.given.tolist() == [[True, False, False], [False, False, False]]
    assert known.informative[0, look]
    assert not known.counts.any()
    np.testing.assert_array_equal(known.informative, known.given)


def test_what_was_heard_is_known_after_a_restart(tmp_path):
    learner = Learner(KITCHEN, reward=100, logs=None)
    for red in (False, True, False):
        met(learner, red=red)
    learner.save(tmp_path / "mind")
    again = Learner.load(tmp_path / "mind", logs=None).knowledge().posterior
    known = learner.knowledge().posterior
    np.testing.assert_array_equal(again.given_prior, known.given_prior)
    np.testing.assert_array_equal(again.concentration, known.concentration)


def test_labels_of_two_red_cups_and_two_others_decide_about_the_detector():
    learner = Learner(KITCHEN, reward=300, logs=None, horizon=1000)
    look = learner.domain.behavior_index("look")
    for number, red in enumerate((True, True, False, False)):
        looks, _ = met(learner, red=red)
        assert looks > 0
        learner.refit()
        posterior = learner.knowledge().posterior
        assert posterior.given[0, look] == (number < 3)
    rows = posterior.mean[0, look]
    assert rows[1, -1] > rows[0, -1]
    assert posterior.telling[0, look] < 1  # it may still have guessed

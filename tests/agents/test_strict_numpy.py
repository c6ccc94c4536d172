"""A user's `np.seterr(all="raise")`: all is learned and decided as without it."""

import numpy as np
import pytest

from meal_bayes import Learner, build_percept_table, load_percepts
from meal_bayes.datasets import make_synthetic

QUESTIONS = [("red", "values"), ("red, heavy", "values"), ("red and not heavy", "yes or no")]


@pytest.mark.quick(2)
@pytest.mark.parametrize("agent", ["bayes", "morc", "olfc", "greedy", "morc_itrs"])
def test_trials_are_as_they_are_without(agent):
    table = load_percepts("roc36")

    def asked():
        learner = Learner("roc36", agent=agent, logs=None, seed=1).fit(table)
        return [learner.ask(q, "heavy_blue_beans", answer=answer) for q, answer in QUESTIONS]

    expected = asked()
    with np.errstate(all="raise"):
        trials = asked()
    for trial, other in zip(trials, expected, strict=True):
        assert trial.steps == other.steps


def test_recordings_are_learned_as_they_are_without():
    dataset = make_synthetic("toy", objects=12, recordings=3, rng=np.random.default_rng(0))
    expected = build_percept_table(dataset)
    with np.errstate(all="raise"):
        table = build_percept_table(dataset)
        learner = Learner("toy", logs=None).fit(dataset)
        knowledge = learner.knowledge()
    assert table.digest() == expected.digest()
    assert knowledge == Learner("toy", logs=None).fit(dataset).knowledge()

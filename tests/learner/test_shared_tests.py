"""Tests that share what equal questions have in common are the trials that `ask` runs alone."""

import numpy as np
import pytest

from meal_bayes.datasets import Dataset, make_synthetic
from meal_bayes.domain import Query, load_domain
from meal_bayes.learner import Learner, shared_tests
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.trials import Task

OBJECTS = 10


@pytest.fixture(scope="module")
def dataset():
    """Recordings, of which an object lacks the last of each behavior."""
    rng = np.random.default_rng(2)
    made = make_synthetic(load_domain("toy"), objects=OBJECTS, recordings=3, rng=rng, signal=2.0)
    features = {context: values.copy() for context, values in made.features.items()}
    for values in features.values():
        values[1, 2] = np.nan
    return Dataset(made.domain, made.objects, features, made.labels, partial=True)


def tasks(dataset):
    rng = np.random.default_rng(3)
    names = dataset.domain.attributes
    for number in range(40):
        o = int(rng.integers(OBJECTS))
        asked = tuple(
            sorted(rng.choice(names, size=int(rng.integers(1, 3)), replace=False).tolist())
        )
        name = dataset.objects[o]
        yield Task(f"{number}", Query(asked), o, name, ("test", number, name), learn=False)


@pytest.mark.parametrize("agent", ["bayes", "bayes_memory", "iterative_morc", "random", "greedy"])
def test_they_are_the_trials_that_ask_runs(dataset, agent):
    learner = Learner(dataset.domain, agent=agent, seed=4, logs=None).fit(dataset)
    other = Learner(dataset.domain, agent=agent, seed=4, logs=None).fit(dataset)
    tests = other.begin_tests(dataset)
    for task in tasks(dataset):
        truth = dataset.labels[task.object_index, dataset.domain.columns(task.query.attributes)]
        robots = (RecordedRobot.of(dataset, task.object_index, seed=4, key=task.key) for _ in "ab")
        alone = learner.ask(task, next(robots), truth=truth, learn=False)
        assert tests.run(task, next(robots), truth) == alone


def test_of_a_batch_each_history_is_decided_once(dataset, monkeypatch):
    learner = Learner(dataset.domain, agent="iterative_morc", seed=4, logs=None).fit(dataset)
    decided = []
    tests = learner.begin_tests(dataset)
    decide = shared_tests.decide
    monkeypatch.setattr(
        shared_tests, "decide", lambda *words: decided.append(words[1]) or decide(*words)
    )
    steps = 0
    for task in tasks(dataset):
        truth = dataset.labels[task.object_index, dataset.domain.columns(task.query.attributes)]
        robot = RecordedRobot.of(dataset, task.object_index, seed=4, key=task.key)
        steps += len(tests.run(task, robot, truth).steps)
    assert len(decided) < steps

"""Copies of learners, sessions and environments act alone, here and in another process."""

import copy
import pickle

import cloudpickle
import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import meal_bayes.gym
from meal_bayes import Learner
from meal_bayes.datasets import load_percepts
from meal_bayes.experiments import offline_tasks
from meal_bayes.trial_log import read_trials

COPIES = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda value: pickle.loads(pickle.dumps(value)),  # noqa: S301  of our own
    "cloudpickle": lambda value: pickle.loads(cloudpickle.dumps(value)),  # noqa: S301  the same
}
assert meal_bayes.gym.ENVIRONMENTS  # the import registers them


def same(first, second):
    observed = zip(first[0].values(), second[0].values(), strict=True)
    return first[1:4] == second[1:4] and all(np.array_equal(a, b) for a, b in observed)


@pytest.fixture(scope="module")
def environment():
    options = {"attributes": 1, "agent": "greedy", "trials": 36, "logs": None}
    return gymnasium.make("meal_bayes/ROC36-v0", **options)


@settings(max_examples=15)
@given(
    st.sampled_from(sorted(COPIES)), st.integers(0, 99), st.lists(st.integers(0, 11), max_size=4)
)
def test_a_copy_of_an_environment_acts_alone(environment, how, seed, actions):
    environment.reset(seed=seed)
    environment.step(0)
    twin = COPIES[how](environment)
    before = len(environment.unwrapped.trial.steps)
    of_twin = [twin.step(action) for action in actions]
    assert len(environment.unwrapped.trial.steps) == before
    assert all(map(same, of_twin, [environment.step(action) for action in actions]))


@pytest.mark.parametrize("how", sorted(COPIES))
def test_a_copy_of_a_learner_learns_alone(dataset, make, how):
    learner = Learner(dataset.domain, agent="greedy", logs=None).fit(dataset)
    twin = COPIES[how](learner)
    trial = twin.ask("red", make.arm(), object_name="mug")
    twin.tell(trial, {"red": True})
    assert len(learner.experience.trials) < len(twin.experience.trials)
    again = learner.ask("red", make.arm(), object_name="mug")
    assert again.cost == trial.cost
    np.testing.assert_array_equal(again.last_belief.log_prob, trial.last_belief.log_prob)


@pytest.mark.parametrize("how", sorted(COPIES))
def test_a_copy_of_a_session_goes_on_alone(how):
    table = load_percepts("roc36")
    learner = Learner("roc36", agent="greedy", logs=None).fit(table)
    (task,) = offline_tasks(table, 1, 1, seed=0)
    session = learner.begin(task, state=learner.replay(task).start())
    twin = COPIES[how](session)
    twin.fail()
    assert len(session.steps) == 0
    assert len(twin.steps) == 1


@pytest.mark.parametrize("how", sorted(COPIES))
def test_a_copy_of_an_environment_writes_a_log_of_its_own(how, tmp_path):
    options = {"attributes": 1, "agent": "greedy", "trials": 36, "logs": tmp_path}
    environment = gymnasium.make("meal_bayes/ROC36-v0", **options)
    environment.reset(seed=0)
    environment.step(environment.action_space.n - 1)
    environment.reset()
    environment.step(0)
    twin = COPIES[how](environment)
    for env in (environment, twin):
        env.step(env.action_space.n - 1)
        env.close()
    logs = sorted(tmp_path.rglob("*.mcap"))
    assert [len(list(read_trials(log))) for log in logs] == [2, 1]

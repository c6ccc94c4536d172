"""Gymnasium environments: they keep the rules, and score what the experiments score."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from meal_bayes.datasets import load_percepts
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import offline_tasks
from meal_bayes.gym import ENVIRONMENTS, MealEnv
from meal_bayes.learner import Learner
from meal_bayes.trial_log import read_trials

SHIPPED = [name for name in ENVIRONMENTS if "Own" not in name]


def made(name, **settings):
    return gymnasium.make(name, agent="greedy", trials=20, **settings).unwrapped


@pytest.mark.parametrize("name", SHIPPED)
def test_gymnasium_finds_nothing_wrong(name):
    check_env(made(name, render_mode="ansi"), skip_render_check=False)


def test_a_table_of_ones_own_is_an_environment():
    env = made("meal_bayes/Own-v0", dataset=load_percepts("roc36"), attributes=1)
    check_env(env)
    with pytest.raises(SettingsError, match="Give dataset="):
        gymnasium.make("meal_bayes/Own-v0")


@pytest.mark.parametrize("agent", ["greedy", "predefined_plus"])
@pytest.mark.parametrize("name", SHIPPED)
def test_an_agent_scores_what_an_offline_run_says(name, agent):
    env = MealEnv(ENVIRONMENTS[name]["dataset"], agent=agent, seed=3, trials=12)
    table = load_percepts(ENVIRONMENTS[name]["dataset"])
    learner = Learner(table.domain, agent=agent, seed=3, logs=None).fit(table)
    for index, task in enumerate(offline_tasks(table, 2, 12, 3)):
        env.reset(options={"task": index})
        total, done = 0.0, False
        while not done:
            _, reward, done, _, info = env.step(env.decide())
            total += reward
        trial = learner.ask(task)
        assert total == pytest.approx(trial.reward)
        assert info["success"] is trial.success
        assert [step.decision.action for step in env.trial.steps] == [
            step.decision.action for step in trial.steps
        ]


def test_masked_behaviors_cost_and_change_nothing():
    env = MealEnv("roc36", agent="greedy", trials=20)
    for seed in range(10):
        before, info = env.reset(seed=seed)
        illegal = int(np.flatnonzero(info["action_mask"] == 0)[0])
        after, reward, ended, _, _ = env.step(illegal)
        assert not ended
        assert reward == -env.trial.momdp.cost[illegal]
        assert not env.trial.steps
        assert all(np.array_equal(before[name], after[name]) for name in before)
        after, reward, ended, _, _ = env.step(int(np.flatnonzero(info["action_mask"])[0]))
        assert not ended
        assert reward == pytest.approx(-after["cost"][0])
        for action in (-1, env.action_space.n):
            with pytest.raises(SettingsError, match=f"action {action}; expected 0 to"):
                env.step(action)
        env.step(env.action_space.n - 1)
        with pytest.raises(SettingsError, match="is over"):
            env.step(0)


def test_an_agent_that_may_abstain_has_one_more_action():
    env = MealEnv("roc36", agent="morc", trials=2)
    _, info = env.reset(seed=0)
    assert env.actions[-1] == "abstain"
    _, reward, ended, _, info = env.step(env.action_space.n - 1)
    assert ended
    assert reward == 0
    assert info["success"] is False


def test_randomness_is_new_in_every_episode_and_repeats_under_a_seed():
    env = MealEnv("cy101", agent="greedy", trials=5, max_steps=4)

    def episodes(seed):
        found = []
        for k in range(6):
            _, info = env.reset(seed=seed if k == 0 else None)
            look = env.actions.index("look")
            found.append((info["object"], env.step(look)[0]["percepts"].tobytes()))
        return found

    first = episodes(1)
    assert first == episodes(1)
    assert len({name for name, _ in first}) > 1
    assert first != episodes(2)


def test_importing_the_module_registers_the_environments():
    assert set(ENVIRONMENTS) <= set(gymnasium.registry)
    env = gymnasium.make("meal_bayes.gym:meal_bayes/CY101-v0", agent="greedy", attributes=1)
    assert env.unwrapped.tasks


def test_train_and_test_objects_are_apart_whatever_the_seed():
    asked = {
        (name, seed): {task.object_name for task in MealEnv(
            "roc36", agent="greedy", trials=300, objects=name, seed=seed
        ).tasks}
        for name in ("train", "test") for seed in (0, 1)
    }  # fmt: skip
    assert asked["train", 0] == asked["train", 1]
    assert not asked["train", 0] & asked["test", 1]
    assert (len(asked["train", 0]), len(asked["test", 0])) == (27, 9)
    one = load_percepts("roc36").objects[:1]
    env = MealEnv("roc36", agent="greedy", objects=one)
    assert {task.object_name for task in env.tasks} == set(one)
    for objects in ("trian", ["no such object"]):
        with pytest.raises(SettingsError, match="expected one of"):
            MealEnv("roc36", agent="greedy", objects=objects)


def test_rewards_are_scaled():
    plain, scaled = (MealEnv("roc36", agent="greedy", trials=5, scale=s) for s in (1.0, 0.01))
    for env in (plain, scaled):
        env.reset(seed=3)
    for action in (plain.actions.index("look"), plain.action_space.n - 1):
        assert scaled.step(action)[1] == pytest.approx(0.01 * plain.step(action)[1])
    assert scaled.trial.reward == plain.trial.reward


def test_a_long_episode_is_truncated():
    env = MealEnv("roc36", agent="greedy", trials=5, max_steps=3)
    env.reset(seed=0)
    look = env.actions.index("look")
    ended = [env.step(look)[2:4]]
    while not any(ended[-1]):
        _, _, terminated, truncated, _ = env.step(int(np.flatnonzero(env.action_masks())[0]))
        ended.append((terminated, truncated))
    assert ended == [(False, False), (False, False), (False, True)]


def test_episodes_are_logged_if_that_is_asked_for(tmp_path):
    env = MealEnv("roc36", agent="greedy", trials=5, logs=tmp_path)
    for action in (env.action_space.n - 1, 0):
        env.reset(seed=0)
        env.step(action)
    env.close()
    logs = sorted((tmp_path / "roc36").glob("*.mcap"))
    trials = [trial for log in logs for trial in read_trials(log)]
    assert [trial.ended for trial in trials] == ["", "left before the answer"]
    assert trials[0].success is not None


def test_tasks_that_are_not_there_are_told():
    with pytest.raises(SettingsError, match="expected 0 to 4"):
        MealEnv("roc36", agent="greedy", trials=5).reset(options={"task": 5})
    with pytest.raises(SettingsError, match="call reset"):
        MealEnv("roc36", agent="greedy", trials=5).step(0)

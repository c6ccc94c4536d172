"""Gymnasium environments: they keep the rules, and score what the experiments score."""

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from meal_bayes.agents import OfflineRunner, load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.errors import SettingsError
from meal_bayes.experiments import offline_tasks
from meal_bayes.gym import ENVIRONMENTS, MealEnv, register

register()
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
    morc = OfflineRunner(table, load_agent(agent), 3)
    for index, task in enumerate(offline_tasks(table, 2, 12, 3)):
        env.reset(options={"task": index})
        total, done = 0.0, False
        while not done:
            _, reward, done, _, info = env.step(env.decide())
            total += reward
        trial = morc.run(task)
        assert total == pytest.approx(trial.reward)
        assert info["success"] is trial.success
        assert [step.decision.action for step in env.trial.steps] == [
            step.decision.action for step in trial.steps
        ]


def test_masked_behaviors_end_the_episode_and_others_do_not():
    env = MealEnv("roc36", agent="greedy", trials=20)
    for seed in range(10):
        _, info = env.reset(seed=seed)
        illegal = np.flatnonzero(info["action_mask"] == 0)
        assert illegal.size
        after, _, ended, _, _ = env.step(int(illegal[0]))
        assert ended
        assert after["state"] == env.observation_space["state"].n - 1
        env.reset(seed=seed)
        after, reward, ended, _, _ = env.step(int(np.flatnonzero(info["action_mask"])[0]))
        assert not ended
        assert reward == pytest.approx(-after["cost"][0])
        env.step(env.action_space.n - 1)
        with pytest.raises(SettingsError, match="is over"):
            env.step(0)


def test_randomness_is_new_in_every_episode_and_repeats_under_a_seed():
    env = MealEnv("cy101", agent="greedy", trials=5, max_steps=4)

    def episodes(seed):
        found = []
        for k in range(6):
            _, info = env.reset(seed=seed if k == 0 else None)
            look = info["actions"].index("look")
            found.append((info["object"], env.step(look)[0]["percepts"].tobytes()))
        return found

    first = episodes(1)
    assert first == episodes(1)
    assert len({name for name, _ in first}) > 1
    assert first != episodes(2)


def test_a_long_episode_is_truncated():
    env = MealEnv("roc36", agent="greedy", trials=5, max_steps=3)
    _, info = env.reset(seed=0)
    look = info["actions"].index("look")
    ended = [env.step(look)[2:4]]
    while not any(ended[-1]):
        _, _, terminated, truncated, info = env.step(int(np.flatnonzero(env._mask())[0]))
        ended.append((terminated, truncated))
    assert ended == [(False, False), (False, False), (False, True)]


def test_tasks_that_are_not_there_are_told():
    with pytest.raises(SettingsError, match="expected 0 to 4"):
        MealEnv("roc36", agent="greedy", trials=5).reset(options={"task": 5})
    with pytest.raises(SettingsError, match="call reset"):
        MealEnv("roc36", agent="greedy", trials=5).step(0)

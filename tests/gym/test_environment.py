"""Gymnasium environments: they keep the rules, and score what the experiments score."""

from dataclasses import replace

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


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_gymnasium_finds_nothing_wrong(name):
    options = {"dataset": load_percepts("roc36"), "attributes": 1} if "Own" in name else {}
    env = gymnasium.make(name, agent="greedy", trials=20, **options).unwrapped
    check_env(env, skip_render_check=True)
    with pytest.raises(SettingsError, match="Give dataset="):
        gymnasium.make("meal_bayes/Own-v0")


@pytest.mark.parametrize(
    ("dataset", "agent"), [("roc36", "greedy"), ("ispy32", "predefined_plus"), ("cy101", "greedy")]
)
def test_an_agent_scores_what_an_offline_run_says(dataset, agent):
    env = MealEnv(dataset, agent=agent, seed=3, trials=12)
    table = load_percepts(dataset)
    learner = Learner(table.domain, agent=agent, seed=3, logs=None).fit(table)
    for index, task in enumerate(offline_tasks(table, 2, 12, 3)):
        env.reset(options={"task": index})
        total = 0.0
        done = False
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
            with pytest.raises(SettingsError, match=f"action is {action}; give one of"):
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
        percepts = []
        for k in range(6):
            _, info = env.reset(seed=seed if k == 0 else None)
            look = env.actions.index("look")
            percepts.append((info["object"], env.step(look)[0]["percepts"].tobytes()))
        return percepts

    first = episodes(1)
    assert first == episodes(1)
    assert len({name for name, _ in first}) > 1
    assert first != episodes(2)


def test_train_and_test_objects_are_apart_whatever_the_seed():
    def asked(objects, seed):
        env = MealEnv("roc36", agent="greedy", trials=300, objects=objects, seed=seed)
        return {task.object_name for task in env.tasks}

    train = asked("train", 0)
    test = asked("test", 1)
    assert asked("train", 1) == train
    assert not train & test
    assert (len(train), len(test)) == (27, 9)
    assert asked([*test][:1], 0) == {*[*test][:1]}
    for objects in ("trian", ["no such object"]):
        with pytest.raises(SettingsError, match=r"Unknown (set of objects 'tri|object 'no such)"):
            MealEnv("roc36", agent="greedy", objects=objects)


def test_a_task_that_comes_back_is_built_anew_only_after_a_label():
    table = load_percepts("roc36")
    labels = table.labels.copy()
    labels[5] = -1
    learner = Learner(table.domain, logs=None).fit(replace(table, labels=labels))
    task = offline_tasks(table, 2, 1, 0)[0]
    assert task.object_name != table.objects[5]

    def begun():
        return learner.begin(task, commanded=True).momdp

    first = begun()
    assert begun() is first
    learner.tell(table.objects[5], {table.domain.attributes[0]: True})
    after = begun()
    assert not np.array_equal(after.confusion, first.confusion)
    assert np.array_equal(after.confusion, learner.problem(task).confusion)


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


def test_test_episodes_are_logged_and_others_if_that_is_asked_for(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for objects, often in (("test", 1), ("train", 1), ("all", 1)):  # once a test, else nothing
        env = MealEnv("roc36", agent="greedy", trials=40, objects=objects)
        env.reset(seed=0)
        env.step(env.action_space.n - 1)
        assert len([*(tmp_path / "logs").rglob("*.mcap")]) == often
    MealEnv("roc36", agent="greedy", trials=40, objects="test", logs=None).reset(seed=0)
    assert len([*tmp_path.rglob("*.mcap*")]) == 1


def test_episodes_are_logged_as_far_as_they_went(tmp_path):
    env = MealEnv("roc36", agent="greedy", trials=5, logs=tmp_path, log_training=True)
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


@pytest.mark.parametrize("options", [{"tsak": 1}, 3, ["task"]])
def test_options_that_mean_nothing_are_told(options):
    env = MealEnv("roc36", agent="greedy", trials=5)
    with pytest.raises(SettingsError, match="'task': i"):
        env.reset(options=options)


@pytest.mark.parametrize("action", [-1, 14, 10**30, np.int64(99)])
def test_an_action_that_is_not_there_changes_nothing(action):
    env = MealEnv("roc36", attributes=1, agent="greedy", trials=5)
    before, _ = env.reset(seed=0)
    with pytest.raises(SettingsError, match=r"give one of Discrete\(14\)"):
        env.step(action)
    assert env.step(0)[0]["cost"] > before["cost"]


@pytest.mark.parametrize(
    "action", [2.7, "3", True, np.bool_(True), np.array([3]), float("nan"), None, np.float64(2)]
)
def test_what_is_no_whole_number_is_no_action(action):
    env = gymnasium.make("meal_bayes/ROC36-v0", attributes=1, agent="greedy").unwrapped
    env.reset(seed=0)
    with pytest.raises(SettingsError, match="give a whole number of Discrete"):
        env.step(action)


@pytest.mark.parametrize(
    "options",
    [{"answer": "yes/no"}, {"scale": 0}, {"scale": float("nan")}, {"scale": "x"}, {"max_steps": -1},
     {"max_steps": 2.5}, {"seed": -1}, {"attributes": 2.0}, {"trials": "x"}],
)  # fmt: skip
def test_settings_that_mean_nothing_are_told(options):
    with pytest.raises(SettingsError, match=next(iter(options))):
        MealEnv("roc36", agent="greedy", **{"trials": 5} | options)


@pytest.mark.parametrize("task", ["x", 2.5, -1])
def test_a_task_is_a_number(task):
    with pytest.raises(SettingsError, match="task"):
        MealEnv("roc36", agent="greedy", trials=5).reset(options={"task": task})


KINDS = {
    "attributes": [True, None, "1", 1.0],
    "objects": [5, None, [5], [None], b"all", True],
    "logs": [5, b"logs", "", ["logs"], True],
    "log_training": [5, "no", None],
    "seed": [True, 1.0, None],
    "trials": [True, None],
    "max_steps": [True, None],
}


@pytest.mark.parametrize(("name", "value"), [(n, v) for n, values in KINDS.items() for v in values])
def test_settings_of_other_kinds_are_told(name, value):
    with pytest.raises(SettingsError, match=f"{name} (is|are)"):
        MealEnv("roc36", agent="greedy", **{"trials": 5} | {name: value})

"""Gymnasium environments: they keep the rules, and score what the experiments score."""

import signal
import subprocess
import sys
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

from meal_bayes.datasets import load_percepts
from meal_bayes.errors import MealBayesError, SettingsError
from meal_bayes.experiments import offline_tasks
from meal_bayes.gym import ENVIRONMENTS, MealEnv
from meal_bayes.learner import Learner
from meal_bayes.trial_log import Logs, read_trials, recover_log, salvage


@pytest.fixture(autouse=True)
def _logs_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # every environment logs in the working directory by default


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


def play(env, episodes):
    """Let the agent of an environment answer some tasks."""
    for seed in range(episodes):
        env.reset(seed=seed)
        ended = False
        while not ended:
            ended = any(env.step(env.unwrapped.decide())[2:4])


def logs_in(folder):
    return sorted(folder.rglob("*.mcap*"))


def test_all_episodes_of_an_environment_stand_in_one_log(tmp_path):
    env = gymnasium.make("meal_bayes/ROC36-v0", agent="greedy", trials=40)
    env.reset(seed=0)
    assert not logs_in(tmp_path)  # nothing was done
    play(env, 3)
    played = env.unwrapped.trial
    env.close()
    (log,) = logs_in(tmp_path)
    assert log.parent == tmp_path / "logs/gym-roc36-n2"
    trials = list(read_trials(log))
    assert len(trials) == 3
    assert {trial.agent for trial in trials} == {"greedy"}
    assert trials[-1].cost == played.cost
    assert trials[-1].success is played.success
    assert len({trial.task.key for trial in trials}) == 3
    env = MealEnv("roc36", agent="greedy", trials=40, logs=None)
    play(env, 1)
    env.close()
    assert logs_in(tmp_path) == [log]


def test_what_was_logged_can_be_read_while_the_environment_goes_on(tmp_path):
    env = MealEnv("roc36", agent="greedy", trials=40, logs=tmp_path)
    play(env, 2)
    env.reset(seed=5)
    env.step(0)
    (draft,) = logs_in(tmp_path)
    assert [trial.ended for trial in salvage(draft)] == ["", ""]
    del env  # as the end of a program
    (log,) = logs_in(tmp_path)
    assert [trial.ended for trial in read_trials(log)] == ["", "", "left before the answer"]


@pytest.mark.long
def test_a_killed_program_leaves_every_episode_that_ended(tmp_path):
    program = """
import os, signal, sys
from meal_bayes.gym import MealEnv
env = MealEnv("roc36", attributes=1, agent="greedy", trials=40, logs=sys.argv[1])
for seed in range(3):
    env.reset(seed=seed)
    env.step(0)
    env.step(env.action_space.n - 1)
os.kill(os.getpid(), signal.SIGKILL)
"""
    killed = subprocess.run([sys.executable, "-c", program, str(tmp_path)], check=False)
    assert killed.returncode == -signal.SIGKILL
    (draft,) = logs_in(tmp_path)
    recovered = recover_log(draft)
    assert [len(trial.steps) for trial in read_trials(recovered)] == [2, 2, 2]


@pytest.mark.filterwarnings("default:.*ERROR")  # Gymnasium's, before it raises a worker's error
@pytest.mark.parametrize("make", [gymnasium.vector.SyncVectorEnv, gymnasium.vector.AsyncVectorEnv])
def test_each_environment_of_a_vector_writes_a_file_of_its_own(tmp_path, make):
    def one():
        return MealEnv("roc36", attributes=1, agent="greedy", trials=40, logs=tmp_path)

    envs = make([one, one])
    envs.reset(seed=3)
    for _ in range(4):  # answers, each followed by a reset
        envs.step(np.full(2, envs.single_action_space.n - 1))
    envs.close()
    logs = logs_in(tmp_path)
    assert [len(list(read_trials(log))) for log in logs] == [2, 2]
    assert len(list(Logs(tmp_path).trials())) == 4


def test_who_chose_the_actions_is_logged(tmp_path):
    env = MealEnv("roc36", attributes=1, agent="greedy", trials=5, logs=tmp_path)
    play(env, 1)
    env.reset(seed=0)
    env.step(0)
    assert env.trial.agent == "external"
    env.reset(seed=1)
    env.step(env.decide())
    env.close()
    (log,) = logs_in(tmp_path)
    assert [trial.agent for trial in read_trials(log)] == ["greedy", "external", "greedy"]


def test_why_an_episode_has_no_answer_is_logged(tmp_path):
    env = MealEnv("roc36", agent="greedy", trials=5, logs=tmp_path, max_steps=2)
    for steps in (2, 1):
        env.reset(seed=0)
        for _ in range(steps):
            env.step(int(np.flatnonzero(env.action_masks())[0]))
    env.close()
    (log,) = logs_in(tmp_path)
    ended = [trial.ended for trial in read_trials(log)]
    assert ended == ["truncated after 2 steps", "left before the answer"]


def test_tasks_that_are_not_there_are_told():
    with pytest.raises(SettingsError, match="0 to 4"):
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


@pytest.mark.parametrize("value", [10**30, 2**63, 1e308, np.inf, b"x", object()])
@pytest.mark.parametrize("name", ["attributes", "trials", "max_steps", "scale", "objects"])
def test_a_setting_beyond_what_a_run_can_hold_is_told(name, value):
    with pytest.raises(MealBayesError, match=name.removesuffix("s")):
        MealEnv("roc36", **{"agent": "greedy", "logs": None, name: value})


def test_names_of_objects_may_stand_in_an_array():
    names = ["heavy_blue_beans", "light_blue_rice"]
    env = MealEnv("roc36", attributes=1, agent="greedy", logs=None, objects=np.array(names))
    assert {task.object_name for task in env.tasks} == {*names}
    with pytest.raises(SettingsError, match="objects are"):
        MealEnv("roc36", agent="greedy", logs=None, objects=np.array(2))


@pytest.mark.parametrize("task", ["x", 2.5, -1])
def test_a_task_is_a_number(task):
    with pytest.raises(SettingsError, match="task"):
        MealEnv("roc36", agent="greedy", trials=5).reset(options={"task": task})

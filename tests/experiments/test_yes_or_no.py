"""Yes or no where people meet it: runs, logs, Gymnasium, and the command line."""

import dataclasses
from importlib import import_module

import numpy as np
import pytest

from meal_bayes import Learner, load_percepts
from meal_bayes.domain import read_event
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.evaluation import answer_rates, summarize
from meal_bayes.experiments import OfflineConfig, OnlineConfig, offline_tasks, run_offline
from meal_bayes.experiments.offline import plan_offline
from meal_bayes.planners import OpenLoop
from meal_bayes.trial_log import read_trials, write_trials
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.text import final_facts

TABLE = load_percepts("roc36")


def truth_of(task):
    columns = TABLE.domain.columns(task.query.attributes)
    return int(task.query.report_truth(TABLE.labels[task.object_index, columns])[0])


@pytest.mark.parametrize("n", [1, 2, 3])
def test_half_of_balanced_questions_are_answered_with_yes(n):
    values = offline_tasks(TABLE, n, 40, 0)
    balanced = offline_tasks(TABLE, n, 40, 0, answer="balanced")
    assert sum(map(truth_of, balanced)) == 20
    for task, other in zip(values, balanced, strict=True):
        assert (task.key, task.query.attributes) == (other.key, other.query.attributes)


def test_a_conjunction_is_true_where_all_attributes_are():
    for task in offline_tasks(TABLE, 2, 30, 1, answer="yes or no"):
        columns = TABLE.domain.columns(task.query.attributes)
        assert truth_of(task) == TABLE.labels[task.object_index, columns].min()


GROUPS = [
    {"content": ("glass", "screws", "beans", "rice")},
    {"color": ("brown", "green", "blue")},
    {"color": ("brown", "green", "blue"), "weight": ("light", "medium", "heavy")},
]


def grouped(groups):
    """Return the table of a domain that has these groups alone."""
    return dataclasses.replace(TABLE, domain=dataclasses.replace(TABLE.domain, groups=groups))


def refused(task, domain):
    """Return why a question cannot be asked in words; empty where it can."""
    try:
        read_event(task.query.text.removesuffix("?"), domain)
    except QueryError as fault:
        return str(fault)
    return ""


@pytest.mark.quick(4)
@pytest.mark.parametrize("groups", [*GROUPS, TABLE.domain.groups])
@pytest.mark.parametrize("n", [2, 3, 4])
@pytest.mark.parametrize("answer", ["yes or no", "balanced"])
def test_nothing_is_asked_that_the_groups_say(groups, n, answer):
    """Every question of a run is one that `ask` takes, by objects that fit what is asked."""
    table = grouped(groups)
    variables = len(groups) + 10 - sum(map(len, groups.values()))
    if answer == "yes or no" and n > variables:
        with pytest.raises(SettingsError, match=f"no object has .* more than {variables} attri"):
            offline_tasks(table, n, 1, 0, answer=answer)
        return
    tasks = offline_tasks(table, n, 200, 0, answer=answer)
    assert {refused(task, table.domain) for task in tasks} == {""}
    assert len({(task.object_name, task.query.attributes) for task in tasks}) > 100
    if answer == "balanced":
        assert sum(map(truth_of, tasks)) == 100
        denied = {task.query.event.allowed for task in tasks}
        assert len(denied) == 2**n - (n > variables)


def test_what_two_objects_of_few_labels_leave_to_ask_is_asked():
    """Values of one group are labeled of one object, of two of another: only that is asked."""
    labels = np.full_like(TABLE.labels, -1)
    labels[0, TABLE.domain.columns(("glass", "screws", "beans"))] = [1, 0, 0]
    labels[1, TABLE.domain.columns(("glass", "heavy"))] = [0, 1]
    domain = dataclasses.replace(TABLE.domain, groups=GROUPS[0], asked_minimum=-1)
    table = dataclasses.replace(TABLE, domain=domain, labels=labels)
    tasks = offline_tasks(table, 2, 5, 0, answer="yes or no")
    assert {task.query.attributes for task in tasks} == {("heavy", "glass")}
    with pytest.raises(SettingsError, match="more than 2 attributes that can be true together"):
        offline_tasks(table, 3, 5, 0, answer="yes or no")


def test_one_agent_may_be_named_alone():
    for config in (OfflineConfig, OnlineConfig):
        for agent in ("bayes", OpenLoop()):
            (alone,) = config("roc36", agents=agent).agents
            (listed,) = config("roc36", agents=(agent,)).agents
            assert alone.name == listed.name
        with pytest.raises(SettingsError, match="'bays'"):
            config("roc36", agents="bays")


def test_an_unknown_kind_of_answer_is_refused():
    with pytest.raises(SettingsError, match="expected one of"):
        OfflineConfig("roc36", answer="perhaps")
    with pytest.raises(QueryError, match="'values' or 'yes or no'"):
        Learner("roc36", logs=None).fit(TABLE).ask("heavy", TABLE.objects[0], answer="perhaps")


@pytest.mark.parametrize(
    ("question", "payoffs"),
    [
        ("blue and not heavy", None),
        ("blue or green", (9, -9, 9, -99)),
        ("heavy", (100, -200, 300, -400)),
    ],
)
def test_trials_come_back_from_their_logs(question, payoffs, tmp_path):
    learner = Learner("roc36", agent="olfc", logs=None).fit(TABLE)
    trial = learner.ask(question, TABLE.objects[4], answer="yes or no", payoffs=payoffs)
    path = tmp_path / "trial.mcap"
    write_trials(path, [trial], header={})
    (logged,) = read_trials(path)
    assert logged.task == trial.task
    assert logged.momdp.payoffs == trial.momdp.payoffs
    assert (logged.success, logged.reward) == (trial.success, trial.reward)
    assert logged.probability == trial.probability
    assert final_facts(logged) == final_facts(trial)
    outcomes = TrialOutcomes.of([trial])
    read = TrialOutcomes.of([logged])
    assert outcomes.attribute.tolist() == read.attribute.tolist()
    assert outcomes.attribute.shape == (1, 1)
    assert outcomes.success == read.success
    if trial.report is not None and payoffs is not None:
        assert round(trial.reward + trial.cost, 9) in payoffs


def test_a_run_reports_rates_and_calibration_of_the_event(tmp_path):
    config = OfflineConfig("roc36", 2, 12, ("olfc", "random"), answer="balanced")
    run = run_offline(config, logs=tmp_path)
    rates = answer_rates(run.outcomes().of_agent("olfc"))
    assert rates.yes == 0.5
    assert rates.hit_rate > rates.false_alarm_rate
    trials = [trial for trial in run.trials() if trial.agent == "olfc"]
    expected = -np.mean([
        np.log(np.clip(t.probability if truth_of(t.task) else 1 - t.probability, 1e-6, 1 - 1e-6))
        for t in trials
    ])  # fmt: skip
    row = next(row for row in summarize(run) if row.agent == "olfc")
    assert row.nll == pytest.approx(expected)
    with pytest.raises(SettingsError, match="several values"):
        answer_rates(run_offline(OfflineConfig("roc36", 2, 2, ("random",)), logs=tmp_path))


@pytest.mark.parametrize("answer", ["values", "yes or no", "balanced"])
def test_runs_share_a_file_only_where_they_ask_the_same(answer, tmp_path):
    short, long = (
        plan_offline(OfflineConfig("roc36", 2, trials, ("greedy",), answer=answer), logs=tmp_path)
        for trials in (100, 200)
    )
    shared = short.units[0].path == long.units[0].path
    assert shared == (short.units[0].tasks == long.units[0].tasks) == (answer != "balanced")


@pytest.mark.long
def test_more_misses_are_avoided_where_they_are_dear():
    """The same questions, paired: a miss ten times as dear as a false alarm."""
    learner = Learner("cy101", agent="olfc", logs=None).fit(load_percepts("cy101"))
    table = learner.table
    misses = []
    for payoffs in ((300, -300, 300, -300), (300, -300, 300, -3000)):
        missed = 0
        for task in offline_tasks(table, 2, 60, 0, answer="balanced"):
            text = task.query.text.removesuffix("?")
            query = read_event(text, table.domain, payoffs)
            trial = learner.ask(query, task.object_name)
            missed += trial.success is False and not trial.report[0]
        misses.append(missed)
    assert misses[1] < misses[0]


def test_an_environment_has_two_reports():
    gym = import_module("meal_bayes.gym")
    env = gym.MealEnv("roc36", attributes=2, trials=6, answer="balanced", agent="olfc", logs=None)
    _, info = env.reset(options={"task": 0})
    behaviors = len(env.trial.momdp.behavior_names)
    assert env.action_space.n == behaviors + 2 + env.trial.momdp.abstain
    assert env.actions[behaviors : behaviors + 2] == ["report no", "report yes"]
    assert info["question"].endswith("?")
    answer = truth_of(env.trial.task)
    _, reward, over, _, info = env.step(behaviors + answer)
    assert (reward, over, info["success"]) == (500.0, True, True)

"""Algorithm 1 from a table to trials: what agents share, their percepts, the values of groups."""

import dataclasses
from collections import defaultdict
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes import Learner
from meal_bayes.agents import AGENTS, Agent, load_agent
from meal_bayes.datasets import load_percepts
from meal_bayes.domain import Query, read_query
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.experiments import offline_tasks
from meal_bayes.momdp import Objective, build_momdp
from meal_bayes.planners import POMCP, Factored, Predefined, RandomLegal
from meal_bayes.trial_log import read_trials, write_trials
from meal_bayes.trials import Task, TrialOutcomes

QUICK = ("random_legal", "predefined", "predefined_plus", "greedy")
EAGER = Agent("eager", lambda domain, query: Predefined(("look",) * 12))  # looks, come what may


def fast(name):
    """Make a named agent that searches little."""
    agent = load_agent(name)
    if name in ("morc", "bayes"):
        return dataclasses.replace(agent, solver=lambda domain, query: POMCP(20))
    return agent


def outcomes(trial):
    """(moved, percept) of each behavior's executions in order, where they were legal."""
    percepts_of = defaultdict(list)
    for step in trial.steps:
        action = step.decision.action
        if action < trial.momdp.n_behaviors and trial.momdp.legal[step.x, action]:
            percept = None if step.observation is None else tuple(step.observation.tolist())
            percepts_of[action].append((step.next_x != step.x, percept))
    return percepts_of


def same_trial(first, second):
    pairs = zip(first.steps, second.steps, strict=True)
    return np.array_equal(first.report, second.report) and all(
        a.decision.action == b.decision.action
        and a.next_x == b.next_x
        and np.array_equal(a.belief.log_odds, b.belief.log_odds)
        and np.array_equal(a.decision.values, b.decision.values, equal_nan=True)
        for a, b in pairs
    )


def test_prior_answers_by_base_rates_and_touches_nothing(table, make):
    learner = make.learner(table, load_agent("prior"), 1)
    trials = [learner.ask(make.task(table, index)) for index in range(6)]
    for trial in trials:
        assert trial.cost == 0.0
        (step,) = trial.steps
        np.testing.assert_array_equal(trial.report, step.belief.positive > 0.5)


@pytest.mark.quick(6)
@pytest.mark.parametrize("name", AGENTS)
def test_every_agent_runs_and_repeats_itself(table, make, name):
    agent = fast(name)
    first, second = (make.learner(table, agent, 7) for _ in range(2))
    tasks = [make.task(table, index) for index in range(4)]
    trials = [first.ask(task) for task in tasks]
    again = [second.ask(task) for task in reversed(tasks)][::-1]  # the order is no matter
    assert all(map(same_trial, trials, again))
    assert {trial.agent for trial in trials} == {name}


def test_seeds_change_trials(table, make):
    task = make.task(table, 0)
    trials = [make.learner(table, load_agent("random_legal"), seed).ask(task) for seed in range(5)]
    assert len({tuple(step.decision.action for step in trial.steps) for trial in trials}) > 1


def test_all_agents_meet_the_same_failures_and_recordings(table, make):
    """The k-th execution of a behavior comes out the same, whoever executes it."""
    compared = 0
    for index in range(len(table.objects)):
        task = make.task(table, index)
        met = [outcomes(make.learner(table, fast(name), 5).ask(task)) for name in (*QUICK, "morc")]
        for first in met:
            for second in met:
                for action in first.keys() & second.keys():
                    shared = min(len(first[action]), len(second[action]))
                    assert first[action][:shared] == second[action][:shared]
                    compared += shared * (first is not second)
    assert compared > 200


def misleading(table):
    """Make all recordings say yes, and the training side know the truth perfectly."""
    log_odds = np.where(np.isnan(table.log_odds), np.nan, 4.0)
    bins = np.zeros_like(table.training_bins)
    for other in range(len(table.objects)):
        for p in range(2):
            bins[:, other, p, :2, 7 if table.labels[other, p] == 1 else 0] = 4
        bins[other, other] = 0
    return dataclasses.replace(table, log_odds=log_odds, training_bins=bins)


def test_recorded_percepts_are_the_recordings_model_percepts_the_model_s(table, make):
    tricked = misleading(table)
    said = {"recorded": [], "model": []}
    for percepts, rows in said.items():
        morc = make.learner(tricked, EAGER, 1, percepts=percepts)
        for index in range(len(table.objects)):
            trial = morc.ask(make.task(table, index))
            felt = [s.observation for s in trial.steps if s.observation is not None]
            assert len(felt) == (4 if percepts == "recorded" else 12)
            rows += [row == trial.truth for row in felt]
    assert np.mean(said["recorded"]) == 0.5  # yes to all, and half of the labels are true
    assert np.mean(said["model"]) > 0.9


class TestPreparing:
    def test_the_paper_s_agent_has_eq_8_and_a_uniform_prior(self, table, make):
        momdp = make.learner(table, fast("morc"), 0).problem(make.task(table, 1))
        assert np.isinf(momdp.precision).all()
        assert momdp.n_classes == 2
        np.testing.assert_array_equal(momdp.prior, 0.5)
        assert momdp.discount == 0.99

    def test_ours_has_objects_that_differ_and_base_rates(self, table, make):
        morc = make.learner(table, fast("bayes"), 0)
        momdp = morc.problem(make.task(table, 1, "heavy"))
        assert np.isfinite(momdp.precision[:, :2]).all()
        np.testing.assert_array_equal(momdp.prior, morc.knowledge(table.objects[1]).base_rates[[1]])
        assert momdp.query.attributes == ("heavy",)

    def test_attributes_keep_the_query_s_order(self, table, make):
        morc = make.learner(table, fast("bayes"), 0)
        problem = morc.problem(make.task(table, 1, "red", "heavy"))
        reversed_problem = morc.problem(make.task(table, 1, "heavy", "red"))
        np.testing.assert_array_equal(problem.confusion, reversed_problem.confusion[::-1])
        np.testing.assert_array_equal(problem.prior, reversed_problem.prior[::-1])


def test_what_nobody_labelled_is_asked_but_not_judged(table, make):
    labels = np.array(table.labels)
    labels[2, 1] = -1
    morc = make.learner(dataclasses.replace(table, labels=labels), fast("predefined"), 0)
    assert morc.ask(make.task(table, 2, "red")).truth.shape == (1,)
    trial = morc.ask(make.task(table, 2))
    np.testing.assert_array_equal(trial.truth, [table.labels[2, 0], -1])
    assert trial.success is None
    assert trial.report is not None
    assert np.isnan(trial.reward)
    assert trial.cost > 0


class TestNames:
    @pytest.mark.parametrize(("n", "budget"), [(1, 50), (2, 80), (3, 80), (9, 80)])
    def test_random_legal_s_budget_goes_by_the_attributes(self, make, n, budget):
        table = make.table("ispy32")
        task = make.task(table, 0, *table.domain.attributes[:n])
        solver = load_agent("random_legal").solver(table.domain, task.query)
        assert solver == RandomLegal(budget, barred=("ask",))  # it explores, and asks nobody

    def test_predefined_sequences_are_the_domain_s(self, table, make):
        task = make.task(table, 0)
        plain, plus = (
            load_agent(name).solver(table.domain, task.query)
            for name in ("predefined", "predefined_plus")
        )
        assert plain == Predefined(("look", "lift"))
        assert plus == Predefined(("look", "lift"), persistent=True)


@pytest.mark.parametrize("agent", ["morc", "morc_itrs", "bayes", "olfc", "greedy"])
def test_free_behaviors_that_say_nothing_are_not_used(make, table, agent):
    behaviors = tuple(replace(each, cost=0.0) for each in table.domain.behaviors)
    shown = table.training_bins.sum(axis=-1, keepdims=True)  # all of them in one bin
    same = shown * (np.arange(table.training_bins.shape[-1]) == 4)
    log_odds = np.where(np.isnan(table.log_odds), np.nan, 1.0)
    free = replace(
        table, domain=replace(table.domain, behaviors=behaviors), log_odds=log_odds,
        training_bins=same.astype(np.uint8),
    )  # fmt: skip
    learner = make.learner(free, agent, percepts="model")
    for n in (1, 2):
        assert len(learner.ask(make.task(free, 0, *free.domain.attributes[:n])).steps) == 1


# Agents that explore otherwise, but plan as bayes does.
PLAN_AS_BAYES = [name for name in AGENTS if "bayes" in name and name != "bayes"]


@pytest.mark.quick(4)
@pytest.mark.parametrize("trials", [4, pytest.param(16, marks=pytest.mark.long)])
@pytest.mark.parametrize("signal", [0.0, 2.0])
@pytest.mark.parametrize("name", AGENTS)
def test_nothing_illegal_is_commanded(make, name, signal, trials):
    """A session refuses what is not legal, by `MOMDP.check_action`."""
    table = make.table("ispy32", signal=signal)
    learner = make.learner(table, name)
    tasks = range(0, 48, 3)[:trials]
    if name in PLAN_AS_BAYES and trials > 4:
        tasks = tasks[PLAN_AS_BAYES.index(name) % 3 :: 3]  # each a third of them, another one
    for index in tasks:
        n = 1 + 2 * (index % 2)
        task = make.task(table, index // 2 % 8, *table.domain.attributes[index // 16 :][:n])
        trial = learner.ask(task)
        assert trial.last_belief.x == trial.momdp.terminal


@pytest.fixture(scope="module")
def ragged():
    """Take ROC36's percepts of look away from every object, and all but one of every tap."""
    table = load_percepts("roc36")
    look, tap = (table.domain.behavior_index(name) for name in ("look", "tap"))
    log_odds = table.log_odds.copy()
    counts = table.recording_counts.copy()
    log_odds[:, :, look] = np.nan
    log_odds[:, 1:, tap] = np.nan
    counts[:, look] = 0
    counts[:, tap] = 1
    return replace(table, log_odds=log_odds, recording_counts=counts)


@pytest.mark.parametrize("agent", ["random_legal", "predefined_plus", "greedy"])
def test_what_was_not_recorded_is_not_perceived(make, ragged, agent):
    learner = make.learner(ragged, agent)
    executed = 0
    for task in offline_tasks(ragged, 1, 6, 0):
        trial = learner.ask(task)
        names = [trial.momdp.action_name(step.decision.action) for step in trial.steps]
        pairs = zip(names, trial.steps, strict=True)
        seen = [name for name, step in pairs if step.observation is not None]
        assert "look" not in seen
        assert seen.count("tap") <= 1
        executed += names.count("look")
        assert trial.momdp.limit[ragged.domain.behavior_index("tap")] == 1
    assert executed


TABLE = load_percepts("roc36")
WEIGHT = read_query("weight", TABLE.domain)


def run(agent, query, o):
    name = TABLE.objects[o]
    learner = Learner("roc36", agent=agent, logs=None).fit(TABLE)
    return learner.ask(Task("weight?", query, o, name, ("groups", name)), None)


@pytest.mark.quick(6)
@pytest.mark.parametrize("agent", sorted(AGENTS))
def test_every_agent_reports_one_value(agent, tmp_path):
    trial = run(agent, WEIGHT, 7)
    assert trial.report is None or trial.report.sum() == 1
    assert trial.last_belief.positive.sum() == pytest.approx(1)
    path = tmp_path / "groups.mcap"
    write_trials(path, [trial], header={})
    (logged,) = read_trials(path)
    assert logged.task == trial.task
    assert logged.momdp.query.groups == WEIGHT.groups
    np.testing.assert_array_equal(logged.last_belief.joint, trial.last_belief.joint)
    assert TrialOutcomes.of([logged]).success == TrialOutcomes.of([trial]).success


def test_the_answer_is_the_value():
    learner = Learner("roc36", logs=None).fit(TABLE)
    trial = learner.ask("What is its weight?", "heavy_blue_beans")
    assert trial.success
    assert trial.task.query.report_name(trial.report) == "heavy"
    assert "heavy (right)" in repr(trial)


@pytest.mark.long
def test_known_values_end_a_trial_sooner_than_attributes_that_seem_independent():
    alone = Query(WEIGHT.attributes)
    pairs = [(run("olfc", WEIGHT, o), run("olfc", alone, o)) for o in range(0, 36, 3)]
    assert all(grouped.success and separate.success for grouped, separate in pairs)
    assert sum(grouped.cost for grouped, _ in pairs) < sum(separate.cost for _, separate in pairs)


def test_truth_of_two_values_is_refused():
    domain = TABLE.domain
    with pytest.raises(QueryError, match="exactly one"):
        Learner(domain, logs=None).begin("weight", truth={"heavy": True, "light": True})
    with pytest.raises(QueryError, match="exactly one"):
        Learner(domain, logs=None).begin("weight", truth=[1, 1, 0])


def test_tables_of_independent_attributes_refuse_groups():
    confusion = np.full((3, len(TABLE.domain.behaviors), 2, 2), 0.5)
    momdp = build_momdp(TABLE.domain, WEIGHT, confusion, objective=Objective())
    with pytest.raises(SettingsError, match="without a group"):
        Factored().solve(momdp, np.random.default_rng(0))

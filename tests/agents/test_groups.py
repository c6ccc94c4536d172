"""Trials that ask for the value of a group."""

import numpy as np
import pytest

from meal_bayes import Learner, load_percepts
from meal_bayes.agents import AGENTS
from meal_bayes.domain import Query, read_query
from meal_bayes.errors import QueryError, SettingsError
from meal_bayes.momdp import Objective, build_momdp
from meal_bayes.planners import Factored
from meal_bayes.trial_log import read_trials, write_trials
from meal_bayes.trials import Task, TrialOutcomes

TABLE = load_percepts("roc36")
WEIGHT = read_query("weight", TABLE.domain)


def run(agent, query, o):
    name = TABLE.objects[o]
    learner = Learner("roc36", agent=agent, logs=None).fit(TABLE)
    return learner.ask(Task("weight?", query, o, name, ("groups", name)), None)


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


def test_known_values_end_a_trial_sooner_than_attributes_that_seem_independent():
    alone = Query(WEIGHT.attributes)
    pairs = [(run("olfc", WEIGHT, o), run("olfc", alone, o)) for o in range(0, 36, 3)]
    assert all(one.success and other.success for one, other in pairs)
    assert sum(one.cost for one, _ in pairs) < sum(other.cost for _, other in pairs)


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

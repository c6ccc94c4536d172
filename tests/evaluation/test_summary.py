"""Measures and comparisons of agents, by hand, and by the hierarchical model of outcomes."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import compare, estimate_mean, summarize
from meal_bayes.evaluation.outcome_model import Cells, compare_outcomes
from meal_bayes.evaluation.summary import no_better_than_prior
from meal_bayes.momdp import belief_of, build_momdp, initial_belief
from meal_bayes.planners import unvalued
from meal_bayes.trials import Step, Task, Trial, TrialOutcomes

DOMAIN = load_domain("toy")
QUERY = Query(("red", "heavy"))
MOMDP = build_momdp(DOMAIN, QUERY, np.full((2, 3, 2, 2), 0.5))


def trial(agent, positive, truth, report, cost=5.0, object_index=0, key=0):
    """A trial of one behavior, then the report (None: it abstained)."""
    first = initial_belief(MOMDP)
    weight = np.log(np.stack([1 - np.array(positive), positive], axis=1))
    belief = belief_of(MOMDP, 0, weight, first.percept_counts)
    steps = [Step(0, unvalued(MOMDP, 1), 0, None, cost, -cost, belief)]
    if report is not None:
        reward = 100.0 if list(report) == list(truth) else -100.0
        action = MOMDP.n_behaviors + QUERY.index_of(report)
        steps.append(Step(0, unvalued(MOMDP, action), 2, None, 0.0, reward, belief))
    task = Task(f"task-{key}", QUERY, object_index, f"object {object_index}", ("toy", key))
    return Trial(task, agent, MOMDP, first, tuple(steps), np.array(truth), report)


TRIALS = [
    trial("bayes", [0.9, 0.2], [True, False], [True, False], 5.0, 0, 0),
    trial("morc", [0.6, 0.6], [True, False], [True, True], 7.0, 0, 0),
    trial("bayes", [0.7, 0.4], [True, True], [True, False], 1.0, 1, 1),
    trial("morc", [0.5, 0.5], [True, True], None, 9.0, 1, 1),
]


def test_measures_by_hand():
    row, other = summarize(TRIALS, seconds={"bayes": 3.5})
    assert (row.agent, other.agent) == ("bayes", "morc")
    assert (row.trials, row.accuracy, row.answered_accuracy) == (2, 0.5, 0.5)
    assert row.accuracy_se == pytest.approx(0.5)
    assert (row.cost_s, row.cost_sd) == (3.0, pytest.approx(math.sqrt(8)))
    assert row.reward == pytest.approx((95 - 101) / 2)
    assert row.reward_se == pytest.approx(98.0)
    assert row.nll == pytest.approx(-np.log([0.9, 0.8, 0.7, 0.4]).mean())
    assert row.brier == pytest.approx(np.mean([0.01, 0.04, 0.09, 0.36]))
    assert row.ece == pytest.approx((0.1 + 0.2 + 0.3 + 0.6) / 4)
    assert 0 < row.ece_calibrated < 1
    assert row.abstained == 0.0
    assert row.seconds == 3.5


def test_abstentions_are_not_right_and_stand_beside():
    row = summarize(TRIALS)[1]
    assert (row.accuracy, row.abstained, row.answered_accuracy) == (0.0, 0.5, 0.0)
    assert row.reward == pytest.approx((-107 - 9) / 2)
    alone = summarize(TRIALS[3:])[0]
    assert math.isnan(alone.answered_accuracy)


def test_trials_broken_off_enter_no_measure():
    broken = replace(TRIALS[0], ended="robot error: OSError", report=None, steps=TRIALS[1].steps)
    row, without = (summarize([TRIALS[0], TRIALS[2], *more])[0] for more in ([broken], []))
    assert (row.trials, without.trials) == (3, 2)
    assert row.as_dict() | {"trials": 2} == without.as_dict()
    assert math.isnan(estimate_mean(TrialOutcomes.of([broken]), "cost").estimate)


def test_agents_that_earn_no_more_than_the_prior_are_named():
    right = [True, True]
    wrong = [False, False]
    trials = []
    for n in range(8):
        trials.append(trial("prior", [0.6, 0.6], right, right if n % 2 else wrong, 0.0, n, n))
        trials.append(trial("sure", [0.9, 0.9], right, right, 1.0, n, n))
        trials.append(trial("slow", [0.6, 0.6], right, right if n % 2 else wrong, 30.0, n, n))
    said = no_better_than_prior(TrialOutcomes.of(trials))
    assert "slow (-30.0 [" in said
    assert "sure" not in said
    assert no_better_than_prior(TrialOutcomes.of(TRIALS)) == ""


def test_rows_are_json():
    row = summarize(TRIALS[3:])[0].as_dict()
    assert row["answered_accuracy"] is None
    assert row["accuracy_se"] is None
    assert row["seconds"] is None
    assert json.loads(json.dumps(row, allow_nan=False)) == row


def test_agents_are_compared_on_shared_tasks():
    extra = trial("bayes", [0.9, 0.9], [True, True], [True, True], 3.0, 2, 2)  # morc has none
    difference = compare([*TRIALS, extra], "bayes", "morc")
    assert difference.estimate == pytest.approx(((95 + 107) + (-101 + 9)) / 2)
    assert difference.low < difference.estimate < difference.high
    assert compare(TRIALS, "bayes", "morc", measure="cost").estimate == pytest.approx(-5.0)
    assert compare(TRIALS, "bayes", "morc", measure="success").estimate == pytest.approx(0.5)


def test_what_cannot_be_compared_is_refused():
    with pytest.raises(SettingsError, match="'bayes' share no task with a reward"):
        compare(TRIALS, "bayes", "greedy")
    with pytest.raises(SettingsError, match="Unknown measure 'speed'"):
        estimate_mean(TrialOutcomes.of(TRIALS), "speed")


def test_outcomes_are_summarized_and_compared_as_their_trials_are():
    outcomes = TrialOutcomes.of(TRIALS)
    rows = [[row.as_dict() for row in summarize(each)] for each in (outcomes, TRIALS)]
    assert rows[0] == rows[1]  # nan is None there
    assert estimate_mean(outcomes, "abstained").estimate == 0.25
    for measure in ("reward", "cost", "success", "abstained"):
        difference = compare(outcomes, "bayes", "morc", measure=measure)
        assert difference == compare(TRIALS, "bayes", "morc", measure=measure)


OBJECTS = 24


def simulated(rng, *, lead=0.0, agents=3, trials=150):
    """Draw trials of agents on the same tasks; the last one leads on the logistic scale."""
    agent, task = np.divmod(np.arange(agents * trials), trials)
    thing = rng.integers(OBJECTS, size=trials)[task]
    asked = rng.integers(6, size=(trials, 1))[task]
    shift = lead * (agent == agents - 1)
    objects = rng.normal(size=OBJECTS)
    pairs = 0.4 * rng.normal(size=(agents, OBJECTS))
    eta = 0.8 + shift + objects[thing] + pairs[agent, thing]
    right = rng.random(len(eta)) < 1 / (1 + np.exp(-eta))
    cost = 20 - 5 * shift + 3 * objects[thing] + 6 * rng.normal(size=len(eta))
    nothing = np.zeros((len(eta), 0), int)
    return TrialOutcomes(
        behaviors=(), agent=np.array([f"agent {a}" for a in agent], object),
        key=task.astype(str), object_index=thing, object_name=thing.astype(str),
        attribute=asked.astype(str), truth=np.ones((len(eta), 1)), report=right[:, None],
        positive=np.full((len(eta), 1), 0.5), cost=cost, reward=cost, ended=np.full(len(eta), ""),
        steps=np.zeros(len(eta)), executed=nothing, failed=nothing,
    )  # fmt: skip


def test_cells_keep_the_sums_of_trials():
    outcomes = simulated(np.random.default_rng(0))
    cells = Cells.of(outcomes, "success")
    assert cells.trials.sum() == len(outcomes)
    assert cells.total.sum() == outcomes.success.sum()
    assert len(cells.trials) < len(outcomes)
    assert set(cells.terms) == {"agent", "object", "attribute", "agent object",
                                "agent attribute"}  # fmt: skip
    first = cells.terms["agent"] == 0
    assert cells.trials[first].sum() == (outcomes.agent == cells.agents[0]).sum()


@pytest.mark.long
@pytest.mark.parametrize("measure", ["success", "cost"])
def test_a_leader_is_found_and_an_equal_one_is_not(measure):
    outcomes = simulated(np.random.default_rng(1), lead=1.2)
    rows = compare_outcomes(outcomes, measure=measure, draws=300, by_attributes=True)
    equal, ahead = rows[:2]
    assert [row.attributes for row in rows] == ["", "", *np.repeat([*"012345"], 2)]
    assert sum(row.trials for row in rows[2:]) == equal.trials + ahead.trials
    effects, plain = np.array([(row.effect, row.plain) for row in rows[3::2]]).T
    assert effects.std() < 0.7 * plain.std()  # shrunk towards each other
    assert ahead.ahead > 0.95
    assert ahead.equivalent < 0.2
    assert 0.02 < equal.ahead < 0.98
    assert abs(ahead.effect) < abs(ahead.plain) * 1.2


def test_outcomes_that_cannot_be_compared_are_refused():
    outcomes = simulated(np.random.default_rng(2))
    with pytest.raises(SettingsError, match="two or more"):
        compare_outcomes(outcomes.of_agent("agent 0"))
    with pytest.raises(SettingsError, match="reference 'nobody'"):
        compare_outcomes(outcomes, reference="nobody")
    with pytest.raises(SettingsError, match="Unknown measure 'luck'"):
        compare_outcomes(outcomes, measure="luck")

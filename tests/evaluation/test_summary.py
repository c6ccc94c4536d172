"""Measures and comparisons of agents, by hand."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import compare, comparisons, estimate_mean, summarize
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


def test_rounding_puts_no_agent_ahead():
    trials = []
    for n, costs in enumerate([(0.1 + 0.2 + 0.3, 0.3 + 0.2 + 0.1), (0.7, 0.1 + 0.6)]):
        for name, cost in zip("ab", costs, strict=True):
            trials.append(trial(name, [0.9, 0.9], [True, True], [True, True], cost, n, n))
    outcomes = TrialOutcomes.of(trials)
    (row,) = comparisons(outcomes, measure="cost", reference="a")
    assert row.difference != 0
    assert row.verdict == "cannot be said"


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


def tasks_of(agent, rewards, costs):
    """Make a trial of each task, about objects of their own, right where the reward is above 0."""
    n = len(rewards)
    return TrialOutcomes(
        behaviors=(), agent=np.full(n, agent, object), key=np.arange(n).astype(str),
        object_index=np.arange(n), object_name=np.arange(n).astype(str),
        attribute=np.full((n, 1), "red", object), truth=np.ones((n, 1)),
        report=(np.asarray(rewards) > 0)[:, None], positive=np.full((n, 1), 0.5),
        cost=np.asarray(costs, float), reward=np.asarray(rewards, float),
        ended=np.full(n, "", object), steps=np.zeros(n), executed=np.zeros((n, 0), int),
        failed=np.zeros((n, 0), int),
    )  # fmt: skip


@pytest.mark.parametrize("measure", ["reward", "cost", "success", "abstained"])
@pytest.mark.parametrize("seed", range(10))
def test_a_verdict_is_the_side_of_0_on_which_the_paired_interval_lies(measure, seed):
    rng = np.random.default_rng(seed)
    luck = rng.normal(size=60)
    parts = [
        tasks_of(name, luck + lead + rng.normal(size=60), 5 - lead + rng.normal(size=60))
        for name, lead in (("morc", 0.0), ("bayes", rng.choice([-2.0, -0.3, 0.0, 0.3, 2.0])))
    ]
    trials = TrialOutcomes.join(parts)
    (row,) = comparisons(trials, measure=measure)
    pair = compare(trials, "bayes", "morc", measure=measure)
    assert (row.agent, row.reference, row.tasks) == ("bayes", "morc", 60)
    assert (row.difference, row.low, row.high) == (pair.estimate, pair.low, pair.high)
    better = -1 if measure in ("cost", "abstained") else 1
    sides = {1: "ahead", -1: "behind", 0: "cannot be said"}
    assert row.verdict == sides[better * (int(pair.low > 0) - int(pair.high < 0))]
    (back,) = comparisons(trials, measure=measure, reference="bayes")
    turned = {"ahead": "behind", "behind": "ahead"}
    assert back.verdict == turned.get(row.verdict, row.verdict)
    assert ("cannot be said" in str(row)) == (row.verdict == "cannot be said")


def test_agents_without_a_common_task_cannot_be_compared():
    other = replace(TrialOutcomes.of(TRIALS[1::2]), key=np.array(["a", "b"], object))
    (row,) = comparisons(TrialOutcomes.join([TrialOutcomes.of(TRIALS[::2]), other]))
    assert (row.tasks, row.verdict) == (0, "cannot be said")
    assert row.as_dict()["difference"] is None
    assert "share no task" in str(row)


def test_comparisons_without_two_agents_or_the_reference_are_refused():
    with pytest.raises(SettingsError, match="two or more"):
        comparisons(TRIALS[::2])
    with pytest.raises(SettingsError, match="reference 'nobody'"):
        comparisons(TRIALS, reference="nobody")
    with pytest.raises(SettingsError, match="Unknown measure 'luck'"):
        comparisons(TRIALS, measure="luck")

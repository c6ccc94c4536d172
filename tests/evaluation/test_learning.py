"""Learning curves: known answers on made-up ones."""

import json
import math

import numpy as np
import pytest

from meal_bayes.evaluation import expected_calibration_error
from meal_bayes.evaluation.learning import (
    curves_of,
    decided,
    difference_at,
    learning_rows,
    mean_until,
    summarize_learning,
)
from meal_bayes.trials import BatchOutcomes, TrialOutcomes

TRIALS = 200
RISING = (0.5, 0.6, 0.7, 0.8, 0.8, 0.8)


def outcomes_of(success, *, cost=10.0, positive=0.8, objects=20):
    """Trials about one attribute that is said to be true; success (n,) is its truth."""
    right = np.asarray(success, bool)
    n = len(right)
    k = np.arange(n)
    column = np.full((n, 1), "red", object)
    ones = np.ones((n, 1))
    return TrialOutcomes(
        behaviors=(), agent=np.full(n, "some", object), key=np.array([f"[{i}]" for i in k], object),
        object_index=k % objects, object_name=np.array([f"o{i}" for i in k % objects], object),
        attribute=column, truth=right[:, None].astype(np.int8), report=ones.astype(np.int8),
        positive=np.broadcast_to(positive, n)[:, None] * ones, cost=np.broadcast_to(cost, n) * 1.0,
        reward=np.where(right, 300.0, -300.0) - cost, ended=np.full(n, "", object),
        steps=np.ones(n, int), executed=np.zeros((n, 0), int), failed=np.zeros((n, 0), int),
    )  # fmt: skip


def outcomes_at(accuracy, **options):
    """Trials of which exactly this share is right."""
    return outcomes_of(np.arange(TRIALS) < round(accuracy * TRIALS), **options)


def curve(agent, accuracies, *, hours=1.0, repeats=3, **options):
    """Return a curve of one point every so many hours, the same in every repeat."""
    return [
        BatchOutcomes(agent, repeat, batch, batch * hours, outcomes_at(accuracy, **options))
        for repeat in range(repeats)
        for batch, accuracy in enumerate(accuracies)
    ]


@pytest.mark.parametrize(
    ("hours", "values", "end", "expected"),
    [
        ([0, 1, 2], [0, 2, 4], 1.5, 1.5),
        ([0, 1], [0, 2], 3.0, (1 + 2 * 2) / 3),  # who explored less stays where it was
        ([0, 0.5, 3], [1, 2, 2], 1.0, (0.75 + 1.0)),
        ([0, 1], [7, 9], 0.0, 7.0),
        ([0, 0, 0], [7, 7, 7], 2.0, 7.0),
    ],
)
def test_the_mean_of_a_curve_over_its_first_hours(hours, values, end, expected):
    mean = mean_until(np.array(hours, float), np.array(values, float), end)
    assert mean == pytest.approx(expected)


class TestSummary:
    def test_a_faster_agent_has_the_area_between_the_curves(self):
        line = (0.5, 0.6, 0.7, 0.8)  # 600 of reward for all, over 3 hours
        base, bayes = summarize_learning([*curve("slow", line), *curve("fast", line, hours=0.5)])
        assert base.area_hours == bayes.area_hours == pytest.approx(3.0)
        # over the first 1.5 hours from 0 to 90 ahead, over the rest from 90 to 0: 45 in the mean
        assert bayes.area_reward_difference == pytest.approx(45.0)
        assert (bayes.area_low, bayes.area_high) == pytest.approx((45.0, 45.0))
        assert bayes.reward_after_difference == pytest.approx(0.0)
        assert base.area_reward_difference == base.reward_after_difference == 0

    def test_the_first_agent_is_the_reference(self):
        results = [*curve("one", RISING), *curve("other", RISING, cost=8.0)]
        assert [r.area_reward_difference for r in summarize_learning(results)] == [0, 2]

    def test_intervals_are_of_pairs_and_of_splits_of_the_same_objects(self):
        gains = np.array([0.0, 0.05, 0.1])
        results = [
            BatchOutcomes(agent, repeat, batch, batch, outcomes_at(0.5 + 0.1 * repeat + gain))
            for agent, by in (("iterative_morc", 0 * gains), ("bayes", gains))
            for repeat, gain in enumerate(by)
            for batch in range(3)
        ]
        bayes = summarize_learning(results)[1]
        reach = 4.303 * 30 * math.sqrt(1 / 3 + 0.5)  # t of two degrees, differences of 0, 30, 60
        assert bayes.area_reward_difference == pytest.approx(30)
        assert bayes.area_high - bayes.area_low == pytest.approx(2 * reach, rel=1e-3)
        assert bayes.accuracy_after == pytest.approx(0.65)

    def test_only_shared_repeats_are_compared(self):
        base = curve("iterative_morc", RISING, repeats=2)
        more = [
            *curve("bayes", RISING, repeats=2, cost=8.0),
            *(b._replace(repeat=7) for b in curve("bayes", (0.5,) * 6, repeats=1)),
        ]
        bayes = summarize_learning([*base, *more])[1]
        assert bayes.area_reward_difference == bayes.reward_after_difference == pytest.approx(2)
        assert bayes.accuracy_after == pytest.approx((0.8 + 0.8 + 0.5) / 3)


def test_rewards_at_budgets_are_read_off_the_curves():
    base = curves_of(curve("slow", RISING), "slow")
    fast = curves_of(curve("fast", RISING, hours=0.5), "fast")
    assert difference_at(fast, base, 0.0).estimate == pytest.approx(0.0)
    assert difference_at(fast, base, 1.0).estimate == pytest.approx(60.0)


def test_nothing_is_said_of_hours_that_nobody_explored():
    short = curve("short", RISING, hours=0.2)
    long = curve("long", RISING, hours=1.0)
    base = curves_of(long, "long")
    fast = curves_of(short, "short")
    assert not math.isnan(difference_at(fast, base, 1.0).estimate)  # where the short one ends
    for first, second in ((fast, base), (base, fast)):
        assert math.isnan(difference_at(first, second, 1.01).estimate)
    one_ends = fast | {2: fast[2] * np.array([[0.5], [1.0]])}
    assert math.isnan(difference_at(one_ends, base, 0.9).estimate)
    row = summarize_learning([*long, *short])[1]
    assert [hours for hours, value in row.as_dict()["reward_difference_at"].items()
            if value is not None] == ["0.5", "1"]  # fmt: skip


def test_a_run_is_decided_when_every_interval_excludes_0():
    better = curve("better", (0.9,) * 6)
    same = curve("same", RISING)
    assert decided([*curve("base", RISING), *better], 10)
    assert not decided([*curve("base", RISING), *better, *same], 10)
    once = [*curve("base", RISING, repeats=1), *curve("b", (0.9,) * 6, repeats=1)]
    assert not decided(once, 10)


def test_rows_measure_each_batch():
    rows = learning_rows(curve("bayes", (0.5, 0.75), repeats=2, positive=0.75))
    assert [(row.repeat, row.batch) for row in rows] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    last = rows[1]
    assert (last.hours, last.accuracy, last.test_cost_s) == (1.0, 0.75, 10.0)
    assert last.reward == pytest.approx(300 * 0.75 - 300 * 0.25 - 10)
    assert last.certainty == pytest.approx(0.75)
    assert last.ece == pytest.approx(0.0, abs=1e-9)  # three quarters are true
    assert rows[0].ece == pytest.approx(0.25)
    assert last.nll == pytest.approx(-0.75 * math.log(0.75) - 0.25 * math.log(0.25))


def test_all_fields_are_plain_json():
    results = curve("bayes", (0.5, 0.8), repeats=1, objects=1)  # no errors, no interval
    assert learning_rows(results)[0].as_dict()["accuracy_se"] is None
    (summary,) = summarize_learning(results)
    told = json.loads(json.dumps(summary.as_dict(), allow_nan=False))
    assert {name for name, value in told.items() if value is None} == {"area_low", "area_high"}


@pytest.mark.statistical
@pytest.mark.parametrize(("wrong_by", "excess"), [(0.0, 0.0), (0.2, 0.15)])
def test_pooled_ece_shows_miscalibration_only(wrong_by, excess):
    rng = np.random.default_rng(0)
    results = []
    beliefs = []
    for repeat in range(10):
        belief = rng.uniform(0.25, 0.75, TRIALS)
        trials = outcomes_of(rng.random(TRIALS) < belief + wrong_by, positive=belief)
        results += [BatchOutcomes("bayes", repeat, batch, batch, trials) for batch in (8, 9, 10)]
        early = outcomes_at(0.0, positive=1.0)  # too early to count
        results.append(BatchOutcomes("bayes", repeat, 7, 7, early))
        beliefs += [belief] * 3
    (summary,) = summarize_learning(results)
    calibrated = expected_calibration_error(np.concatenate(beliefs), rng, draws=20)
    assert 0 < calibrated < 0.05
    assert summary.ece_after - calibrated == pytest.approx(excess, abs=0.05)
    assert summary.ece_after > excess

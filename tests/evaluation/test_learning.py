"""Learning curves: known answers on made-up ones."""

import json
import math

import numpy as np
import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import (
    curves_of,
    hours_to,
    learning_rows,
    pooled_ece,
    summarize_learning,
)
from meal_bayes.trial_log import BatchOutcomes, TrialOutcomes

TRIALS = 200
ROW = {
    "agent", "batch", "repeat", "exploration_hours", "accuracy", "accuracy_se", "test_cost_s",
    "reward", "nll", "ece", "claimed_accuracy",
}  # fmt: skip


def outcomes_of(success, belief, *, cost=10.0, objects=20):
    """Trials that all report "true"; it is right in those of `success`, (n,)."""
    k = np.arange(len(success))
    none = np.zeros((len(k), 0), int)
    return TrialOutcomes(
        behaviors=(), agent=["bayes"] * len(k), key=k.astype(str), object_index=k % objects,
        object_name=(k % objects).astype(str), attribute=[["red"]] * len(k),
        truth=np.reshape(success, (-1, 1)), report=np.ones((len(k), 1)),
        positive=np.broadcast_to(np.reshape(belief, (-1, 1)), (len(k), 1)),
        cost=np.full(len(k), cost), reward=np.where(success, 300.0, -300.0) - cost,
        ended=[""] * len(k), steps=np.ones(len(k)), executed=none, failed=none,
    )  # fmt: skip


def trials_of(accuracy, *, belief=0.8, **options):
    """Trials of which exactly this fraction is right; the belief in yes is the same in all."""
    return outcomes_of(np.arange(TRIALS) < round(accuracy * TRIALS), belief, **options)


def curve(agent, accuracies, *, hours=1.0, repeats=3, **options):
    """A curve of one point every so many hours, the same in every repeat."""
    return [
        BatchOutcomes(agent, repeat, batch, batch * hours, trials_of(accuracy, **options))
        for repeat in range(repeats)
        for batch, accuracy in enumerate(accuracies)
    ]


RISING = (0.5, 0.6, 0.7, 0.8, 0.8, 0.8)


@pytest.mark.parametrize(
    ("hours", "accuracy", "level", "expected"),
    [
        ([0, 1, 2], [0.5, 0.7, 0.9], 0.6, 0.5),
        ([0, 1, 2], [0.5, 0.7, 0.9], 0.9, 2.0),
        ([0, 1, 2], [0.5, 0.7, 0.9], 0.91, math.inf),
        ([0, 1, 2], [0.5, 0.7, 0.9], 0.4, 0.0),
        ([0, 2, 4, 6], [0.4, 0.8, 0.6, 0.9], 0.7, 2.0),  # 0.8, 0.6 become 0.7, 0.7
        ([0, 2, 4, 6], [0.4, 0.8, 0.6, 0.9], 0.8, 5.0),
        ([0, 1, 3], [0.5, 0.5, 0.9], 0.7, 2.0),
    ],
)
def test_hours_to_a_level(hours, accuracy, level, expected):
    found = hours_to(np.array(hours, float), np.array(accuracy), level)
    assert found == pytest.approx(expected)


class TestSummary:
    @pytest.mark.parametrize("speed", [0.5, 1.0, 2.0, 5.0])
    def test_a_faster_agent_has_the_ratio_of_its_speed(self, speed):
        results = [
            *curve("iterative_morc", RISING),
            *curve("bayes", RISING, hours=1 / speed, cost=8.0),
        ]
        base, bayes = summarize_learning(results)
        assert bayes.hours_ratio == pytest.approx(speed)
        assert (bayes.hours_ratio_low, bayes.hours_ratio_high) == pytest.approx((speed, speed))
        assert base.hours_ratio == pytest.approx(1.0)
        assert bayes.exploration_hours == pytest.approx(5 / speed)
        assert bayes.accuracy_difference == pytest.approx(0.0)
        assert bayes.reward_difference == pytest.approx(2.0)
        assert bayes.reward_difference_se == pytest.approx(0.0, abs=1e-9)

    def test_who_never_gets_there_has_ratio_0(self):
        results = [*curve("iterative_morc", RISING), *curve("poor", (0.5,) * 6)]
        assert summarize_learning(results)[1].hours_ratio == 0.0

    def test_who_needs_no_training_is_faster_by_far_and_the_reference_is_itself(self):
        results = [*curve("iterative_morc", RISING), *curve("born_wise", (0.9,) * 6)]
        assert summarize_learning(results)[1].hours_ratio >= 1000
        flat = summarize_learning(curve("iterative_morc", (0.8,) * 6))
        assert flat[0].hours_ratio == 1.0

    def test_differences_are_paired_by_repeat(self):
        results = [
            BatchOutcomes(agent, repeat, batch, batch, trials_of(0.5 + 0.1 * repeat + more))
            for agent, more in (("iterative_morc", 0.0), ("bayes", 0.05))
            for repeat in range(4)
            for batch in range(4)
        ]
        bayes = summarize_learning(results)[1]
        assert bayes.accuracy_difference == pytest.approx(0.05)
        assert bayes.accuracy_difference_se == pytest.approx(0.0, abs=1e-9)
        assert bayes.reward_difference == pytest.approx(0.05 * 600)

    def test_only_shared_repeats_are_compared(self):
        base = curve("iterative_morc", RISING, repeats=2)
        more = [
            *curve("bayes", RISING, hours=0.5, repeats=2),
            *(b._replace(repeat=7) for b in curve("bayes", (0.5,) * 6, repeats=1)),
        ]
        bayes = summarize_learning([*base, *more])[1]
        assert bayes.repeats == 3
        assert bayes.hours_ratio == pytest.approx(2.0)
        assert bayes.accuracy == pytest.approx((0.8 + 0.8 + 0.5) / 3)

    def test_without_the_reference_nothing_is_compared(self):
        (row,) = summarize_learning(curve("bayes", RISING))
        assert math.isnan(row.hours_ratio)
        assert row.as_dict()["hours_ratio"] is None
        assert row.accuracy == pytest.approx(0.8)

    def test_torn_curves_are_refused(self):
        with pytest.raises(SettingsError, match="No whole learning curve of 'bayes'"):
            curves_of(curve("bayes", RISING)[:-1], "bayes")
        with pytest.raises(SettingsError, match="No whole learning curve of 'nobody'"):
            curves_of(curve("bayes", RISING), "nobody")


def test_rows_measure_each_batch():
    rows = learning_rows(curve("bayes", (0.5, 0.75), repeats=2, belief=0.75))
    assert [(row.repeat, row.batch) for row in rows] == [(0, 0), (0, 1), (1, 0), (1, 1)]
    last = rows[1]
    assert (last.exploration_hours, last.accuracy, last.test_cost_s) == (1.0, 0.75, 10.0)
    assert last.reward == pytest.approx(300 * 0.75 - 300 * 0.25 - 10)
    assert last.claimed_accuracy == pytest.approx(0.75)
    assert last.ece == pytest.approx(0.0, abs=1e-9)  # three quarters are true
    assert rows[0].ece == pytest.approx(0.25)
    assert last.nll == pytest.approx(-0.75 * math.log(0.75) - 0.25 * math.log(0.25))


def test_all_fields_are_plain_json():
    results = curve("bayes", (0.5, 0.8), repeats=1, objects=1)  # no errors, no comparison
    for row in learning_rows(results):
        told = json.loads(json.dumps(row.as_dict(), allow_nan=False))
        assert set(told) == ROW
        assert told["accuracy_se"] is None
    (summary,) = summarize_learning([*results])
    told = json.loads(json.dumps(summary.as_dict(), allow_nan=False))
    assert {name for name, value in told.items() if value is None} == {
        "hours_ratio", "hours_ratio_low", "hours_ratio_high", "accuracy_difference",
        "accuracy_difference_se", "reward_difference", "reward_difference_se",
    }  # fmt: skip


@pytest.mark.statistical
@pytest.mark.parametrize(("wrong_by", "excess"), [(0.0, 0.0), (0.2, 0.15)])
def test_pooled_ece_shows_miscalibration_only(wrong_by, excess):
    rng = np.random.default_rng(0)
    results = []
    for repeat in range(10):
        belief = rng.uniform(0.25, 0.75, TRIALS)
        found = outcomes_of(rng.random(TRIALS) < belief + wrong_by, belief)
        results += [BatchOutcomes("bayes", repeat, batch, batch, found) for batch in (8, 9, 10)]
        worst = trials_of(0.0, belief=1.0)
        results.append(BatchOutcomes("bayes", repeat, 7, 7, worst))  # too early to count
    error, calibrated = pooled_ece(results)
    assert 0 < calibrated < 0.05
    assert error - calibrated == pytest.approx(excess, abs=0.05)
    assert error > excess

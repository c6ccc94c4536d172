import math
from functools import partial

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import (
    brier,
    calibration_error,
    clustered,
    expected_calibration_error,
    negative_log_likelihood,
    paired_fractions,
    resampled,
)
from meal_bayes.evaluation.statistics import running_means, spent, wilson_interval

values = st.lists(st.floats(-100, 100), min_size=3, max_size=30)


@given(values, st.integers(1, 5))
def test_copies_within_a_cluster_are_no_new_cases(x, copies):
    clusters = np.repeat(np.arange(len(x)), copies)
    usual = np.std(x, ddof=1) / np.sqrt(len(x))
    assert clustered(np.repeat(x, copies), clusters).se == pytest.approx(usual, abs=1e-9)


@pytest.mark.parametrize("share", [(0, 1), (0, 0, 1), (0, 1, 1), (0, 0, 0, 0, 0, 0, 1)])
def test_equal_fractions_of_few_objects_are_not_certain(share):
    interval = clustered(share * 8, np.repeat(np.arange(8), len(share)), fraction=True).interval()
    assert interval.low < interval.estimate - 0.1
    assert interval.high > interval.estimate + 0.1


@given(values, st.data())
def test_running_means_are_those_of_every_beginning(x, data):
    """The curve of the viewer and the table of the report have one error bar."""
    clusters = data.draw(st.lists(st.integers(0, 4), min_size=len(x), max_size=len(x)))
    means, errors = running_means(x, clusters)
    for n in range(1, len(x) + 1):
        expected = clustered(x[:n], clusters[:n])
        assert means[n - 1] == pytest.approx(expected.estimate, abs=1e-9)
        assert errors[n - 1] == pytest.approx(expected.se, abs=1e-5, nan_ok=True)


def test_intervals_are_students():
    assert math.isnan(clustered([1, 2, 3], [7, 7, 7]).interval().low)
    interval = clustered([2, 1, 0], ["a", "b", "c"]).interval()
    assert interval[:2] == pytest.approx((1.0, 1 / math.sqrt(3)))
    reach = 4.302653 / math.sqrt(3)
    assert interval[2:] == pytest.approx((1 - reach, 1 + reach), rel=1e-6)


@pytest.mark.statistical
def test_clustered_intervals_cover():
    rng = np.random.default_rng(0)
    objects = np.repeat(np.arange(20), 8)
    covered = 0
    for _ in range(400):
        difference = rng.normal(size=20)[objects] + rng.normal(size=160)
        interval = clustered(difference, objects).interval()
        covered += interval.low < 0 < interval.high
    assert abs(covered / 400 - 0.95) < 5 * math.sqrt(0.95 * 0.05 / 400)


@given(st.integers(1, 200), st.data())
def test_wilson_holds_the_fraction(n, data):
    assert wilson_interval(81, 263)[2:] == pytest.approx((0.2553, 0.3662), abs=5e-5)
    hits = data.draw(st.integers(0, n))
    interval = wilson_interval(hits, n)
    assert 0 <= interval.low <= interval.estimate <= interval.high <= 1
    mirrored = wilson_interval(n - hits, n)
    assert mirrored.low == pytest.approx(1 - interval.high, abs=1e-12)


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: clustered([1, 2], [1]), "one for each"),
        (lambda: clustered([], []), "one for each"),
    ],
)
def test_wrong_input_teaches(call, says):
    with pytest.raises(SettingsError, match=says):
        call()


def test_intervals_of_splits_of_the_same_objects_cover_and_plain_ones_do_not():
    """Of two equal agents: objects differ, 34 of 100 are tested in each of 20 splits."""
    rng = np.random.default_rng(0)
    covered = np.zeros(2)
    for _ in range(400):
        gains = rng.normal(size=100)
        values = [gains[rng.permutation(100)[:34]].mean() for _ in range(20)]
        values += 0.02 * rng.normal(size=20)
        for i, effect in enumerate((resampled(values, 34 / 66), clustered(values, range(20)))):
            _, _, low, high = effect.interval()
            covered[i] += low <= 0 <= high
    assert 0.93 <= covered[0] / 400 <= 0.97
    assert covered[1] / 400 < 0.6


def test_intervals_of_proportions_stay_within_0_and_1():
    assert clustered([1] * 12, range(12), fraction=True).interval().high == 1.0
    assert clustered([1] * 12, range(12), fraction=True).interval().low < 0.8  # 12 are not many
    few = clustered([1] * 12, [0, 1, 2] * 4, fraction=True)  # three objects, however many trials
    assert few.interval().low < 0.3
    low = clustered([0, 0, 0, 0, 1, 0], range(6), fraction=True)
    assert 0 < low.interval().low < 1 / 6 < low.interval().high < 1


def test_looks_at_growing_data_keep_their_level():
    assert sum(spent(look) for look in range(1, 30)) <= 0.05


def test_calibration_error_by_hand():
    # Bins: .05 and .15 apart; 1.0 belongs to the last.
    positive = [0.05, 0.15, 0.15, 1.0]
    truth = [True, False, True, True]
    assert calibration_error(positive, truth) == pytest.approx((0.95 + 0.70 + 0.0) / 4)
    assert calibration_error([1.0, 0.0], [True, False]) == 0.0


@pytest.mark.statistical
def test_a_calibrated_belief_shows_its_expected_error():
    rng = np.random.default_rng(2)
    positive = rng.uniform(size=300)
    expected = expected_calibration_error(positive, rng, draws=400)
    shown = [calibration_error(positive, rng.random(300) < positive) for _ in range(400)]
    assert np.mean(shown) == pytest.approx(expected, abs=5 * np.std(shown) / 20)
    overconfident = np.where(positive > 0.5, 0.99, 0.01)
    error = calibration_error(overconfident, rng.random(300) < positive)
    assert error > 2 * expected_calibration_error(overconfident, rng)


def test_a_belief_that_was_certain_and_wrong_costs_a_finite_price():
    assert negative_log_likelihood([1.0], [False])[0] == pytest.approx(np.log(1e6), rel=1e-6)
    assert negative_log_likelihood([1.0], [True])[0] == pytest.approx(1e-6, rel=1e-3)
    assert brier([1.0, 1.0], [False, True]).tolist() == [1.0, 0.0]


@pytest.mark.parametrize("score", [brier, calibration_error, negative_log_likelihood])
@pytest.mark.parametrize(("positive", "truth"), [([0.5], [True, False]), ([], [])])
def test_each_belief_needs_its_truth(score, positive, truth):
    with pytest.raises(SettingsError, match="give one truth for each"):
        score(positive, truth)


def test_a_difference_of_fractions_has_a_width_where_nobody_gains_or_loses():
    objects = np.repeat(np.arange(36), 10)
    nobody = paired_fractions(np.zeros(360), partial(clustered, clusters=objects))
    _, _, low, high = nobody.interval()
    assert -low == high == pytest.approx(clustered(np.zeros(36), range(36), fraction=True)
                                         .interval().high)  # fmt: skip
    assert 3 / 36 < high < 0.12  # the rule of three, for two sides
    rng = np.random.default_rng(0)
    gain = (rng.random(360) < 0.3).astype(float) - (rng.random(360) < 0.1)
    effect = paired_fractions(gain, partial(clustered, clusters=objects))
    plain = clustered(gain, objects)
    assert effect.interval()[2:] == pytest.approx(plain.interval()[2:], abs=0.01)

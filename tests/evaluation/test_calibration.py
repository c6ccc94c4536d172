import numpy as np
import pytest
from hypothesis import strategies as st

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import (
    brier,
    calibration_error,
    expected_calibration_error,
    negative_log_likelihood,
)

beliefs = st.lists(st.floats(0, 1), min_size=1, max_size=30)


def test_calibration_error_by_hand():
    # Bins: .05 and .15 apart; 1.0 belongs to the last.
    positive, truth = [0.05, 0.15, 0.15, 1.0], [True, False, True, True]
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

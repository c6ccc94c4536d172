import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import minimize

from meal_bayes.perception import DEFAULT, PAPER, build_percept_table
from meal_bayes.perception.classifier import KappaPool, fit_sigmoid


def log_odds(probability):
    return np.log(probability / (1 - probability))


def test_the_behavior_says_the_kappa_weighted_mean():
    sigmoid = np.zeros((2, 1, 2))
    sigmoid[..., 1] = 1.0  # probability = expit(decision)
    pool = KappaPool(sigmoid, np.array([[0.6], [0.2]]))
    said = pool.log_odds(log_odds(np.array([0.9, 0.3]))[None, :, None])
    expected = (0.6 * 0.9 + 0.2 * 0.3) / 0.8
    assert said[0, 0] == pytest.approx(log_odds(expected))


def test_without_any_reliable_modality_it_says_one_half():
    pool = KappaPool(np.ones((2, 1, 2)), np.zeros((2, 1)))
    assert pool.log_odds(np.full((3, 2, 1), 5.0)).tolist() == [[0.0]] * 3


@given(st.integers(0, 999), st.integers(5, 40))
def test_the_sigmoid_is_platts(seed, n):
    rng = np.random.default_rng(seed)
    truth = np.arange(n) % 3 == 0
    decisions = rng.normal(size=n) + truth
    n_true, n_false = truth.sum(), (~truth).sum()
    soft = np.where(truth, (n_true + 1) / (n_true + 2), 1 / (n_false + 2))

    def loss(theta):
        z = theta[0] + theta[1] * decisions
        return (soft * np.logaddexp(0, -z) + (1 - soft) * np.logaddexp(0, z)).sum()

    expected = minimize(loss, [0.0, 0.0], method="BFGS", options={"gtol": 1e-8}).x
    np.testing.assert_allclose(fit_sigmoid(decisions, truth), expected, atol=2e-2, rtol=1e-2)


@pytest.mark.parametrize("perception", [DEFAULT, PAPER], ids=["default", "paper"])
@pytest.mark.parametrize("objects", [1, 2, 3, 4])
def test_hardly_any_objects_are_no_error(make, perception, objects):
    table = build_percept_table(make(1, objects=objects, recordings=1), perception=perception)
    assert np.isfinite(table.log_odds[:, :, :2]).all()
    if objects < 3:
        assert (table.log_odds[:, :, :2] == 0).all()


def test_scikit_learn_loads_only_for_the_paper():
    code = "import sys, meal_bayes.perception; sys.exit('sklearn' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0

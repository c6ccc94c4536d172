"""The observation model: one definition for arrays and kernels, and draws that agree with it."""

import numpy as np
import pytest

from meal_bayes.momdp.observation import predictive, sample_rows
from meal_bayes.planners.kernels import entry_kernel
from meal_bayes.planners.open_loop.errors import predictive as compiled


@entry_kernel
def fill(mean, precision, count, total, out):
    for i in range(out.shape[0]):
        out[i] = compiled(mean[i], precision[i], count[i], total[i])


def urns(seed, levels=4, size=200):
    """Random mean rows (S,K), precisions (S,), of which a quarter is inf, and counts (S,K)."""
    rng = np.random.default_rng(seed)
    precision = np.where(rng.random(size) < 0.25, np.inf, rng.gamma(1.0, 20.0, size) + 1e-6)
    return rng.dirichlet(np.ones(levels), size), precision, rng.integers(0, 40, (size, levels))


@pytest.mark.parametrize("seed", range(5))
def test_arrays_and_kernels_have_one_predictive(seed):
    mean, precision, counts = urns(seed)
    weight, total = (np.repeat(a, 4).astype(float) for a in (precision, counts.sum(axis=1)))
    found = np.empty(mean.size)
    fill(mean.ravel(), weight, counts.ravel().astype(float), total, found)
    expected = predictive(mean.ravel(), weight, counts.ravel(), total)
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_predictive_sums_to_one_over_levels(seed):
    mean, precision, counts = urns(seed)
    rows = predictive(mean, precision[:, None], counts, counts.sum(axis=1, keepdims=True))
    assert (rows >= 0).all()
    np.testing.assert_allclose(rows.sum(axis=1), 1.0, atol=1e-12)


def test_infinite_precision_is_equation_8():
    """Percepts are independent given the class, whatever was perceived."""
    mean, _, counts = urns(0)
    rows = predictive(mean, np.inf, counts, counts.sum(axis=1, keepdims=True))
    np.testing.assert_array_equal(rows, mean)


@pytest.mark.statistical
@pytest.mark.parametrize("precision", [0.5, 5.0, np.inf])
def test_sampled_rows_have_the_predictive_as_their_mean(precision):
    mean, counts, draws = np.array([0.1, 0.6, 0.3]), np.array([2, 0, 5]), 20_000
    rows = sample_rows(np.tile(mean, (draws, 1)), precision, counts, rng=np.random.default_rng(1))
    np.testing.assert_allclose(rows.sum(axis=1), 1.0)
    error = 4.5 * rows.std(axis=0) / np.sqrt(draws) + 1e-12
    assert (abs(rows.mean(axis=0) - predictive(mean, precision, counts, 7)) <= error).all()
    if np.isinf(precision):
        np.testing.assert_array_equal(rows, np.tile(mean, (draws, 1)))

import numpy as np
import pytest
from sbc import simulate
from scipy.stats import beta, betabinom

from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.draws import (
    draw_grid,
    draws_of,
    replicate,
    rows_of,
    sensing,
    summarize_draws,
)

NAMES = {"attributes": ["red", "full"], "behaviors": ["look", "lift"]}


@pytest.fixture(scope="module", params=[2, 4])
def counts(request):
    levels = request.param
    lean = np.stack([np.linspace(3, 1, levels), np.linspace(1, 3, levels)])
    prior = np.broadcast_to(lean, (2, 3, 2, levels))
    made = simulate(np.random.default_rng(3), prior, objects=12, recordings=5).counts
    made[:, :, 1] = 0  # asking is not sensing
    return made


@pytest.fixture(scope="module")
def draws(counts):
    assert sensing(counts).tolist() == [True, False, True]
    return draw_grid(counts[:, :, [0, 2]], np.random.default_rng(0), **NAMES, draws=2000, chains=2)


def test_draws_of_the_grid_agree_with_its_fit(counts, draws):
    sensed = counts[:, :, [0, 2]]
    fit = ConfusionPosterior.from_objects(sensed)
    mean, s, _ = rows_of(draws)
    assert draws["behavior"].values.tolist() == ["look", "lift"]
    assert mean.shape == (4000, 2, 2, 2, counts.shape[-1])
    rows = fit.concentration / fit.concentration.sum(axis=-1, keepdims=True)
    np.testing.assert_allclose(mean.mean(axis=0), rows, atol=0.01)  # of pairs that tell
    spread = 1 - (mean**2).sum(axis=-1)
    dispersion = spread.sum(axis=0) / (spread / (s + 1)).sum(axis=0) - 1
    np.testing.assert_allclose(np.log(dispersion / fit.dispersion), 0, atol=0.1)


def test_a_row_of_known_dispersion_is_drawn_from_its_beta():
    """One percept an object: s does not matter, and m is conjugate."""
    counts = np.zeros((12, 1, 1, 2, 2), dtype=np.int64)
    counts[:9, 0, 0, 1, 1] = counts[9:, 0, 0, 1, 0] = 1
    drawn = draw_grid(
        counts, np.random.default_rng(1), attributes=["a"], behaviors=["b"], prior=1.0, draws=5000
    )
    marks = np.quantile(rows_of(drawn)[0][:, 0, 0, 1, 1], [0.025, 0.25, 0.5, 0.75, 0.975])
    np.testing.assert_allclose(marks, beta(10, 4).ppf([0.025, 0.25, 0.5, 0.75, 0.975]), atol=0.01)


def test_the_summary_for_agents_is_the_grids_own(counts, draws):
    expected = ConfusionPosterior.from_objects(counts)
    summary = summarize_draws(draws, counts, expected.telling[:, [0, 2]])
    np.testing.assert_array_equal(summary.counts, expected.counts)
    np.testing.assert_array_equal(summary.telling, expected.telling)
    np.testing.assert_allclose(summary.mean, expected.mean, atol=0.01)
    np.testing.assert_allclose(np.log(summary.dispersion / expected.dispersion), 0, atol=0.1)
    weights = [p.concentration.sum(axis=-1)[:, [0, 2]] for p in (summary, expected)]
    np.testing.assert_allclose(np.log(weights[0] / weights[1]), 0, atol=0.35)  # A is a summary
    np.testing.assert_allclose(summary.concentration[:, 1], expected.concentration[:, 1])


def test_replicates_are_percepts_of_new_objects():
    """With known rows they are beta-binomial; a misperceived object shows the other row."""
    counts = np.zeros((4000, 1, 2, 2, 2), dtype=np.int64)
    counts[..., 1, 0] = 5
    mean = np.broadcast_to(np.array([[0.9, 0.1], [0.2, 0.8]]), (1, 1, 1, 2, 2, 2))
    s = np.full((1, 1, 1, 2, 2), 2.0)
    plain = draws_of("a", "bc", mean, s)
    yes = replicate(plain, counts, np.random.default_rng(2), size=1)[0, :, 0, :, 1, 1]
    expected = betabinom(5, 1.6, 0.4).pmf(range(6))
    np.testing.assert_allclose(np.bincount(yes.ravel()) / 8000, expected, atol=0.02)
    assert abs(np.corrcoef(yes.T)[0, 1]) < 0.05
    odd = draws_of("a", "bc", mean, s, np.full((1, 1), 0.3))
    yes = replicate(odd, counts, np.random.default_rng(2), size=1)[0, :, 0, :, 1, 1]
    assert yes.mean() / 5 == pytest.approx(0.7 * 0.8 + 0.3 * 0.1, abs=0.02)
    assert np.corrcoef(yes.T)[0, 1] > 0.3  # behaviors of one object err together


def test_rows_for_agents_hold_what_is_misperceived():
    """Given the truth, a share epsilon of objects shows the other row: more unlike each other."""
    rng = np.random.default_rng(5)
    counts = np.zeros((4, 1, 1, 2, 2), dtype=np.int64)
    counts[:2, ..., 0, 0] = counts[2:, ..., 1, 1] = 3
    noise = rng.normal(0, 0.01, (1, 500, 1, 1, 2))
    yes = np.array([0.1, 0.8]) + noise
    mean = np.stack([1 - yes, yes], axis=-1)
    s = np.full((1, 500, 1, 1, 2), 2.0)
    odd = draws_of("a", "b", mean, s, np.full((1, 500), 0.2))
    summary = summarize_draws(odd, counts)
    np.testing.assert_allclose(summary.mean[0, 0, :, 1], [0.24, 0.66], atol=0.002)
    rates = rng.beta(2 * np.array([0.8, 0.1]), 2 * np.array([0.2, 0.9]), (200_000, 2))
    theta = np.where(rng.random(200_000) < 0.2, rates[:, 1], rates[:, 0])  # of true objects
    equal = (theta**2 + (1 - theta) ** 2).mean()
    m = summary.mean[0, 0, 1]
    precision = summary.dispersion[0, 0, 1]
    assert (1 + precision * (m**2).sum()) / (precision + 1) == pytest.approx(equal, abs=0.005)
    assert precision < 1.2


@pytest.mark.parametrize("alike", [slice(None), slice(3, 4)], ids=["all", "one draw"])
def test_objects_may_be_all_alike(alike):
    rng = np.random.default_rng(0)
    mean = rng.dirichlet([9, 3], (1, 50, 2, 2, 2))
    counts = rng.integers(1, 5, (6, 2, 2, 2, 2))
    dispersion = np.full(mean.shape[:-1], 5.0)
    dispersion[:, alike] = np.inf
    draws = draws_of(["red", "full"], ["look", "lift"], mean, dispersion)
    summary = summarize_draws(draws, counts)
    assert (np.isinf(summary.dispersion) if alike == slice(None) else summary.dispersion > 5).all()

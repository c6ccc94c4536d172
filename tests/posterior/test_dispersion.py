import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import betabinom

from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.grid import (
    DISPERSIONS,
    TAUS,
    RowStatistics,
    approximate,
    integrate,
    prior_of,
)

from_objects = ConfusionPosterior.from_objects


def simulate(rng, s, objects=60, attributes=12, recordings=5, levels=2):
    """Draw counts (O,P,1,2,K) of objects whose rows are Dirichlet(s m); half have each truth."""
    m = rng.dirichlet(np.full(levels, 4.0), (attributes, 1, 2))
    upward = m[..., levels // 2 :].sum(axis=-1).argsort(axis=-1)
    m = np.take_along_axis(m, upward[..., None], axis=2)  # true objects show more "yes"
    theta = rng.dirichlet(np.ones(levels), (objects, attributes, 1, 2))
    for index in np.ndindex(theta.shape[:-1]):
        theta[index] = rng.dirichlet(s * m[index[1:]] + 1e-9)
    counts = rng.multinomial(recordings, theta / theta.sum(axis=-1, keepdims=True))
    truth = rng.random((objects, attributes)) < 0.5
    counts[..., 0, :] *= ~truth[:, :, None, None]
    counts[..., 1, :] *= truth[:, :, None, None]
    return m, counts


def by_brute_force(counts):
    """Integrate one behavior and truth (O,P,2) over s, m, mu and tau by plain sums."""
    m = (np.arange(2000) + 0.5) / 2000
    s = DISPERSIONS
    attributes = counts.shape[1]
    table = np.empty((attributes, len(s), len(m)))
    for p in range(attributes):
        log = np.zeros((len(s), len(m)))
        for zeros, ones in counts[:, p]:
            log += betabinom.logpmf(ones, zeros + ones, s[:, None] * m, s[:, None] * (1 - m))
        table[p] = np.exp(log)
    evidence = table.sum(axis=2)  # (P,G)
    weight = np.zeros((attributes, len(s)))
    for center in np.log(s):
        for spread in TAUS:
            share = np.exp(-(((np.log(s) - center) / spread) ** 2) / 2)
            share /= share.sum()
            each = (evidence * share).sum(axis=1)
            likelihood = each.prod() * np.exp(-(spread**2) / 2)
            weight += likelihood * evidence * share / each[:, None]
    weight /= weight.sum(axis=1, keepdims=True)
    within = weight[:, :, None] * table / evidence[:, :, None]  # (P,G,M)
    spread = (within * m * (1 - m)).sum(axis=2)
    dispersion = spread.sum(axis=1) / (spread / (s + 1)).sum(axis=1) - 1
    return (within * m).sum(axis=(1, 2)), dispersion


def test_two_levels_are_exact():
    counts = np.zeros((5, 2, 1, 2, 2), dtype=np.int64)
    counts[:, 0, 0, 1] = [[0, 5], [1, 4], [5, 0], [0, 3], [0, 0]]
    counts[:, 1, 0, 1] = [[2, 3], [1, 4], [3, 2], [0, 0], [1, 1]]
    counts[0, :, 0, 0] = [4, 1]
    fit = from_objects(counts, prior=2.0)
    mean, dispersion = by_brute_force(counts[:, :, 0, 1])
    np.testing.assert_allclose(fit.mean[:, 0, 1, 1], mean, rtol=1e-5)
    np.testing.assert_allclose(fit.dispersion[:, 0, 1], dispersion, rtol=1e-4)
    n = counts[:, :, 0, 1].sum(axis=-1)
    worth = (n * (dispersion + 1) / (n + dispersion)).sum(axis=0)
    np.testing.assert_allclose(fit.concentration[:, 0, 1].sum(axis=-1), 2 + worth, rtol=1e-4)


def test_an_informative_prior_enters_as_percepts_of_the_mean():
    counts = np.zeros((1, 1, 1, 2, 2), dtype=np.int64)
    fit = from_objects(counts, prior=np.array([3.0, 1.0]))
    np.testing.assert_allclose(fit.mean[0, 0, 0], [0.75, 0.25], atol=1e-6)  # single precision
    np.testing.assert_allclose(fit.concentration.sum(axis=-1), 4.0)


@pytest.mark.statistical
@pytest.mark.parametrize("levels", [2, 4])
@pytest.mark.parametrize("s", [0.7, 2.0, 8.0])
def test_simulated_dispersion_is_recovered(levels, s):
    m, counts = simulate(np.random.default_rng(5), s, levels=levels)
    fit = from_objects(counts, prior=2.0)
    assert np.exp(np.log(fit.dispersion).mean()) == pytest.approx(s, rel=0.25)
    deviation = np.abs(fit.mean - m) / np.sqrt(
        m * (1 - m) / (fit.concentration.sum(axis=-1, keepdims=True) + 1)
    )
    assert np.sqrt((deviation**2).mean()) == pytest.approx(1.0, abs=0.3)


def test_pairs_that_say_nothing_have_no_vote():
    _, counts = simulate(np.random.default_rng(4), 8.0, attributes=6)
    silent = np.zeros_like(counts)
    silent[..., 0] = counts.sum(axis=-1)  # every percept at one level, whatever the truth
    crowd = np.concatenate([counts, silent, silent], axis=1)
    alone = from_objects(counts)
    together = from_objects(crowd)
    np.testing.assert_allclose(prior_of(crowd)[:6], prior_of(counts))
    np.testing.assert_allclose(together.dispersion[:6], alone.dispersion, rtol=1e-3)
    np.testing.assert_allclose(together.mean[:6], alone.mean, rtol=1e-3)


@given(st.integers(0, 10**6), st.sampled_from([2, 4]))
def test_any_counts_give_a_proper_posterior(seed, levels):
    rng = np.random.default_rng(seed)
    theta = rng.dirichlet(np.full(levels, 0.3), (6, 3, 2, 2))
    counts = rng.multinomial(rng.integers(0, 12, (6, 3, 2, 2)), theta)
    fit = from_objects(counts, prior=2.0)
    assert (fit.mean > 0).all()
    np.testing.assert_allclose(fit.mean.sum(axis=-1), 1.0)
    assert ((fit.dispersion > 0) & np.isfinite(fit.dispersion)).all()
    weight = fit.concentration.sum(axis=-1)
    assert ((weight >= 2 - 1e-9) & (weight <= 2 + counts.sum((0, 4)) + 1e-9)).all()


@pytest.mark.statistical
def test_the_object_level_predicts_new_objects_better_than_equation_8():
    rng = np.random.default_rng(8)
    m, counts = simulate(rng, 1.0, objects=40)
    theta = rng.beta(m[..., 1] * np.ones((2000, 1, 1, 1)), m[..., 0])  # s = 1
    new = rng.binomial(5, theta)
    score = {}
    for name, posterior in (
        ("objects", from_objects(counts)),
        ("paper", ConfusionPosterior.from_counts(counts)),
    ):
        weight = posterior.precision[..., None] * posterior.mean
        score[name] = betabinom.logpmf(new, 5, weight[..., 1], weight[..., 0]).mean()
    best = betabinom.logpmf(new, 5, m[..., 1], m[..., 0]).mean()
    assert score["objects"] > best - 0.05
    assert score["paper"] < best - 0.3


@pytest.mark.parametrize("s", [0.7, 2.0, 8.0, 50.0])
def test_the_form_for_more_levels_is_nearly_exact_for_two(s):
    _, counts = simulate(np.random.default_rng(3), s, objects=8)
    rows = np.moveaxis(counts, -5, -2).reshape(-1, 8, 2)
    prior = np.ones((len(rows), 2))
    statistics = RowStatistics.of(rows)
    near = approximate(statistics, prior)
    exact = integrate(statistics, prior)
    shares = []
    for profile in (near, exact):
        share = np.exp(profile.log_evidence - profile.log_evidence.max(axis=1, keepdims=True))
        shares.append(share / share.sum(axis=1, keepdims=True))
    assert np.abs(shares[0] - shares[1]).sum(axis=1).mean() / 2 < 0.03
    means = [
        np.einsum("sg,sgk->sk", share, profile.mean)
        for share, profile in zip(shares, (near, exact), strict=True)
    ]
    assert np.abs(means[0] - means[1]).mean() < 0.02


def test_graded_rows_lean_on_what_a_level_is_worth_elsewhere():
    """Of a pair that was hardly seen, the use of the levels is its own, their worth all pairs'."""
    _, counts = simulate(np.random.default_rng(7), 4.0, objects=80, attributes=10, levels=4)
    counts[2:, -1] = 0
    fit = from_objects(counts)
    mean = fit.concentration / fit.concentration.sum(axis=-1, keepdims=True)  # if they tell
    worth = np.log(mean[:, 0, 1] / mean[:, 0, 0])  # (P,K)
    pooled = np.log(mean[:-1, 0, 1].mean(axis=0) / mean[:-1, 0, 0].mean(axis=0))
    assert np.abs(worth[-1] - pooled).mean() < 0.5 * np.abs(worth[:-1] - pooled).mean()
    np.testing.assert_allclose(prior_of(counts).sum(axis=-1), 32.0)

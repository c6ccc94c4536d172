import numpy as np
import pytest
from sbc import coverage, rank_statistics, simulate, uniformity
from scipy.special import logit

from meal_bayes.errors import SettingsError
from meal_bayes.momdp.observation import sample_rows
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.checks import beliefs_without_itself, log_likelihood, predictive_check
from meal_bayes.posterior.draws import draw_grid, draws_of, rows_of

RANKED = 99
BEHAVIORS = 100  # of two truths each: 200 simulations


def leaning(levels, attributes):
    up = np.linspace(1.0, 3.0, levels)
    rows = np.stack([up[::-1], up]) * 4 / up.sum()
    return np.broadcast_to(rows, (attributes, BEHAVIORS, 2, levels)).copy()


def yes(mean):
    return mean[..., mean.shape[-1] // 2 :].sum(axis=-1)


def conjugate(posterior, rng, size=RANKED):
    """Rows drawn from a conjugate posterior, (size,P,E,2,K)."""
    weight = posterior.concentration.sum(axis=-1)
    return sample_rows(posterior.mean, weight, np.zeros((size, *posterior.mean.shape)), rng)


def fit(made, prior, rng, draws=RANKED):
    names = {
        "attributes": [str(p) for p in range(made.counts.shape[1])],
        "behaviors": [str(e) for e in range(BEHAVIORS)],
    }
    return rows_of(draw_grid(made.counts, rng, **names, prior=prior, draws=draws, chains=1))[:2]


@pytest.mark.statistical
@pytest.mark.parametrize("independent", [True, False])
def test_conjugate_rows_are_calibrated_where_percepts_are_independent(independent):
    """Eq. 8 counts repeats of one object as new cases: far too narrow where objects differ."""
    rng = np.random.default_rng(1)
    prior = leaning(2, 1)
    made = simulate(rng, prior, objects=20, recordings=5, independent=independent)
    drawn = yes(conjugate(ConfusionPosterior.from_counts(made.counts, prior=prior), rng))
    ranks = rank_statistics(yes(made.mean), drawn, rng)
    assert ranks.size == 200
    assert uniformity(ranks, RANKED) > 0.01 if independent else uniformity(ranks, RANKED) < 1e-6
    assert independent or coverage(yes(made.mean), drawn)[2] < 0.9


@pytest.mark.long
@pytest.mark.statistical
@pytest.mark.parametrize("levels", [2, 4])
def test_the_object_level_is_calibrated(levels):
    rng = np.random.default_rng(1)
    prior = leaning(levels, 4)
    made = simulate(rng, prior, objects=15, recordings=5)
    mean, s = fit(made, prior, rng)
    ranks = rank_statistics(yes(made.mean), yes(mean), rng)[0]
    assert ranks.size == 200
    assert uniformity(ranks, RANKED) > 0.01
    assert uniformity(rank_statistics(made.dispersion, s, rng)[0], RANKED) > 0.01
    summed = ConfusionPosterior.from_objects(made.counts, prior=prior)
    drawn = yes(conjugate(summed, rng, 499))
    assert uniformity(rank_statistics(yes(made.mean), drawn[:RANKED], rng)[0], RANKED) > 0.01
    np.testing.assert_allclose(coverage(yes(made.mean), drawn), [0.5, 0.8, 0.95], atol=0.05)


def test_ranks_count_draws_below_and_break_ties_at_random():
    rng = np.random.default_rng(0)
    assert rank_statistics([0.5, 2.0], [[0.0, 0.0], [1.0, 1.0]], rng).tolist() == [1, 2]
    tied = [int(rank_statistics([1.0], [[1.0], [1.0]], rng)[0]) for _ in range(50)]
    assert set(tied) == {0, 1, 2}
    with pytest.raises(SettingsError, match="Draws have shape"):
        rank_statistics([1.0], [[1.0, 2.0]], rng)
    with pytest.raises(SettingsError, match="multiple of 20"):
        uniformity([1], 50)


@pytest.mark.statistical
def test_prediction_fits_what_the_model_made_and_nothing_else():
    rng = np.random.default_rng(2)
    prior = leaning(2, 2)[:, :10]
    names = {"attributes": list("ab"), "behaviors": list("cdefghijkl")}
    made = simulate(rng, prior, objects=30, recordings=5)
    drawn = draw_grid(made.counts, rng, **names, prior=prior, draws=200)
    check = predictive_check(drawn, made.counts, rng)
    assert check.observed.shape == (2, 6)
    assert (check.predicted.sum(axis=-1) == check.observed.sum(axis=-1)).all()
    assert ((check.p_values > 0.02) & (check.p_values < 0.98)).all()
    alike = drawn.assign(dispersion=0 * drawn["dispersion"] + 1e6)
    assert (predictive_check(alike, made.counts, rng).p_values < 0.01).all()


@pytest.mark.long
def test_beliefs_leave_the_object_out():
    """Weighting draws is nearly as good as fitting again without each object."""
    rng = np.random.default_rng(4)
    prior = leaning(2, 2)[:, :2]
    names = {"attributes": list("ab"), "behaviors": list("cd")}
    counts = simulate(rng, prior, objects=12, recordings=4).counts
    drawn = draw_grid(counts, rng, **names, prior=prior, draws=4000)
    beliefs = beliefs_without_itself(drawn, counts, size=4000)
    (each, _) = beliefs["each"]
    (together, together_truth) = beliefs["together"]
    truth = counts.any(axis=(2, 4))[..., 1]  # (O,P)
    np.testing.assert_array_equal(together_truth, truth.ravel())
    expected = np.empty(truth.shape)
    for o in range(len(counts)):
        others = np.delete(counts, o, axis=0)
        mean, s, _ = rows_of(draw_grid(others, rng, **names, prior=prior, draws=1000))
        shown = counts[o].sum(axis=2).astype(float)
        score = np.array(
            [log_likelihood(shown, mean[:, :, :, t], s[:, :, :, t]).sum(axis=-1) for t in (0, 1)]
        )  # (2,S,P)
        false, true = np.exp(score).mean(axis=1)
        n = np.delete(truth, o, axis=0)
        odds = true / false * (n.sum(axis=0) + 1) / ((~n).sum(axis=0) + 1)
        expected[o] = odds / (1 + odds)
    np.testing.assert_allclose(together, expected.ravel(), atol=0.05)
    assert np.abs(together - expected.ravel()).mean() < 0.01
    with_itself = np.where(truth, 1, -1).ravel() * (together - expected.ravel())
    assert with_itself.mean() < 0.005
    assert len(each) == 2 * len(together)
    assert np.abs(logit(each)).mean() < np.abs(logit(together)).mean()


def test_beliefs_of_known_rows_are_bayes_rule():
    counts = np.zeros((3, 1, 2, 2, 2), dtype=np.int64)
    counts[0, 0, :, 1, 1] = counts[1, 0, :, 0, 0] = counts[2, 0, :, 1, 0] = 1
    mean = np.broadcast_to([[0.9, 0.1], [0.2, 0.8]], (1, 5, 1, 2, 2, 2))
    plain = draws_of("a", "bc", mean, np.ones((1, 5, 1, 2, 2)))
    prior = np.array([2 / 2, 3 / 1, 2 / 2])  # (n+ + 1) / (n- + 1) of the other two
    ratio = np.array([8.0, 2 / 9, 2 / 9])
    beliefs = beliefs_without_itself(plain, counts)
    np.testing.assert_allclose(beliefs["each"][0][::2], prior * ratio / (1 + prior * ratio))
    np.testing.assert_allclose(beliefs["together"][0], prior * ratio**2 / (1 + prior * ratio**2))
    odd = draws_of("a", "bc", mean, np.ones((1, 5, 1, 2, 2)), np.full((1, 5), 0.2))
    shared = (0.8 * ratio**2 + 0.2) / (0.8 + 0.2 * ratio**2)
    together, _ = beliefs_without_itself(odd, counts)["together"]
    np.testing.assert_allclose(together, prior * shared / (1 + prior * shared))

import numpy as np
import pytest

from meal_bayes.perception.confusion import by_truth
from meal_bayes.posterior.graded_prior import GradedPrior, pooled_log_ratio
from meal_bayes.posterior.grid import effective_counts, prior_of, row_statistics


def paired(rng, strength, objects=80):
    """Draw counts (O,P,E,2,4) of pairs whose levels say more or less, by strength (P,E)."""
    truth = rng.random((objects, len(strength))) < 0.5
    sign = np.where(truth, 1.0, -1.0)[..., None, None]
    rows = np.exp(sign * strength[..., None] * np.array([-1.0, -0.3, 0.3, 1.0]))
    levels = rng.multinomial(3, rows / rows.sum(axis=-1, keepdims=True))
    return by_truth(levels, truth.astype(np.int8))


def learned(counts):
    rows, votes = row_statistics(counts)
    effective = effective_counts(rows, votes)
    return GradedPrior.learn(effective, votes), pooled_log_ratio(effective, votes)


def test_pairs_that_are_almost_never_wrong_have_a_prior_of_their_own():
    strength = np.tile([[0.5], [3.5]], (6, 3))
    prior = prior_of(paired(np.random.default_rng(5), strength))
    says = np.log(prior[..., 1, 3] / prior[..., 0, 3])  # (P,E) that the top level says of truth
    assert says[::2].max() < 2.5
    assert says[1::2].min() > 4.5
    np.testing.assert_allclose(prior.sum(axis=-1), 32.0)


def test_pairs_of_one_kind_have_the_ratio_of_all_pairs():
    prior, common = learned(paired(np.random.default_rng(6), np.full((10, 4), 1.0), objects=200))
    np.testing.assert_allclose(prior.log_ratios, np.stack([common, common]), atol=0.1)


@pytest.mark.parametrize("objects", [1, 2, 3])
def test_few_objects_give_the_ratio_of_all_pairs_nearly(objects):
    prior, common = learned(paired(np.random.default_rng(7), np.full((3, 2), 1.0), objects))
    assert np.isfinite(prior.rows).all()
    assert (prior.rows > 0).all()
    assert np.abs(prior.log_ratios - common).max() < 1.0


def test_the_kind_of_a_pair_is_judged_without_the_object_that_is_taken_out():
    prior, _ = learned(paired(np.random.default_rng(8), np.tile([[0.5], [2.5]], (3, 2)), 12))
    pair = np.array([0, 3]), np.array([1, 0])
    counted = prior.effective[pair]
    alphas, kinds = prior._of_kinds(counted)
    _, halved = prior._of_kinds(0.5 * counted)
    for change, weights in ((0.0, kinds), (0.5, halved)):
        expected = (weights[..., None, None] * alphas).sum(axis=0)
        actual = prior.rows[pair] + prior.change_without(*pair, change * counted)
        np.testing.assert_allclose(actual, expected)

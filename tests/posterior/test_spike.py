"""Whether a pair tells anything: by hand on small examples, and on simulated pairs."""

import numpy as np
import pytest
from scipy.stats import norm

from meal_bayes.perception.confusion import youden
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.spike import null_spread, probability_of_telling, standard_error


def pairs(*rows):
    """Counts (P,1,2,2) of pairs, each (no, yes) of false and of true objects."""
    return np.array(rows, float)[:, None]


STRONG = [[18, 2], [3, 17]]
WEAK = [[11, 9], [9, 11]]
BELOW = [[8, 12], [12, 8]]


def test_weights_are_those_by_hand():
    counts = pairs(STRONG, WEAK, BELOW)
    yes = (counts[..., 1] + 0.5) / 21
    se = np.sqrt((yes * (1 - yes) / 21).sum(axis=-1))[:, 0]
    np.testing.assert_allclose(standard_error(counts)[:, 0], se)
    j = np.array([0.75, 0.1, -0.2])
    np.testing.assert_allclose(youden(counts)[:, 0], j)
    kappa = np.sqrt(((j[2] / se[2]) ** 2 + 10) / 11)
    assert null_spread(youden(counts), counts) == pytest.approx(kappa)
    s = kappa * se[:2]
    slab = norm.cdf((1 - j[:2]) / s) - norm.cdf(-j[:2] / s)
    null = 2 * norm.pdf(j[:2] / s) / s
    weight = probability_of_telling(counts, counts)[:, 0]
    share = (weight.sum() + 1) / 4  # two pairs are above chance
    np.testing.assert_allclose(
        weight[:2], share * slab / (share * slab + (1 - share) * null), atol=1e-5
    )
    assert weight[2] == 0
    assert weight[1] < 0.4
    assert weight[0] > 0.99


def test_pairs_that_stray_far_below_chance_make_others_doubtful():
    doubtful = [[6, 14], [15, 5]]  # J = -.45
    alone = pairs(STRONG, WEAK)
    many = pairs(STRONG, WEAK, *[doubtful] * 20)
    assert null_spread(youden(many), many) > 2 * null_spread(youden(alone), alone)
    assert probability_of_telling(many, many)[0] < 0.95
    assert probability_of_telling(alone, alone)[0] > 0.95


def test_what_is_given_is_believed_and_says_nothing_of_others():
    counts = pairs(STRONG, WEAK, BELOW)
    given = np.array([[False], [False], [True]])
    weight = probability_of_telling(counts, counts, given)
    np.testing.assert_allclose(weight[:2], probability_of_telling(counts[:2], counts[:2]))
    assert weight[2] == 1


def test_rows_are_mixed_with_the_pooled_row():
    rng = np.random.default_rng(1)
    counts = rng.multinomial(3, [0.4, 0.3, 0.2, 0.1], (20, 4, 3, 2))
    posterior = ConfusionPosterior.from_objects(counts)
    alpha = posterior.concentration
    rows = alpha / alpha.sum(axis=-1, keepdims=True)
    pooled = alpha.sum(axis=2, keepdims=True) / alpha.sum(axis=(2, 3), keepdims=True)
    weight = posterior.telling[..., None, None]
    np.testing.assert_allclose(posterior.mean, weight * rows + (1 - weight) * pooled)
    told = posterior.informative
    confusion, _ = posterior.select(range(4))
    np.testing.assert_allclose(confusion[told], posterior.mean[told])
    np.testing.assert_allclose(confusion[~told][:, 0], confusion[~told][:, 1])


@pytest.mark.statistical
def test_of_simulated_pairs_as_many_tell_as_is_said():
    """Null pairs and telling ones of a true J uniform on (0, 1), forty percepts each."""
    rng = np.random.default_rng(2)
    said = []
    right = []
    for _ in range(20):
        tells = rng.random((60, 5)) < 0.5
        j = np.where(tells, rng.random((60, 5)), 0.0)
        base = rng.uniform(0, 1 - j)
        rates = np.stack([base, base + j], axis=-1)
        yes = rng.binomial(40, rates)
        counts = np.stack([40 - yes, yes], axis=-1).astype(float)
        weight = probability_of_telling(counts, counts)
        above = weight > 0
        said.append(weight[above])
        right.append(tells[above])
    said = np.concatenate(said)
    right = np.concatenate(right)
    for low, high in ((0, 0.3), (0.3, 0.8), (0.8, 1.01)):
        part = (said >= low) & (said < high)
        assert said[part].mean() == pytest.approx(right[part].mean(), abs=0.06)

"""Scores are cut to levels by rank, then by labels; whatever the scale, the levels are the same."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from meal_bayes.perception.scores import cut_scores, edges_by_labels, edges_by_rank, scored_levels


@given(st.lists(st.integers(-20, 20), min_size=1, max_size=40), st.sampled_from([2, 4, 8]))
@settings(max_examples=60, deadline=None)
def test_levels_by_rank_rise_with_the_score_and_are_those_of_the_ranks(scores, levels):
    edges = edges_by_rank(scores, levels)
    assert (np.diff(edges[np.isfinite(edges)]) >= 0).all()
    new = np.unique(scores)
    below = (np.array(scores) < new[:, None]).sum(axis=1)
    equal = (np.array(scores) == new[:, None]).sum(axis=1)
    rank = (below + equal / 2 + 0.5) / (len(scores) + 1)
    shares = np.arange(1, levels) / levels
    by_rank = ((rank[:, None] > shares) | ((rank[:, None] == shares) & (shares < 0.5))).sum(axis=1)
    np.testing.assert_array_equal(scored_levels(new, edges), by_rank)


def test_nothing_is_said_before_the_first_score():
    assert np.isnan(edges_by_rank([], 4)).all()
    assert scored_levels([0.5], np.full((1, 3), np.nan)) == -1


def drawn(rng, n=60, attributes=3):
    """Draw scores of n objects, one in two looked at twice, that rise with the truth."""
    truth = rng.random((n, attributes)) < 0.4
    objects = np.concatenate([np.arange(n), np.arange(0, n, 2)])
    scores = rng.normal(2.5 * truth[objects])
    behavior = np.zeros(len(objects), int)
    return scores, truth[objects].astype(np.int8), behavior, objects


def cut(scores, labels, behavior, objects):
    edges, falling = cut_scores(scores, labels, behavior, objects, behaviors=1, levels=4)
    return edges, scored_levels(scores, edges[:, 0]), falling


@given(st.integers(0, 10_000), st.floats(1e-3, 1e3), st.floats(-100, 100))
@settings(max_examples=15, deadline=None)
def test_levels_do_not_depend_on_unit_and_zero_of_the_scale(seed, unit, zero):
    rng = np.random.default_rng(seed)
    scores, labels, behavior, objects = drawn(rng)
    labels[rng.random(labels.shape) < 0.3] = -1
    edges, levels, _ = cut(scores, labels, behavior, objects)
    other_edges, other_levels, _ = cut(scores * unit + zero, labels, behavior, objects)
    # An edge may pass a score by rounding, where one lies on the other.
    assert (levels != other_levels).mean() < 0.02
    np.testing.assert_allclose(other_edges, edges * unit + zero, rtol=1e-6, atol=1e-6 * unit)


def test_edges_by_labels_lie_between_the_truths():
    truth = np.array([0, 0, 0, 0, 1, 1, 1, 1])
    objects = np.stack([1 - truth, truth]) * 5.0
    edges = edges_by_labels(np.arange(8.0), objects, 4)
    assert ((edges > 1.0) & (edges < 6.0)).all()
    assert scored_levels([0.0, 7.0], [edges, edges]).tolist() == [0, 3]


def test_levels_of_noise_say_little():
    """Sixteen objects, of which the labels that cut the levels are counted."""
    gained = []
    for seed in range(100):
        rng = np.random.default_rng(seed)
        scores, labels, behavior, objects = drawn(rng, n=16, attributes=1)
        _, levels, _ = cut(rng.normal(size=scores.shape), labels, behavior, objects)
        truth = labels[:, 0] == 1
        if truth.any() and not truth.all():
            gained.append((levels[truth, 0] >= 2).mean() - (levels[~truth, 0] >= 2).mean())
    assert np.mean(gained) < 0.15  # Youden's J


def test_scores_that_fall_where_it_is_true_are_found():
    scores, labels, behavior, objects = drawn(np.random.default_rng(1))
    assert not cut(scores, labels, behavior, objects)[2].any()
    assert cut(-scores, labels, behavior, objects)[2].all()


@pytest.mark.parametrize("levels", [2, 4])
def test_an_attribute_without_labels_is_cut_by_those_of_the_others(levels):
    scores, labels, behavior, objects = drawn(np.random.default_rng(2))
    labels[:, 0] = -1
    edges, _ = cut_scores(scores, labels, behavior, objects, behaviors=1, levels=levels)
    middle = edges[:, 0, levels // 2 - 1]
    assert abs(middle[0] - middle[1:].mean()) < 0.5

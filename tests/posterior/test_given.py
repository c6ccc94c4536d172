"""Percepts that a robot brings tell something until their counts say otherwise."""

import numpy as np
import pytest
from hypothesis import given as generated
from hypothesis import strategies as st

from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.given import generic_prior, given_rows
from meal_bayes.posterior.grid import dispersion_prior

GIVEN = np.ones((1, 1), np.bool_)


def counted(truths, levels, k):
    """One percept each of objects, (O,1,1,2,K)."""
    counts = np.zeros((len(truths), 1, 1, 2, k), int)
    counts[np.arange(len(truths)), 0, 0, truths, levels] = 1
    return counts


@pytest.mark.parametrize("levels", [2, 3, 4, 8])
def test_before_any_percept_a_detector_is_believed_to_tell_something(levels):
    alpha = generic_prior(levels)
    mean = alpha / alpha.sum(axis=1, keepdims=True)
    assert (np.diff(np.log(mean[1] / mean[0])) > 0).all()  # a higher level says more
    np.testing.assert_allclose(mean[0], mean[1, ::-1])
    unheard = ConfusionPosterior.from_objects(np.zeros((1, 1, 1, 2, levels), int), given=GIVEN)
    np.testing.assert_allclose(unheard.concentration[0, 0], alpha, rtol=1e-3)
    assert unheard.informative.all()
    assert unheard.youden[0, 0] > 0.2


@pytest.mark.parametrize("levels", [2, 4])
def test_labels_of_one_truth_do_not_silence_it(levels):
    counts = counted(np.zeros(12, int), np.zeros(12, int), levels)
    assert not ConfusionPosterior.from_objects(counts).informative.any()
    known = ConfusionPosterior.from_objects(counts, given=GIVEN)
    assert known.informative.all()
    assert known.mean[0, 0, 0, 0] > 0.8


@pytest.mark.parametrize("levels", [2, 4])
def test_many_detectors_at_chance_are_seen_to_be_so(levels):
    rng = np.random.default_rng(4)
    counts = np.zeros((24, 4, 3, 2, levels), int)
    o, p, e = np.indices((24, 4, 3)).reshape(3, -1)
    np.add.at(counts, (o, p, e, o % 2, rng.integers(levels, size=len(o))), 1)
    known = ConfusionPosterior.from_objects(counts, given=np.ones((4, 3), np.bool_))
    assert abs(known.youden).max() < 0.3
    assert abs(known.youden.mean()) < 0.1
    good = np.where(o % 2 == 1, levels - 1, 0)
    counts[:] = 0
    np.add.at(counts, (o, p, e, o % 2, good), 1)
    known = ConfusionPosterior.from_objects(counts, given=np.ones((4, 3), np.bool_))
    assert known.youden.min() > 0.8


def test_the_gate_of_classifiers_stays():
    counts = np.zeros((6, 1, 2, 2, 4), int)
    counts[:, 0, :, 0, 0] = 1  # of both behaviors, one truth alone
    given = np.array([[True, False]])
    known = ConfusionPosterior.from_objects(counts, given=given)
    assert known.informative.tolist() == [[True, False]]
    assert known.given.tolist() == [[True, False]]
    plain = ConfusionPosterior.from_objects(counts)
    np.testing.assert_array_equal(known.concentration[:, 1], plain.concentration[:, 1])
    np.testing.assert_array_equal(known.dispersion[:, 1], plain.dispersion[:, 1])
    assert not plain.given.any()


@generated(st.integers(0, 2**32 - 1), st.sampled_from([2, 4]))
def test_the_prior_is_right_for_the_order_of_objects_and_true_to_the_counts(seed, levels):
    rng = np.random.default_rng(seed)
    truths = rng.integers(2, size=9)
    counts = counted(truths, rng.integers(levels, size=9), levels)
    rows = given_rows(counts, GIVEN)
    mixed = given_rows(counts[rng.permutation(9)], GIVEN)
    for one, other in zip(rows, mixed, strict=True):
        np.testing.assert_allclose(one, other)
    # Labels weigh: the concentration grows by them, and no row is sure.
    assert (rows.concentration > 0).all()
    assert (rows.dispersion > 0).all()
    many = given_rows(np.tile(counts, (20, 1, 1, 1, 1)), GIVEN)
    seen = counts.sum(axis=(0, 1, 2))
    for row, counts_of_row in zip(many.concentration[0], seen, strict=True):
        if counts_of_row.sum() > 2:
            mean = row / row.sum()
            np.testing.assert_allclose(mean, counts_of_row / counts_of_row.sum(), atol=0.12)


def test_a_pair_that_is_heard_for_the_first_time_is_believed_at_once():
    counts = np.zeros((2, 1, 2, 2, 4), int)
    counts[:, 0, 0, 0, 0] = 1
    known = ConfusionPosterior.from_objects(counts)
    heard = known.believe(np.array([[True, True]]))
    assert heard.given.tolist() == [[False, True]]  # of the first there are counts: at the next fit
    np.testing.assert_allclose(heard.concentration[0, 1], generic_prior(4))
    assert heard.believe(np.array([[False, True]])) is heard
    more = heard.update(counts[0])
    np.testing.assert_array_equal(more.given, heard.given)


def test_the_prior_of_dispersions_is_one():
    assert dispersion_prior().sum() == pytest.approx(1.0)

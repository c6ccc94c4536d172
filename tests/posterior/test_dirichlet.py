import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from meal_bayes.domain import Query, load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import Transition, build_momdp, initial_belief, update_belief
from meal_bayes.posterior import ConfusionPosterior

SHAPE = (3, 2, 2, 2)  # (P,E,2,K)


def counts_of(shape, top=30):
    return hnp.arrays(np.int64, shape, elements=st.integers(0, top))


@st.composite
def posteriors(draw, levels=(2, 4)):
    k = draw(st.sampled_from(levels))
    if draw(st.booleans()):
        return ConfusionPosterior.from_counts(draw(counts_of((3, 2, 2, k))))
    return ConfusionPosterior.from_objects(draw(counts_of((4, 3, 2, 2, k), top=3)))


def test_counts_and_prior_make_the_mean():
    posterior = ConfusionPosterior.from_counts([[[[8, 2], [1, 9]]]])
    np.testing.assert_allclose(posterior.mean[0, 0], [[9 / 12, 3 / 12], [2 / 12, 10 / 12]])
    np.testing.assert_allclose(posterior.precision[0, 0], [12, 12])
    posterior = ConfusionPosterior.from_counts([[[[0, 0, 0, 4], [0, 0, 0, 0]]]])
    np.testing.assert_allclose(posterior.mean[0, 0, 0], [0.5 / 6, 0.5 / 6, 0.5 / 6, 4.5 / 6])
    posterior = ConfusionPosterior.from_counts([[[[8, 2], [1, 9]]]], prior=10)
    np.testing.assert_allclose(posterior.mean[0, 0, 0], [13 / 20, 7 / 20])


def test_counts_of_objects_are_added():
    counts = np.ones((4, *SHAPE), dtype=np.int64)
    np.testing.assert_array_equal(ConfusionPosterior.from_counts(counts).counts, 4)
    np.testing.assert_array_equal(ConfusionPosterior.from_objects(counts).counts, 4)


def row_precision(s, a):
    rows = np.full((1, 1, 2, 2), a / 2)
    return ConfusionPosterior(np.zeros_like(rows), rows, np.full((1, 1, 2), s)).precision[0, 0, 0]


def test_the_precision_of_a_row_is_at_most_that_of_either_source():
    assert row_precision(2.0, 20.0) == 40 / 23
    assert row_precision(np.inf, 49.0) == row_precision(49.0, np.inf) == 49.0


@given(posteriors(), st.data())
def test_order_of_updates_does_not_matter(posterior, data):
    first, second = (data.draw(counts_of(posterior.counts.shape, top=5)) for _ in range(2))
    left = posterior.update(first).update(second)
    right = posterior.update(second).update(first)
    np.testing.assert_allclose(left.concentration, right.concentration)
    np.testing.assert_array_equal(left.counts, posterior.counts + first + second)


@given(counts_of(SHAPE), counts_of(SHAPE))
def test_updating_is_counting(first, second):
    together = ConfusionPosterior.from_counts(first + second)
    streamed = ConfusionPosterior.from_counts(first).update(second)
    np.testing.assert_allclose(streamed.mean, together.mean)
    np.testing.assert_allclose(streamed.precision, together.precision)


@given(posteriors(), st.data())
def test_percepts_of_one_object_are_one_row_however_they_come(posterior, data):
    """In parts they are worth what they are worth at once, and all of it can be taken back."""
    first, second = (data.draw(counts_of(posterior.counts.shape, top=5)) for _ in range(2))
    nothing = np.zeros_like(first)
    parts = posterior.update(first).update(first + second, first)
    at_once = posterior.update(first + second)
    np.testing.assert_allclose(parts.concentration, at_once.concentration, rtol=0, atol=1e-9)
    np.testing.assert_array_equal(parts.counts, at_once.counts)
    back = parts.update(nothing, first + second)
    np.testing.assert_allclose(back.concentration, posterior.concentration, rtol=0, atol=1e-12)
    np.testing.assert_array_equal(back.counts, posterior.counts)


@given(posteriors(), st.data())
def test_percepts_of_one_object_are_worth_less(posterior, data):
    new = data.draw(counts_of(posterior.counts.shape, top=5))
    gained = (posterior.update(new).concentration - posterior.concentration).sum(axis=-1)
    n = new.sum(axis=-1)
    s = posterior.dispersion
    expected = np.where(np.isinf(s), n, n * (1 + 1 / s) / (1 + n / s))
    np.testing.assert_allclose(gained, expected, atol=1e-9)
    assert (gained <= n + 1e-9).all()


@given(counts_of((4, *SHAPE), top=3), st.permutations(range(3)))
def test_relabelling_attributes_permutes_the_fit(per_object, order):
    fit = ConfusionPosterior.from_objects(per_object)
    permuted = ConfusionPosterior.from_objects(per_object[:, order])
    np.testing.assert_allclose(permuted.mean, fit.mean[order], rtol=1e-4)
    np.testing.assert_allclose(permuted.precision, fit.precision[order], rtol=1e-3)


@pytest.mark.statistical
@pytest.mark.parametrize(("s", "a", "m"), [(2.0, 20.0, 0.7), (0.8, 6.0, 0.5), (30.0, 9.0, 0.1)])
def test_precision_keeps_the_variance_of_a_new_objects_row(s, a, m):
    rng = np.random.default_rng(3)
    mean = rng.beta(a * m, a * (1 - m), 400_000)
    row = rng.beta(s * mean, s * (1 - mean))
    precision = m * (1 - m) / row.var() - 1
    assert precision == pytest.approx(row_precision(s, a), rel=0.01)


INVERTED = [[[[3, 7], [6, 4]], [[9, 1], [1, 9]]]]  # the first behavior's TPR .4 < FPR .7


def test_percepts_of_inverted_pairs_move_no_belief():
    domain = load_domain("toy")
    per_object = np.zeros((6, 2, 3, 2, 2), dtype=np.int64)
    per_object[:4, :, :, 0] = [2, 3]
    per_object[4:, :, :, 1] = [4, 1]
    posterior = ConfusionPosterior.from_objects(per_object)
    assert posterior.precision[0, 0, 0] != posterior.precision[0, 0, 1]
    inverted = posterior.mean[:1], posterior.precision[:1]
    for rows, moves in ((posterior.select([0]), False), (inverted, True)):
        momdp = build_momdp(domain, Query(("red",)), *rows)
        belief = initial_belief(momdp)
        for _ in range(4):
            belief = update_belief(belief, momdp, Transition(0, 0, np.array([1])))
        assert (abs(belief.log_odds[0]) > 1e-9) == moves


@pytest.mark.parametrize(
    ("rows", "informative"),
    [
        ([[1, 1, 4, 4], [4, 4, 1, 1]], False),  # the upper half of the levels counts
        ([[4, 4, 1, 1], [5, 1, 0, 4]], True),
        # TPR 1 of one percept against FPR .9 of a hundred: with the prior .67 against .89
        ([[10, 90], [0, 1]], False),
        ([[0, 1], [10, 90]], False),  # the prior alone turns the mean around
        ([[0, 0], [0, 0]], False),
    ],
)
def test_a_pair_informs_by_its_counts_and_by_its_mean(rows, informative):
    assert ConfusionPosterior.from_counts([[rows]]).informative[0, 0] == informative


def test_exact_selection_is_the_papers_equation_8():
    posterior = ConfusionPosterior.from_counts(INVERTED)
    _, precision = posterior.select([0, 0], exact=True)
    assert precision.shape == (2, 2, 2)
    assert np.isinf(precision).all()


@pytest.mark.parametrize(
    ("call", "says"),
    [
        (lambda: ConfusionPosterior.from_counts(np.ones((3, 2, 3, 2))), r"of shape \(attributes"),
        (lambda: ConfusionPosterior.from_counts(-np.ones(SHAPE)), "expected numbers >= 0"),
        (lambda: ConfusionPosterior.from_objects(np.ones(SHAPE)), "shape .*; expected"),
        (lambda: ConfusionPosterior.from_objects(np.full((2, *SHAPE), 0.5)), "whole numbers"),
        (
            lambda: ConfusionPosterior(*np.ones((2, *SHAPE)), np.ones(2)),
            "dispersion must be above 0 and of shape",
        ),
    ],
)
def test_wrong_input_teaches(call, says):
    with pytest.raises(SettingsError, match=says):
        call()

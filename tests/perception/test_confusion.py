"""Counts of percepts, and those who perceive: recorded, sampled, and a person who answers."""

import numpy as np
import pytest
from held_out import cohens_kappa
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import cohen_kappa_score

from meal_bayes.datasets import Instance
from meal_bayes.domain import Query
from meal_bayes.errors import SettingsError
from meal_bayes.perception import RecordedPercepts, SampledPercepts, table_counts
from meal_bayes.perception.confusion import youden
from meal_bayes.perception.perceiver import answer


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=2, max_size=60))
def test_kappa_is_cohens(pairs):
    truth, said = np.array(pairs).T
    if len(set(truth)) < 2 or (said.all() and truth.all()):
        return
    table = np.zeros((2, 2), int)
    np.add.at(table, (truth.astype(int), said.astype(int)), 1)
    expected = cohen_kappa_score(truth, said)
    assert cohens_kappa(table) == pytest.approx(expected, abs=1e-12)


def test_four_levels_are_halves_of_yes_and_no():
    four = np.array([[5, 3, 1, 1], [0, 2, 4, 4]])
    two = np.array([[8, 2], [2, 8]])
    assert youden(four) == pytest.approx(youden(two))


@pytest.mark.parametrize("rows", [([0, 0], [0, 0]), ([5, 5], [0, 0]), ([7, 0], [3, 0])])
def test_kappa_is_zero_where_nothing_is_said(rows):
    assert cohens_kappa(np.array(rows)) == 0


@pytest.mark.parametrize(
    ("rows", "expected"),
    [
        (([8, 2], [5, 5]), 0.3),
        (([8, 2], [8, 2]), 0.0),
        (([5, 5], [8, 2]), -0.3),
        (([5, 5], [0, 0]), 0.0),  # no true object
    ],
)
def test_youden_s_j_is_hits_less_false_alarms(rows, expected):
    assert youden(np.array(rows)) == pytest.approx(expected)


def test_table_counts_put_each_object_in_the_row_of_its_label(small_table):
    counts = table_counts(small_table, 1, levels=4)
    assert counts.shape == (4, 2, 4, 2, 4)
    assert counts[1].sum() == 0  # the held-out object
    for o in (0, 2, 3):
        for p in range(2):
            label = small_table.labels[o, p]
            shown = small_table.training_levels(1, 4)[o, p]
            if label < 0:
                assert counts[o, p].sum() == 0
            else:
                np.testing.assert_array_equal(counts[o, p, :, label], shown)
                assert counts[o, p, :, 1 - label].sum() == 0


BOTH = Query(("heavy", "red"))  # not in the domain's order


@pytest.fixture
def rng():
    return np.random.default_rng(3)


def test_recorded_percepts_are_looked_up_by_object_recording_and_behavior(small_table, rng):
    for levels, o, r in np.ndindex(2, 4, 3):
        perceiver = RecordedPercepts(small_table, 2 + 2 * levels)
        expected = small_table.levels_of(small_table.log_odds[o, r, 1, [1, 0]], 2 + 2 * levels)
        shown = perceiver.observe(Instance(o, "lift", r), BOTH, rng)
        assert shown.tolist() == expected.tolist()
    with pytest.raises(SettingsError, match=r"has no percepts of \['heavy', 'red'\] by 'reinit'"):
        perceiver.observe(Instance(0, "reinit", 0), BOTH, rng)


@pytest.mark.statistical
@pytest.mark.parametrize("n", [1, 2, 3])
def test_each_attribute_of_an_answer_is_right_with_its_accuracy(rng, n):
    labels = np.array([1, 0, 1], np.int8)[:n]
    trials = 4000
    right = np.mean([answer(labels, 0.7, 4, rng) == labels * 3 for _ in range(trials)], axis=0)
    assert (abs(right - 0.7) < 5 * np.sqrt(0.7 * 0.3 / trials)).all()


def test_answers_come_from_the_labels_and_in_extreme_levels(small_table, rng):
    quarters = np.full((2, 4, 2, 4), 0.25)
    for perceiver in (
        RecordedPercepts(small_table, 4),
        SampledPercepts(small_table.domain, small_table.labels, quarters),
    ):
        drawn = np.array([perceiver.observe(Instance(1, "ask", 0), BOTH, rng) for _ in range(50)])
        assert set(drawn.ravel()) == {0, 3}
        assert ((drawn == [0, 3]).mean(axis=0) > 0.5).all()  # heavy: no, red: yes


def test_nobody_knows_is_a_coin(rng):
    yes = [int(answer(np.array([-1], np.int8), 1.0, 2, rng)[0]) for _ in range(400)]
    assert 100 < sum(yes) < 300


@pytest.mark.statistical
def test_the_sampler_draws_from_the_row_of_the_truth(small_table, rng):
    confusion = np.random.default_rng(0).dirichlet(np.ones(4), size=(2, 4, 2))
    sampler = SampledPercepts(small_table.domain, small_table.labels, confusion)
    instance = Instance(0, "lift", 0)  # red: false, heavy: true
    drawn = np.array([sampler.observe(instance, BOTH, rng) for _ in range(4000)])
    for column, row in ((0, confusion[1, 1, 1]), (1, confusion[0, 1, 0])):
        share = np.bincount(drawn[:, column], minlength=4) / len(drawn)
        assert (np.abs(share - row) < 5 * np.sqrt(row * (1 - row) / len(drawn)) + 1e-9).all()

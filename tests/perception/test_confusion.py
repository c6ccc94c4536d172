import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import cohen_kappa_score

from meal_bayes.errors import DataError
from meal_bayes.perception import ConfusionCounts, table_counts
from meal_bayes.perception.confusion import cohens_kappa, youden


def counts_of(*rows):
    """Counts of one object, attribute and behavior from its rows [false, true]."""
    return ConfusionCounts(np.array(rows)[None, None, None])


@given(st.lists(st.tuples(st.booleans(), st.booleans()), min_size=2, max_size=60))
def test_kappa_is_cohens(pairs):
    truth, said = np.array(pairs).T
    if len(set(truth)) < 2 or (said.all() and truth.all()):
        return
    table = np.zeros((2, 2), int)
    np.add.at(table, (truth.astype(int), said.astype(int)), 1)
    expected = cohen_kappa_score(truth, said)
    assert cohens_kappa(counts_of(*table).total())[0, 0] == pytest.approx(expected, abs=1e-12)


def test_four_levels_are_halves_of_yes_and_no():
    four, two = counts_of([5, 3, 1, 1], [0, 2, 4, 4]), counts_of([8, 2], [2, 8])
    assert youden(four.total()) == pytest.approx(youden(two.total()))
    assert four.levels == 4


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


def test_a_wrong_shape_is_refused():
    with pytest.raises(DataError, match=r"expected \(O,P,E,2,K\)"):
        ConfusionCounts(np.zeros((3, 2)))


def test_table_counts_put_each_object_in_the_row_of_its_label(small_table):
    counts = table_counts(small_table, 1, levels=4)
    assert counts.counts.shape == (4, 2, 4, 2, 4)
    assert counts.counts[1].sum() == 0  # the held-out object
    for o in (0, 2, 3):
        for p in range(2):
            label = small_table.labels[o, p]
            shown = small_table.training_levels(1, 4)[o, p]
            if label < 0:
                assert counts.counts[o, p].sum() == 0
            else:
                np.testing.assert_array_equal(counts.counts[o, p, :, label], shown)
                assert counts.counts[o, p, :, 1 - label].sum() == 0

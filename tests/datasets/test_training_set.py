"""D is a set: order and repetition of additions do not matter."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import TrainingSet, make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError

ROW = st.tuples(st.integers(0, 3), st.integers(0, 1), st.integers(0, 2), st.sampled_from([0, 1]))
TRUTH = np.array([[1, 0], [0, 0], [1, 1], [0, 1]], dtype=np.int8)


def make(rows):
    """Build D from (object, behavior, recording, which attribute was asked)."""
    training = TrainingSet.empty(2)
    for o, e, r, asked in rows:
        labels = np.full(2, -1, dtype=np.int8)
        labels[asked] = TRUTH[o, asked]
        training = training.extend(o, e, r, labels)
    return training


def same(a, b):
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("object", "behavior", "recording", "labels")
    )


@pytest.fixture
def dataset():
    return make_synthetic(load_domain("toy"), objects=4, recordings=3, rng=np.random.default_rng(0))


@given(st.lists(ROW, max_size=12), st.randoms())
def test_order_and_repetition_do_not_matter(rows, random):
    shuffled = [*rows, *rows[:3]]
    random.shuffle(shuffled)
    training = make(rows)
    assert same(training, make(shuffled))
    assert len(training) == len({row[:3] for row in rows})
    known = {(*row[:3], row[3]) for row in rows}
    assert (training.labels >= 0).sum() == len(known)


@given(st.lists(ROW, max_size=12), st.integers(0, 3))
def test_without_leaves_the_others_as_they_are(rows, held_out):
    left = make(rows).without(held_out)
    assert same(left, make([row for row in rows if row[0] != held_out]))
    assert held_out not in left.object


def test_batch_equals_single_additions():
    rows = [(0, 1, 2, 0), (3, 0, 1, 1), (0, 1, 2, 1)]
    labels = [[1, -1], [-1, 1], [-1, 0]]
    keys = np.array(rows).T
    together = TrainingSet.empty(2).extend(keys[0], keys[1], keys[2], labels)
    assert same(together, make(rows))
    assert together.labels.tolist() == [[1, 0], [-1, 1]]


def test_everything(dataset):
    whole = TrainingSet.everything(dataset)
    assert len(whole) == 4 * 2 * 3  # reinit has no recordings
    assert set(whole.behavior) == {0, 1}
    np.testing.assert_array_equal(whole.labels, dataset.labels[whole.object])
    some = TrainingSet.everything(dataset, objects=[3, 1, 1])
    assert same(some, whole.without(0, 2))
    assert len(TrainingSet.everything(dataset, objects=[])) == 0
    assert same(whole.extend(some.object, some.behavior, some.recording, some.labels), whole)


def test_contradiction_is_refused():
    training = TrainingSet.empty(2).extend(0, 0, 0, [1, -1])
    with pytest.raises(DataError, match="attribute 0 is both true and false"):
        training.extend(0, 0, 0, [0, -1])


@pytest.mark.parametrize(
    ("labels", "message"), [([1, 3], "the label 3"), ([[1, 0], [0, 1]], "expected .1, attributes.")]
)
def test_bad_labels_are_refused(labels, message):
    with pytest.raises(DataError, match=message):
        TrainingSet.empty(2).extend(0, 0, 0, labels)

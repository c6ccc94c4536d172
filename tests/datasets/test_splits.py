"""Splits keep whole objects apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import Dataset, ObjectSplit, make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError


def small(objects):
    rng = np.random.default_rng(objects)
    return make_synthetic(load_domain("toy"), objects=objects, recordings=1, rng=rng)


@given(st.integers(3, 40), st.integers(0, 2**32))
def test_three_equal_disjoint_parts(objects, seed):
    split = ObjectSplit.random(small(objects), np.random.default_rng(seed))
    parts = [split.pre, split.train, split.test]
    assert sorted(np.concatenate(parts)) == list(range(objects))
    sizes = [len(part) for part in parts]
    assert max(sizes) - min(sizes) <= 1
    assert sizes == sorted(sizes, reverse=True)  # CY101: 34, 33, 33
    again = ObjectSplit.random(small(objects), np.random.default_rng(seed))
    assert all(
        (a == b).all() for a, b in zip(parts, (again.pre, again.train, again.test), strict=True)
    )


def test_minimum_of_positives_in_each_part():
    dataset = small(24)
    rng = np.random.default_rng(3)
    for _ in range(20):
        split = ObjectSplit.random(dataset, rng, minimum=3)
        for part in (split.pre, split.train, split.test):
            assert (dataset.labels[part].sum(axis=0) >= 3).all()


def test_sizes_may_leave_objects_out():
    split = ObjectSplit.random(small(20), np.random.default_rng(0), sizes=(3, 8, 5))
    assert (len(split.pre), len(split.train), len(split.test)) == (3, 8, 5)


@pytest.mark.parametrize("sizes", [(1, 1), (0, 3, 3), (5, 5, 5)])
def test_sizes_that_do_not_fit(sizes):
    with pytest.raises(SettingsError, match="do not fit 12 objects"):
        ObjectSplit.random(small(12), np.random.default_rng(0), sizes=sizes)


def test_minimum_that_cannot_be():
    with pytest.raises(SettingsError, match=r"Only 6 objects are 'red'; 3 in each .* need 9"):
        ObjectSplit.random(small(12), np.random.default_rng(0), minimum=3)
    labels = np.repeat([[1, 0], [0, 1]], 6, axis=0)  # six of each, yet parts too small for both
    dataset = small(12)
    exclusive = Dataset(dataset.domain, dataset.objects, dataset.features, labels)
    with pytest.raises(SettingsError, match=r"No split of 50 has 2 .* lower the minimum"):
        ObjectSplit.random(
            exclusive, np.random.default_rng(0), sizes=(3, 3, 3), minimum=2, tries=50
        )
    ObjectSplit.random(
        exclusive, np.random.default_rng(0), sizes=(3, 3, 3), minimum=2, attributes=["red"]
    )


def test_parts_must_be_disjoint():
    with pytest.raises(SettingsError, match="in two parts"):
        ObjectSplit([0, 1], [1], [2])

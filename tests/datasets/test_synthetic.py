"""Made-up data have the structure that they promise; splits keep whole objects apart."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import Dataset, make_synthetic
from meal_bayes.datasets.training_set import ObjectSplit
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError


@given(st.integers(1, 50), st.integers(1, 4), st.integers(1, 9), st.integers(0, 2**32))
def test_any_size_and_exclusive_groups(objects, recordings, dimensions, seed):
    domain = load_domain("roc36")
    dataset, again = (
        make_synthetic(
            domain, objects=objects, recordings=recordings, dimensions=dimensions,
            rng=np.random.default_rng(seed),
        )
        for _ in range(2)
    )  # fmt: skip
    np.testing.assert_array_equal(dataset.labels, again.labels)
    assert dataset.features["look", "color"].shape == (objects, recordings, dimensions)
    assert len(dataset.features) == 22
    for members in domain.groups.values():
        columns = [domain.attribute_index(name) for name in members]
        assert (dataset.labels[:, columns].sum(axis=1) == 1).all()
        counts = dataset.labels[:, columns].sum(axis=0)
        assert counts.max() - counts.min() <= 1


def test_free_attributes_are_balanced():
    dataset = make_synthetic(
        load_domain("toy"), objects=11, recordings=1, rng=np.random.default_rng(1)
    )
    assert dataset.labels.sum(axis=0).tolist() == [5, 5]


@pytest.mark.statistical
def test_object_effect_makes_repeats_dependent():
    def between(effect):
        """Variance of the objects' means, beyond what recordings of variance 1 / 50 explain."""
        dataset = make_synthetic(
            load_domain("toy"), objects=300, recordings=50, signal=0.0, object_effect=effect,
            rng=np.random.default_rng(5),
        )  # fmt: skip
        return float(dataset.features["look", "color"].mean(axis=1).var() - 1 / 50)

    # 300 objects x 8 dimensions: the relative standard error of a variance is sqrt(2 / 2400)
    assert between(0.0) == pytest.approx(0.0, abs=5 * 0.03 / 50)
    assert between(1.5) == pytest.approx(2.25, rel=5 * 0.03)


@pytest.mark.statistical
def test_signal_moves_the_classes_apart():
    def distance(signal):
        """Distance of two classes' means, of which 20,000 recordings leave an error of .03."""
        dataset = make_synthetic(
            load_domain("toy"), objects=8, recordings=20_000, signal=signal, object_effect=0.0,
            rng=np.random.default_rng(6),
        )  # fmt: skip
        means, (red, heavy) = dataset.features["look", "color"].mean(axis=1), dataset.labels.T == 1
        return float(np.linalg.norm(means[red & heavy][0] - means[~red & heavy][0]))

    assert distance(0.0) < 0.1
    assert 0.2 < distance(2.0) <= 2.1
    assert distance(4.0) == pytest.approx(2 * distance(2.0), abs=0.2)


@pytest.mark.parametrize(
    ("name", "value"),
    [("objects", 0), ("recordings", 0), ("dimensions", 0), ("signal", -1.0),
     ("object_effect", float("nan"))],
)  # fmt: skip
def test_settings_out_of_range(name, value):
    options = {"objects": 3, "recordings": 1, "rng": np.random.default_rng(0), name: value}
    with pytest.raises(SettingsError, match=name):
        make_synthetic(load_domain("toy"), **options)


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

"""Made-up data have the structure that they promise."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import make_synthetic
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

"""The public recordings themselves: shapes, labels, repairs."""

import numpy as np
import pytest

from meal_bayes.datasets import load_dataset
from meal_bayes.domain import domain_names, load_domain

pytestmark = pytest.mark.real_data


@pytest.fixture(scope="module")
def loaded(recordings):
    return {name: load_dataset(name, root=recordings) for name in ("roc36", "ispy32", "cy101")}


def test_roc36(loaded):
    roc36 = loaded["roc36"]
    assert roc36.labels.shape == (36, 10)
    assert roc36.recordings == 10
    assert len(roc36.features) == 22
    assert roc36.features["look", "color"].shape == (36, 10, 76)
    assert roc36.features["lift_slow", "audio"].shape == (36, 10, 50)
    assert roc36.labels.sum(axis=0).tolist() == [12] * 6 + [9] * 4
    for members in roc36.domain.groups.values():
        columns = [roc36.domain.attribute_index(name) for name in members]
        assert (roc36.labels[:, columns].sum(axis=1) == 1).all()
    first = roc36.instance(0, "look", 2).features
    assert first is not None
    np.testing.assert_allclose(first["color"][:2], [0.16385252, -11.10606688])


def test_ispy32(loaded):
    ispy32 = loaded["ispy32"]
    assert ispy32.labels.shape == (32, 81)
    assert ispy32.recordings == 5
    assert len(ispy32.features) == 27
    positive = ispy32.labels.sum(axis=0)
    least = ispy32.domain.asked_minimum
    assert ((positive > least) & (32 - positive > least)).sum() == 37
    assert ispy32.features["look", "fc7"].shape == (32, 5, 4096)
    assert ispy32.features["grasp", "haptics"].shape == (32, 5, 60)
    assert np.isclose(ispy32.features["grasp", "haptics"][0, 0, 0], 0.163382)
    both = ispy32.labels[:, [ispy32.domain.attribute_index(w) for w in ("heavy", "light")]].all(1)
    assert (np.flatnonzero(both) + 1).tolist() == [22, 24]
    cup = ispy32.objects.index("pineapple_cup")
    assert ispy32.labels[cup, ispy32.domain.attribute_index("pineapple")] == 1


def test_cy101(loaded):
    cy101 = loaded["cy101"]
    assert cy101.labels.shape == (100, 10)
    assert "no_object" not in cy101.objects
    assert cy101.recordings == 5
    assert len(cy101.features) == 48
    assert cy101.labels.sum(axis=0).tolist() == [17, 25, 23, 36, 42, 35, 32, 16, 21, 20]
    color = cy101.features["look", "color"]
    assert color.min() == 0
    assert color[cy101.objects.index("smallstuffedanimal_moose"), 1, 82] == 129
    ball = cy101.objects.index("ball_base")
    assert np.isclose(cy101.features["push", "flow"][ball, 0, 0], 48.434673258635215)


def test_published_domains_read_the_same_recordings(recordings, loaded):
    published = load_dataset("roc36_published", root=recordings)
    assert published.domain == load_domain("roc36_published")
    for context, values in published.features.items():
        np.testing.assert_array_equal(values, loaded["roc36"].features[context])
    homes = {load_domain(name).data for name in domain_names() if name.endswith("_published")}
    assert homes == {"roc36", "ispy32", "cy101"}

"""A data set and D are what they promise: of what is given, and of what is made up."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from meal_bayes.datasets import Dataset, TrainingSet, make_synthetic, object_index
from meal_bayes.domain import load_domain
from meal_bayes.errors import DataError, MealBayesError, SettingsError

LOOK = ("look", "color")
FEATURES = {LOOK: np.arange(12.0).reshape(2, 3, 2), ("lift", "haptics"): np.zeros((2, 3, 1))}


def fields(**changes):
    whole = {"domain": load_domain("toy"), "objects": ("cup", "stone")}
    return {**whole, "features": FEATURES, "labels": [[1, 0], [0, -1]], **changes}


def test_instance_has_the_features_of_its_behavior():
    instance = Dataset(**fields()).instance(1, "look", 2)
    assert instance.features is not None
    assert set(instance.features) == {"color"}
    assert instance.features["color"].tolist() == [10, 11]
    assert (instance.object_index, instance.behavior, instance.recording) == (1, "look", 2)


def test_arrays_are_read_only():
    dataset = Dataset(**fields())
    for array in (dataset.labels, *dataset.features.values()):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"labels": [[1, 0]]}, r"expected \(objects, attributes\) = \(2, 2\)"),
        ({"labels": [[1, 0], [0, 2]]}, "the label 2"),
        ({"labels": np.array([[1, 0], [0, 257]])}, "the label 257"),  # 1 in eight bits
        ({"labels": [["True", "False"], ["True", "False"]]}, "the label 'True'"),
        ({"objects": ("cup", "cup")}, "'cup' is listed twice"),
        ({"features": {}}, "Features of .* are missing"),
        ({"features": {LOOK: np.zeros((2, 3))}}, "found shape"),
        ({"features": {LOOK: np.full((2, 3, 2), "4_0")}}, "found text"),
        ({"features": {LOOK: np.full((2, 3, 2), 1j)}}, "found complex"),
        ({"features": {**FEATURES, LOOK: np.full((2, 3, 1), np.nan)}}, "infinity for every object"),
        ({"features": {**FEATURES, LOOK: np.zeros((2, 2, 1))}}, "same number of recordings"),
    ],
)
def test_bad_parts_are_refused(changes, message):
    with pytest.raises(DataError, match=message):
        Dataset(**fields(**changes))


def test_labels_that_are_not_known_are_not_false():
    labels = [[1.0, np.nan], [None, False]]
    assert Dataset(**fields(labels=labels)).labels.tolist() == [[1, -1], [-1, 0]]


def test_object_index():
    assert object_index(("cup", "stone"), "stone") == 1
    with pytest.raises(SettingsError, match="did you mean 'stone'"):
        object_index(("cup", "stone"), "stome")


def same(a, b):
    return all(
        np.array_equal(getattr(a, name), getattr(b, name))
        for name in ("object", "behavior", "recording", "labels")
    )


@pytest.fixture
def dataset():
    return make_synthetic(load_domain("toy"), objects=4, recordings=3, rng=np.random.default_rng(0))


@given(st.permutations(range(4)))
def test_order_does_not_matter(order):
    keys = np.array([(0, 1, 2), (0, 1, 0), (3, 0, 1), (0, 0, 1)])
    labels = np.eye(4, dtype=np.int8)
    training = TrainingSet(*keys.T, labels)
    assert same(training, TrainingSet(*keys[order].T, labels[order]))
    assert training.object.tolist() == [0, 0, 0, 3]
    assert training.labels.argmax(axis=1).tolist() == [3, 1, 0, 2]


def test_everything(dataset):
    whole = TrainingSet.everything(dataset)
    assert len(whole) == 4 * 2 * 3  # reinit has no recordings
    assert set(whole.behavior) == {0, 1}
    np.testing.assert_array_equal(whole.labels, dataset.labels[whole.object])
    some = TrainingSet.everything(dataset, objects=[3, 1, 1])
    assert some.object.tolist() == [o for o in whole.object if o in (1, 3)]
    assert len(TrainingSet.everything(dataset, objects=[])) == 0


@pytest.mark.parametrize(
    ("keys", "labels", "message"),
    [
        ([[0, 0, 0]], [[1, 3]], "the label 3"),
        ([[0, 0, 0]], [[1, 0], [0, 1]], "expected .1, attributes."),
        ([[0, 0, 0]] * 2, [[1, -1], [0, -1]], "has two rows"),
    ],
)
def test_bad_labels_are_refused(keys, labels, message):
    with pytest.raises(DataError, match=message):
        TrainingSet(*np.array(keys).T, labels)


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


@pytest.mark.long
@pytest.mark.statistical
def test_signal_moves_the_classes_apart():
    def distance(signal):
        """Distance of two classes' means, of which 20,000 recordings leave an error of .03."""
        dataset = make_synthetic(
            load_domain("toy"), objects=8, recordings=20_000, signal=signal, object_effect=0.0,
            rng=np.random.default_rng(6),
        )  # fmt: skip
        means = dataset.features["look", "color"].mean(axis=1)
        (red, heavy) = dataset.labels.T == 1
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


@pytest.mark.parametrize("place", [-1, -2, 99, 2**40, 1.0, True, None, "cup 1", (0,), [0.0]])
def test_a_place_is_one_of_the_list(dataset, place):
    """A negative one would count from the end, in silence."""
    behavior = dataset.domain.behavior_names[0]
    for call in (
        lambda: dataset.instance(place, behavior, 0),
        lambda: dataset.instance(0, behavior, place),
        lambda: TrainingSet.everything(dataset, [0, place]),
    ):
        with pytest.raises(DataError, match="from 0"):
            call()
    if isinstance(place, int) and place < 0:
        with pytest.raises(DataError, match="from 0"):
            TrainingSet([place], [0], [0], np.zeros((1, 2), np.int8))


@pytest.mark.parametrize("name", [5, None, 1.5, b"x", (1,), ["x"]])
def test_what_is_no_name_is_unknown(dataset, name):
    domain = dataset.domain
    for call in (
        lambda: domain.behavior_index(name),
        lambda: domain.columns([name]),
        lambda: domain.labels(name),
        lambda: domain.labels({repr(name): True}),
        lambda: object_index(dataset.objects, name),
    ):
        with pytest.raises(MealBayesError, match=r"Unknown|Labels are|is .*; give "):
            call()

"""The online protocol: which objects teach, which are asked about, the same for every agent."""

from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import Dataset, make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.errors import SettingsError
from meal_bayes.experiments.online import Protocol, learnable, restricted

LEARNABLE = (
    "aluminum", "red", "can", "full", "empty", "metallic", "tall", "short", "liquid", "metal",
)  # fmt: skip


@pytest.fixture(scope="module")
def dataset():
    rng = np.random.default_rng(0)
    return make_synthetic(load_domain("toy"), objects=30, recordings=2, rng=rng)


def protocol(dataset, *, attributes=1, seed=0, repeat=0, shares=(33, 33, 34)):
    return Protocol.of(dataset, attributes=attributes, seed=seed, repeat=repeat, shares=shares)


@pytest.mark.parametrize("repeat", range(5))
def test_parts_are_disjoint_and_hold_every_object(dataset, repeat):
    split = protocol(dataset, repeat=repeat).split
    parts = [set(part.tolist()) for part in (split.pre, split.train, split.test)]
    assert sorted(map(len, parts)) == [10, 10, 10]
    assert set.union(*parts) == set(range(30))
    for part in (split.pre, split.train, split.test):
        assert (dataset.labels[part] == 1).sum(axis=0).min() >= 3


@pytest.mark.parametrize(("positives", "each"), [(9, 3), (7, 2), (2, 0)])
def test_rare_attributes_are_in_every_part_where_they_can_be(dataset, positives, each):
    labels = dataset.labels.copy()
    labels[:, 0] = np.arange(30) < positives
    rare = Dataset(dataset.domain, dataset.objects, dataset.features, labels)
    for repeat in range(4):
        split = protocol(rare, repeat=repeat).split
        counts = [labels[part, 0].sum() for part in (split.pre, split.train, split.test)]
        assert min(counts) >= each


def test_fractions_are_followed(dataset):
    split = protocol(dataset, shares=(1, 1, 4)).split
    assert [len(part) for part in (split.pre, split.train, split.test)] == [5, 5, 20]


def test_a_split_may_be_named(dataset):
    parts = (dataset.objects[3:5], dataset.objects[:3], dataset.objects[5:])
    split = protocol(dataset, shares=parts, repeat=3).split
    assert [list(part) for part in (split.pre, split.train)] == [[3, 4], [0, 1, 2]]
    assert len(split.test) == len(dataset.objects) - 5
    for wrong, message in (("nothing", "Unknown object 'nothing'"), (parts[1][0], "in two parts")):
        with pytest.raises(SettingsError, match=message):
            protocol(dataset, shares=((wrong,), *parts[1:]))
    with pytest.raises(SettingsError, match=r"sizes \[0, 0, 30\] do not fit 30 objects"):
        protocol(dataset, shares=(1, 1, 400))


def test_seed_and_repeat_make_other_splits_and_the_same_makes_the_same(dataset):
    splits = {
        tuple(protocol(dataset, seed=seed, repeat=repeat).split.test.tolist())
        for seed in (0, 1)
        for repeat in (0, 1)
    }
    assert len(splits) == 4
    assert protocol(dataset).tests() == protocol(dataset).tests()


@pytest.mark.parametrize("attributes", [1, 2])
def test_tests_ask_each_object_each_query_once(dataset, attributes):
    plan = protocol(dataset, attributes=attributes)
    tasks = plan.tests()
    pairs = [(task.object_index, task.query.attributes) for task in tasks]
    assert len(set(pairs)) == len(pairs) == 10 * (2 if attributes == 1 else 1)
    assert {o for o, _ in pairs} == set(plan.split.test.tolist())
    assert all(dataset.objects[task.object_index] == task.object_name for task in tasks)
    assert len({task.key for task in tasks}) == len(tasks)


def test_training_asks_about_train_objects_only_and_anew_in_every_batch(dataset):
    plan = protocol(dataset)
    batches = [plan.training(batch, 200) for batch in (1, 2)]
    for tasks in batches:
        assert {task.object_index for task in tasks} == set(plan.split.train.tolist())
        assert {task.query.attributes for task in tasks} == {("red",), ("heavy",)}
    keys = [task.key for tasks in batches for task in tasks]
    keys += [task.key for task in plan.tests()]
    assert len(set(keys)) == len(keys)
    assert [t.object_index for t in batches[0]] != [t.object_index for t in batches[1]]
    assert plan.training(1, 200) == batches[0]


def test_what_nobody_knows_is_not_asked(dataset):
    labels = dataset.labels.copy()
    labels[::2, 0] = -1
    hidden = Dataset(dataset.domain, dataset.objects, dataset.features, labels)
    for attributes in (1, 2):
        plan = protocol(hidden, attributes=attributes)
        for task in plan.tests() + plan.training(1, 100):
            columns = [hidden.domain.attribute_index(name) for name in task.query.attributes]
            assert (hidden.labels[task.object_index, columns] >= 0).all()


def test_at_most_340_tests_a_batch():
    rng = np.random.default_rng(0)
    data = make_synthetic(load_domain("ispy32"), objects=30, recordings=1, rng=rng, dimensions=2)
    assert len(protocol(data, attributes=1).tests()) == 340


def test_more_attributes_than_there_are_cannot_be_asked(dataset):
    with pytest.raises(SettingsError, match=r"attributes is 3; toy has 2"):
        protocol(dataset, attributes=3)


def test_nothing_to_ask_is_said(dataset):
    unknown = np.full_like(dataset.labels, -1)
    with pytest.raises(SettingsError, match="No object of the train part"):
        protocol(Dataset(dataset.domain, dataset.objects, dataset.features, unknown))


def test_ten_attributes_of_ispy32_can_be_learned(ispy32):
    chosen = learnable(ispy32)
    assert chosen == LEARNABLE
    places = [ispy32.domain.attributes.index(name) for name in chosen]
    assert places == sorted(places)
    for p in places:
        known = ispy32.labels[:, p]
        assert min((known == 1).sum(), (known == 0).sum()) >= 9


def test_restricted_keeps_the_columns_of_what_is_kept():
    rng = np.random.default_rng(1)
    data = make_synthetic(load_domain("roc36"), objects=12, recordings=1, rng=rng, dimensions=2)
    names = ("heavy", "blue", "beans")
    part = restricted(data, names)
    assert part.domain.attributes == names
    for name in names:
        np.testing.assert_array_equal(
            part.labels[:, part.domain.attribute_index(name)],
            data.labels[:, data.domain.attribute_index(name)],
        )
    rated = restricted(replace(data, answers=1 - data.labels), names)
    np.testing.assert_array_equal(rated.answers, 1 - part.labels)
    assert part.answers is None
    assert part.features.keys() == data.features.keys()
    assert set(part.domain.synonyms.values()) <= set(names)
    group, members = next(iter(data.domain.groups.items()))
    assert restricted(data, members).domain.groups == {group: members}

import dataclasses
import math
from collections import Counter

import numpy as np
import pytest

from meal_bayes.errors import SettingsError
from meal_bayes.experiments import askable, offline_tasks


def pairs_of(tasks):
    return [(task.object_index, task.query.attributes) for task in tasks]


def describes(table, task):
    """Whether every value that a task names is the object's own."""
    columns = [table.domain.attribute_index(name) for name in task.query.attributes]
    return bool((table.labels[task.object_index, columns] == 1).all())


def first_comes_once(pairs, count):
    """Whether each of `count` pairs comes once before any comes twice."""
    rounds = [pairs[start : start + count] for start in range(0, len(pairs), count)]
    return all(len(set(part)) == len(part) for part in rounds)


class TestRoc36:
    @pytest.mark.parametrize("n", [1, 2, 3])
    def test_one_attribute_of_each_of_n_groups(self, roc36, n):
        group_of = {name: g for g, names in roc36.domain.groups.items() for name in names}
        groups = set()
        for task in offline_tasks(roc36, n, 200, 0):
            asked = [group_of[name] for name in task.query.attributes]
            assert len(set(asked)) == len(asked) == n
            groups.add(frozenset(asked))
        assert len(groups) == math.comb(3, n)

    @pytest.mark.parametrize("n", [1, 2, 3])
    def test_half_of_the_queries_describe_the_object(self, roc36, n):
        tasks = offline_tasks(roc36, n, 400, 1)
        assert [describes(roc36, task) for task in tasks] == [True, False] * 200

    @pytest.mark.parametrize(("n", "first", "second"), [(2, 36 * 3, 36 * 30), (3, 36, 36 * 35)])
    def test_each_pair_comes_once_before_any_comes_twice(self, roc36, n, first, second):
        tasks = offline_tasks(roc36, n, 2 * second + 10, 2)
        assert first_comes_once(pairs_of(tasks[0::2]), first)
        assert first_comes_once(pairs_of(tasks[1::2]), second)
        assert len(set(pairs_of(tasks))) == first + second

    def test_what_describes_an_object_varies(self, roc36):
        """The other half names at least one value that is not the object's own, evenly."""
        wrong = Counter()
        for task in offline_tasks(roc36, 3, 2000, 3)[1::2]:
            columns = [roc36.domain.attribute_index(name) for name in task.query.attributes]
            wrong[int((roc36.labels[task.object_index, columns] == 0).sum())] += 1
        shares = np.array([wrong[k] for k in (1, 2, 3)]) / 1000
        np.testing.assert_allclose(shares, np.array([7, 16, 12]) / 35, atol=0.02)


class TestWithoutGroups:
    def test_ispy32_asks_37_of_its_81(self, ispy32):
        names = askable(ispy32)
        assert len(names) == 37
        for name in ispy32.domain.attributes:
            column = ispy32.labels[:, ispy32.domain.attribute_index(name)]
            few = min((column == 1).sum(), (column == 0).sum())
            assert (few > 5) == (name in names)

    def test_cy101_asks_the_ten(self, cy101):
        assert askable(cy101) == cy101.domain.attributes
        tasks = offline_tasks(cy101, 1, 1500, 0)
        count = len(cy101.objects) * 10
        assert first_comes_once(pairs_of(tasks), count)
        assert len(set(pairs_of(tasks))) == min(1500, count)

    @pytest.mark.parametrize(("n", "count"), [(1, 600), (2, 600), (3, 5000), (5, 600)])
    def test_only_askable_attributes_distinct_and_none_twice(self, ispy32, n, count):
        """Three of 37 for 32 objects are 248,640: few enough for birthdays to coincide."""
        tasks = offline_tasks(ispy32, n, count, 5)
        names = set(askable(ispy32))
        assert all(set(task.query.attributes) <= names for task in tasks)
        assert all(len(set(task.query.attributes)) == n for task in tasks)
        assert len(set(pairs_of(tasks))) == count

    @pytest.mark.statistical
    def test_objects_and_attributes_are_uniform(self, ispy32):
        tasks = offline_tasks(ispy32, 4, 4000, 7)
        objects = Counter(task.object_index for task in tasks)
        names = Counter(name for task in tasks for name in task.query.attributes)
        for counts, kinds, n in ((objects, 32, 4000), (names, 37, 16000)):
            p = 1 / kinds
            expected = np.array([counts[kind] for kind in counts])
            assert len(counts) == kinds
            assert (np.abs(expected / n - p) <= 5 * np.sqrt(p * (1 - p) / n)).all()

    def test_what_nobody_labelled_is_not_asked(self, ispy32):
        rng = np.random.default_rng(0)
        labels = np.array(ispy32.labels)
        labels[rng.random(labels.shape) < 0.3] = -1
        table = dataclasses.replace(ispy32, labels=labels)
        for n in (1, 2, 4):
            for task in offline_tasks(table, n, 200, 8):
                columns = [table.domain.attribute_index(name) for name in task.query.attributes]
                assert (labels[task.object_index, columns] >= 0).all()


class TestSeeds:
    @pytest.mark.parametrize("n", [1, 3])
    def test_equal_seeds_give_equal_tasks_and_fewer_trials_a_part_of_them(self, roc36, n):
        tasks = offline_tasks(roc36, n, 100, 9)
        assert offline_tasks(roc36, n, 100, 9) == tasks
        assert offline_tasks(roc36, n, 30, 9) == tasks[:30]
        assert pairs_of(offline_tasks(roc36, n, 100, 10)) != pairs_of(tasks)

    def test_keys_name_every_trial(self, roc36):
        tasks = offline_tasks(roc36, 2, 700, 11)
        assert len({task.key for task in tasks}) == 700  # though pairs come again
        assert len({task.name for task in tasks}) == 700
        for task in tasks:
            assert task.object_name == roc36.objects[task.object_index]


def test_values_of_too_few_objects_are_not_asked_in_groups_either(roc36):
    domain = dataclasses.replace(roc36.domain, asked_minimum=9)
    table = dataclasses.replace(roc36, domain=domain)
    names = {*askable(table)}
    assert 0 < len(names) < len(domain.attributes)
    for n in (1, 2):
        asked = [task.query.attributes for task in offline_tasks(table, n, 100, 0)]
        assert {name for attributes in asked for name in attributes} == names


class TestMistakes:
    @pytest.mark.parametrize("n", [-1, 0, 38])
    def test_attributes_out_of_range(self, ispy32, n):
        with pytest.raises(SettingsError, match="give a number from 1 to 37"):
            offline_tasks(ispy32, n, 10, 0)

    def test_more_than_any_object_has_labels_of(self, roc36):
        labels = np.full_like(roc36.labels, -1)
        for index in range(36):
            labels[index, [index % 10, (index + 1) % 10]] = index % 2
        domain = dataclasses.replace(roc36.domain, asked_minimum=-1, groups={})
        table = dataclasses.replace(roc36, domain=domain, labels=labels)
        assert len(offline_tasks(table, 2, 20, 0)) == 20
        with pytest.raises(SettingsError, match="no object has labels of more than 2"):
            offline_tasks(table, 3, 20, 0)

    def test_labels_of_true_values_alone_tell_the_others(self, roc36):
        groups = {"weight": ("heavy", "light"), "color": ("blue", "green")}
        domain = dataclasses.replace(roc36.domain, groups=groups, asked_minimum=-1)
        labels = np.array(roc36.labels)
        both = list(domain.columns(sum(groups.values(), ())))
        labels[:, both] = np.where(labels[:, both] == 1, 1, -1)
        fitting = dataclasses.replace(roc36, domain=domain, labels=labels)
        fits = [describes(fitting, task) for task in offline_tasks(fitting, 2, 20, 0)]
        assert sum(fits) == 10  # a group's true value says what the others are
        labels[:, both] = -1
        with pytest.raises(SettingsError, match="each of 2 groups"):
            offline_tasks(dataclasses.replace(fitting, labels=labels), 2, 20, 0)

"""Equality, membership and hashes of values that hold arrays; numbers of numpy as settings."""

import copy
import dataclasses
import importlib
import pkgutil
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays, scalar_dtypes

import meal_bayes
from meal_bayes import Learner, load_percepts
from meal_bayes.arrays import ByValue, equal_values, hash_of
from meal_bayes.datasets import Instance, TrainingSet, make_synthetic
from meal_bayes.domain import load_domain
from meal_bayes.posterior.dirichlet import ConfusionPosterior
from meal_bayes.robots.robot import Frame, Outcome

ARRAYS = arrays(scalar_dtypes(), array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=3))
LEAVES = st.one_of(st.none(), st.booleans(), st.floats(), st.integers(), st.text(), ARRAYS)
VALUES = st.recursive(
    LEAVES,
    lambda inner: st.one_of(
        st.lists(inner, max_size=3),
        st.tuples(inner, inner),
        st.dictionaries(st.text(max_size=2), inner, max_size=3),
    ),
    max_leaves=6,
)


@given(VALUES, VALUES)
def test_any_two_values_are_equal_or_not_and_equal_ones_have_one_hash(first, second):
    assert equal_values(first, copy.deepcopy(first))
    assert hash_of(first) == hash_of(copy.deepcopy(first))
    equal = equal_values(first, second)
    assert isinstance(equal, bool)
    assert equal == equal_values(second, first)
    if equal:
        assert hash_of(first) == hash_of(second)


@given(ARRAYS.filter(lambda array: array.size and array.dtype.kind in "iuf"), st.data())
def test_arrays_with_another_entry_are_not_equal(array, data):
    other = array.copy()
    index = data.draw(st.sampled_from(range(array.size)))
    old = other.flat[index]
    other.flat[index] = 1 if not old or np.isnan(old) else 0
    assert Outcome("here", {"c": array}) != Outcome("here", {"c": other})
    assert Outcome("here", {"c": array}) == Outcome("here", {"c": array.copy()})


@pytest.fixture(scope="module")
def values():
    """Return a value of each public class that holds arrays."""
    toy = load_domain("toy")
    dataset = make_synthetic("toy", objects=4, recordings=2, rng=np.random.default_rng(0))
    learner = Learner("roc36", agent="greedy", seed=1, logs=None).fit(load_percepts("roc36"))
    trial = learner.ask("red", "heavy_blue_beans")
    frame = Frame(0.5, *(np.ones((2, 3), np.float32) for _ in range(8)))
    step = trial.steps[0] if trial.steps else None
    held = [
        trial, step, trial.first_belief, trial.momdp, dataset, TrainingSet.everything(dataset),
        dataset.instance(0, "look", 0), load_percepts("roc36"), frame,
        learner.knowledge("heavy_blue_beans"),
        ConfusionPosterior.from_counts(np.ones((1, 1, 2, 2))), Instance(0, "look", 0),
        toy.diagram.compile(toy.behavior_names),
        Outcome("here", {"c": np.ones(3)}),
    ]  # fmt: skip
    if step is not None:
        held.append(step.decision)
    return [value for value in held if value is not None]


def test_copies_are_equal_and_found_and_others_are_not(values):
    for index, value in enumerate(values):
        twin = copy.deepcopy(value)
        assert value == twin
        assert not (value != twin)  # noqa: SIM202  a tuple has its own
        assert twin in values
        assert values.index(twin) == index
        assert hash(value) == hash(twin)
        assert len({value, twin}) == 1
        assert value != "a text"
        assert value != np.ones(3)
        others = [other for other in values if other is not value]
        assert value not in others


def test_an_entry_of_any_array_counts(values):
    for value in values:
        for field in dataclasses.fields(value) if dataclasses.is_dataclass(value) else ():
            array = getattr(value, field.name)
            if not (field.compare and isinstance(array, np.ndarray) and array.size):
                continue
            changed = array.copy()
            changed.flat[-1] = 0 if changed.flat[-1] == 1 else 1
            other = copy.copy(value)
            object.__setattr__(other, field.name, changed)
            assert other != value


def test_every_frozen_dataclass_with_arrays_is_compared_by_value():
    """Python would compare arrays by `==`, whose truth value is ambiguous."""
    unsafe = []
    for module in pkgutil.walk_packages(meal_bayes.__path__, "meal_bayes."):
        if module.name.endswith("__main__"):
            continue
        try:
            classes = vars(importlib.import_module(module.name)).values()
        except ImportError:  # an extra that is not installed
            continue
        for kind in classes:
            if not (isinstance(kind, type) and dataclasses.is_dataclass(kind)):
                continue
            if kind.__module__ == "meal_bayes.trial_log.messages":
                continue  # they are written and read; nobody compares them
            settings = kind.__dataclass_params__
            held = [f.type for f in dataclasses.fields(kind) if f.compare]
            texts = [str((t, get_args(t))) for t in held]
            arrays_held = any("ndarray" in text and "Callable" not in text for text in texts)
            if settings.eq and settings.frozen and arrays_held and not issubclass(kind, ByValue):
                unsafe.append(kind.__name__)
    assert not {*unsafe}

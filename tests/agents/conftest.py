"""A small percept table that is made up, and what trials of it need."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from meal_bayes.datasets import PerceptTable
from meal_bayes.datasets.percepts import BIN_EDGES
from meal_bayes.domain import Query, load_domain
from meal_bayes.learner import Learner
from meal_bayes.trials import Task

OBJECTS = 8
RECORDINGS = 4


def make_table(name: str = "toy", seed: int = 0, *, signal: float = 2.0) -> PerceptTable:
    """Make log-odds that follow the truth, for held-out and training side alike."""
    rng = np.random.default_rng(seed)
    domain = load_domain(name)
    p = len(domain.attributes)
    e = len(domain.behaviors)
    labels = np.array([rng.permutation(OBJECTS) % 2 for _ in range(p)], dtype=np.int8).T
    mean = signal * (2.0 * labels - 1)[:, None, None] * rng.uniform(0, 1, (e, p))  # (O,1,E,P)
    log_odds = np.clip(rng.normal(mean, 1.0, (OBJECTS, RECORDINGS, e, p)), -8, 8)
    training = rng.normal(mean, 1.0, (OBJECTS, OBJECTS, RECORDINGS, e, p))
    bins = np.zeros((OBJECTS, OBJECTS, p, e, len(BIN_EDGES) + 1), np.uint8)
    place = np.searchsorted(BIN_EDGES, training)
    for level in range(len(BIN_EDGES) + 1):
        bins[..., level] = (place == level).sum(axis=2).transpose(0, 1, 3, 2)
    bins[np.arange(OBJECTS), np.arange(OBJECTS)] = 0
    for index, behavior in enumerate(domain.behaviors):
        if not behavior.modalities:
            log_odds[:, :, index] = np.nan
            bins[..., index, :] = 0
    names = tuple(f"object_{number}" for number in range(OBJECTS))
    return PerceptTable(domain, names, labels, log_odds, BIN_EDGES, bins, {"source": "made up"})


def change_object(table: PerceptTable, index: int, seed: int = 1) -> PerceptTable:
    """Change all that the table says of one object: its labels and its recordings' outputs."""
    rng = np.random.default_rng(seed)
    labels, log_odds, bins = (
        np.array(a) for a in (table.labels, table.log_odds, table.training_bins)
    )
    labels[index] = 1 - labels[index]
    log_odds[index] = -log_odds[index] + rng.normal(size=log_odds[index].shape).round(1)
    log_odds = np.clip(log_odds, -8, 8)
    bins_of_object = bins[:, index]  # (O,P,E,L), by classifiers of every held-out object
    bins[:, index] = np.roll(bins_of_object, 3, axis=-1)
    return dataclasses.replace(table, labels=labels, log_odds=log_odds, training_bins=bins)


def make_task(table: PerceptTable, index: int, *attributes: str) -> Task:
    names = attributes or table.domain.attributes[:2]
    key = (table.domain.data, index, *names)
    return Task(f"task {index}", Query(names), index, table.objects[index], key)


def make_learner(table: PerceptTable, agent: object, seed: int = 0, **options: object) -> Learner:
    return Learner(table.domain, agent=agent, seed=seed, logs=None, **options).fit(table)


@pytest.fixture(scope="session")
def table() -> PerceptTable:
    return make_table()


@pytest.fixture(scope="session")
def make() -> SimpleNamespace:
    """The makers."""
    return SimpleNamespace(
        table=make_table, task=make_task, change_object=change_object, learner=make_learner
    )

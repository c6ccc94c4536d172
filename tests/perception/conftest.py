"""A small domain whose behaviors have several modalities, and data sets on it."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from meal_bayes.datasets import Dataset, PerceptTable, make_synthetic
from meal_bayes.datasets.percepts import BIN_EDGES
from meal_bayes.domain import Behavior, Domain, load_domain

MakeDataset = Callable[..., Dataset]


@pytest.fixture(scope="session")
def domain() -> Domain:
    """Return `toy` with three modalities a behavior, and a person to ask."""
    toy = load_domain("toy")
    many = tuple(
        replace(behavior, modalities=("a", "b", "c")) if behavior.modalities else behavior
        for behavior in toy.behaviors
    )
    ask = replace(toy.diagram.effects[0], behavior="ask", source="x1", target="x1")
    return replace(
        toy,
        behaviors=(*many, Behavior("ask", 9.0, answer_accuracy=0.7)),
        diagram=replace(toy.diagram, effects=(*toy.diagram.effects, ask)),
    )


@pytest.fixture(scope="session")
def make(domain: Domain) -> MakeDataset:
    """Make a data set of any size: `make(seed, objects=..., signal=...)`."""

    def build(seed: int, **options: float) -> Dataset:
        sizes = {"objects": 10, "recordings": 2, "dimensions": 5, **options}
        return make_synthetic(domain, rng=np.random.default_rng(seed), **sizes)

    return build


@pytest.fixture(scope="session")
def relabel() -> Callable[[Dataset, np.ndarray], Dataset]:
    """Give a data set other labels."""

    def build(dataset: Dataset, labels: np.ndarray) -> Dataset:
        return Dataset(dataset.domain, dataset.objects, dataset.features, labels)

    return build


@pytest.fixture
def small_table(domain: Domain) -> PerceptTable:
    """Return a table of random percepts: 4 objects, 3 recordings, one unknown label."""
    rng = np.random.default_rng(0)
    log_odds = np.full((4, 3, 4, 2), np.nan)
    log_odds[:, :, :2] = rng.normal(size=(4, 3, 2, 2)) * 3
    bins = np.zeros((4, 4, 2, 4, 8), np.uint8)
    bins[:, :, :, :2] = rng.multinomial(3, np.full(8, 1 / 8), size=(4, 4, 2, 2))
    bins[np.arange(4), np.arange(4)] = 0
    labels = np.array([[0, 1], [1, 0], [1, -1], [0, 0]])
    names = ("cup", "tin", "jar", "box")
    return PerceptTable(domain, names, labels, log_odds, BIN_EDGES, bins, {"package": "test"})

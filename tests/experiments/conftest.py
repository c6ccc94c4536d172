"""The shipped tables, loaded once."""

import pytest

from meal_bayes.datasets import PerceptTable, load_percepts


@pytest.fixture(scope="session")
def roc36() -> PerceptTable:
    return load_percepts("roc36")


@pytest.fixture(scope="session")
def ispy32() -> PerceptTable:
    return load_percepts("ispy32")


@pytest.fixture(scope="session")
def cy101() -> PerceptTable:
    return load_percepts("cy101")

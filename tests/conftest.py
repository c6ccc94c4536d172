"""What all tests share: recordings and reference models, where they are at hand."""

import os
from pathlib import Path

import pytest


def missing(reason: str) -> None:
    """Skip loudly, or fail where everything is required (CI)."""
    if os.environ.get("MEAL_BAYES_REQUIRE_ALL") == "1":
        pytest.fail(f"required but missing: {reason}")
    pytest.skip(reason)


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Skip what takes minutes, and say so, unless everything is required (CI)."""
    if os.environ.get("MEAL_BAYES_REQUIRE_ALL") == "1":
        return
    for item in items:
        if item.get_closest_marker("long"):
            item.add_marker(pytest.mark.skip(reason="long; set MEAL_BAYES_REQUIRE_ALL=1"))


@pytest.fixture(scope="session")
def recordings() -> Path:
    """Return the folder mirror of the public recordings."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "datasets"
    folder = Path(os.environ.get("MEAL_BAYES_DATA_URL", beside))
    if not folder.is_dir():
        missing(f"no real recordings in {folder}; set MEAL_BAYES_DATA_URL to a folder mirror")
    return folder


@pytest.fixture(scope="session")
def reference() -> Path:
    """Return the folder of the reference models."""
    beside = Path(__file__).resolve().parents[2] / "shared" / "reference"
    folder = Path(os.environ.get("MEAL_BAYES_REFERENCE", beside))
    if not folder.is_dir():
        missing(f"no reference models in {folder}; set MEAL_BAYES_REFERENCE")
    return folder

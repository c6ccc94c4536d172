"""The package of the checkout, imported as `meal-bayes reproduce` imports it."""

import sys
from pathlib import Path

import pytest

from meal_bayes.cli.reproduce import import_package

FOLDER = Path(__file__).resolve().parents[2] / "paper_repro"
import_package(FOLDER)  # before the tests are, which import from it


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let full runs write to a folder of the test's own."""
    frame = sys.modules["paper_repro.frame"]
    monkeypatch.setattr(frame, "RESULTS", tmp_path / "results")
    assert frame.RESULTS != FOLDER / "results"
    return tmp_path / "results"

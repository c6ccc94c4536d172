"""The scripts of paper_repro/, imported as `meal-bayes reproduce` imports them."""

import sys
from importlib import import_module
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[2]
SCRIPTS = ROOT / "paper_repro"


class Scripts:
    """Modules of paper_repro by name."""

    def __getattr__(self, name: str) -> ModuleType:
        return import_module(name)


@pytest.fixture
def scripts(monkeypatch: pytest.MonkeyPatch) -> Scripts:
    monkeypatch.syspath_prepend(str(SCRIPTS))
    return Scripts()


@pytest.fixture
def elsewhere(scripts: Scripts, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let full runs write to a folder of the test's own."""
    for module in (scripts.frame, scripts.pages):  # both imported before either is changed
        monkeypatch.setattr(module, "RESULTS", tmp_path / "results")
    assert sys.modules["frame"].RESULTS != SCRIPTS / "results"
    return tmp_path / "results"

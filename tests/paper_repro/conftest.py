"""The package of the checkout, imported as `meal-bayes reproduce` imports it."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.trials import TrialOutcomes

TRIALS = 2000
OBJECTS = 20
FOLDER = Path(__file__).resolve().parents[2] / "paper_repro"
sys.path.insert(0, str(FOLDER.parent))  # before the tests are, which import from it


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Let full runs write to a folder of the test's own."""
    frame = sys.modules["paper_repro.frame"]
    monkeypatch.setattr(frame, "RESULTS", tmp_path / "results")
    assert frame.RESULTS != FOLDER / "results"
    return tmp_path / "results"


@pytest.fixture
def outcomes() -> Callable[..., TrialOutcomes]:
    """Return a maker of trials whose costs and rewards have a mean of exactly `level`.

    Of the reports a share `right` is right in both attributes; the first trials have none.
    """

    def make(
        level: float,
        spread: float = 1.0,
        *,
        right: float = 1.0,
        seed: int = 0,
        abstained: float = 0.0,
    ) -> TrialOutcomes:
        rng = np.random.default_rng(seed)
        number = np.arange(TRIALS)
        noise = rng.standard_normal(TRIALS)
        values = level + spread * (noise - noise.mean())
        report = np.repeat(rng.permutation(TRIALS) < round(right * TRIALS), 2).reshape(-1, 2)
        report = np.where((number < round(abstained * TRIALS))[:, None], -1, report)
        nothing = np.zeros((TRIALS, 0), int)
        return TrialOutcomes(
            behaviors=(), agent=np.full(TRIALS, "morc"), key=number.astype(str),
            object_index=number % OBJECTS, object_name=(number % OBJECTS).astype(str),
            attribute=np.full((TRIALS, 2), [["a", "b"]]), truth=np.ones((TRIALS, 2)), report=report,
            positive=np.full((TRIALS, 2), 0.5), cost=values, reward=values,
            ended=np.full(TRIALS, ""), steps=np.zeros(TRIALS), executed=nothing, failed=nothing,
        )  # fmt: skip

    return make

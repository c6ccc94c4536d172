"""The page 'From nothing to answers' is filled from measured results, with its pictures."""

import json
import runpy
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "simulated_page.py"
SUMMARY = {
    "trials": 200, "accuracy": 0.914, "accuracy_se": 0.013, "cost_s": 5.25, "reward": 77.1,
    "ece": 0.031, "ece_if_calibrated": 0.022, "cpu_s": 0.41,
}  # fmt: skip
RESULTS = {
    "answers": {
        "every_behavior_once_s": 16.0,
        "bayes": SUMMARY,
        "morc": {**SUMMARY, "accuracy": 0.873},
        "reward_bayes_minus_morc": {"estimate": 8.4, "se": 2.0, "low": 4.1, "high": 12.7},
    },
    "labels": {"accuracy": 0.47, "standard_errors_from_base_rate": 0.6},
    "content": {
        "behaviors": {"look": {"balanced_accuracy": 0.5}, "shake": {"balanced_accuracy": 1.0}}
    },
}
CURVE = [{"hours": 0.1 * n, "accuracy": 0.7, "reward": 40.0 + n, "ece": 0.05} for n in range(6)]
LIVE = {
    "population": {"objects": 300, "executions": 6400, "curves": {"bayes": CURVE}},
    "live": {
        "seed": 4,
        "curve": [
            {"trials": 20, "agent": "random_legal", "accuracy": 0.6, "cost_s": 21.0},
            {"trials": 40, "agent": "bayes", "accuracy": 0.8, "cost_s": 7.0},
        ],
        "last_50": 0.86,
        "offline_on_the_same_objects": 0.88,
    },
}


@pytest.mark.usefixtures("sim")
def test_the_page_tells_what_was_measured(tmp_path, monkeypatch):
    files = [tmp_path / "most.json", tmp_path / "live.json"]
    for file, results in zip(files, (RESULTS, LIVE), strict=True):
        file.write_text(json.dumps(results))
    argv = [str(SCRIPT), "--out", str(tmp_path), "--results", *map(str, files)]
    monkeypatch.setattr(sys, "argv", argv)
    runpy.run_path(str(SCRIPT), run_name="__main__")
    page = (tmp_path / "from_nothing_to_answers.md").read_text()
    assert "| bayes | 0.914 ± 0.013 | 5.2 | 77.1 | 0.031 (0.022) | 0.41 |" in page
    assert "| morc | 0.873" in page
    assert "8.4 (95 % from 4.1 to 12.7)" in page
    assert "| look | shake |\n| --: | --: |\n| 0.50 | 1.00 |" in page
    assert "The last 50 trials: 0.86 right" in page
    assert "| bayes | 40.0, 41.0, 42.0, 43.0, 44.0, 45.0 | 0.700 | 0.050 | 0.50 |" in page
    for name in ("simulated_arm.png", "simulated_live.png"):
        assert f"]({name})" in page
        assert (tmp_path / name).stat().st_size > 1000

"""Benchmarks run, repeat themselves, add up, find what they look for, and fill their page."""

import importlib
import json
import os
import runpy
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.evaluation import Estimate
from meal_bayes.trial_log import read_header, read_trials, write_trials

SCRIPT = Path(__file__).resolve().parents[2] / "benchmarks" / "planner.py"
NUMBERS = {
    "value", "value_se", "accuracy", "cost_s", "abstained", "ms_per_decision", "solve_s",
    "upper_bound", "gap", "episodes",
}  # fmt: skip
TIMES = {"ms_per_decision", "solve_s", "simulations_per_s"}


def run(*arguments: str) -> list[dict[str, object]]:
    done = subprocess.run(
        [sys.executable, os.fspath(SCRIPT), "--json", *arguments],
        capture_output=True, encoding="utf-8", check=True,
    )  # fmt: skip
    return json.loads(done.stdout)["rows"]


@pytest.fixture(scope="module")
def rows() -> list[dict[str, object]]:
    return run(
        "--models", "clean1", "--policies", "olfc,factored,pomcp:1500 simulations,random_legal",
        "--episodes", "110", "--jobs", "1",
    )  # fmt: skip


@pytest.mark.long
def test_rows_hold_what_they_promise(rows: list[dict[str, object]]) -> None:
    for row in rows:
        assert all(type(row[key]) is float for key in NUMBERS)
        assert (row["model"], row["episodes"]) == ("clean1", 110)
        assert row["gap"] == pytest.approx(row["upper_bound"] - row["value"])
        assert 0 <= row["accuracy"] <= 1 - row["abstained"]
        assert row["value"] <= row["upper_bound"] + 4 * row["value_se"]
    olfc, factored, search, random = rows
    assert (search["policy"], search["budget"]) == ("pomcp", "1500 simulations")
    assert olfc["gain_over_olfc"] is None
    assert search["simulations_per_s"] > 0
    assert factored["simulations_per_s"] is None
    for row in rows[1:]:
        assert row["gain_over_olfc"] == pytest.approx(row["value"] - olfc["value"])
    assert random["gain_over_olfc"] < -4 * random["gain_over_olfc_se"]
    assert search["value"] >= random["value"]


@pytest.mark.long
def test_processes_change_nothing(rows: list[dict[str, object]]) -> None:
    again = run(
        "--models", "clean1", "--policies", "olfc,pomcp:1500 simulations",
        "--episodes", "110", "--jobs", "2",
    )  # fmt: skip
    first, second = (
        {row["policy"]: {key: row[key] for key in row if key not in TIMES} for row in each}
        for each in (rows, again)
    )
    assert second == {policy: first[policy] for policy in second}


@pytest.mark.long
def test_unknown_names_are_told() -> None:
    done = subprocess.run(
        [sys.executable, os.fspath(SCRIPT), "--models", "A9"],
        capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "'A9' is none of A1" in done.stderr


BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.mark.long
def test_it_finds_nothing():
    done = subprocess.run(
        [sys.executable, os.fspath(BENCHMARKS / "fuzz.py"), "--json", "--inputs", "24",
         "--only", "log", "--only", "toml"],
        capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    facts = json.loads(done.stdout)
    assert facts["told"] == []
    assert facts["inputs"] == 48
    assert {facts[key] for key in ("silent", "hangs", "tracebacks", "changed")} == {0}
    assert 0 < facts["peak_mb"] <= 500


@pytest.fixture
def fuzz(monkeypatch):
    """The command's module, and a tally."""
    import fuzz  # noqa: PLC0415  of the benchmarks

    monkeypatch.setattr(fuzz, "MEMORY", float("inf"))  # of this process: other tests' too
    return fuzz, fuzz.Tally()


def test_a_wrong_result_is_counted(fuzz, tmp_path):
    module, tally = fuzz
    module.make_sound(tmp_path)
    for kind, name in module.FILES.items():
        for reading in module.readings(kind, tmp_path / name):
            tally.run(kind, reading, tmp_path / name)
    assert not tally.counts  # of what is sound, nothing is wrong
    log = tmp_path / module.FILES["log"]
    other = tmp_path / "other.mcap"
    write_trials(other, list(read_trials(log))[:-1], header=read_header(log))
    tally.run("a trial less", module.readings("log", log)[0], other)
    assert tally.counts == {"silent": 1}


def test_an_unforeseen_error_a_changed_file_and_memory_are_counted(fuzz, tmp_path, monkeypatch):
    module, tally = fuzz
    (path := tmp_path / "a").write_text("1")
    tally.run("breaks", lambda _: {}["key"], path)
    tally.run("changes", lambda path: path.write_text("2"), path)
    monkeypatch.setattr(module, "MEMORY", 1.0)
    tally.run("takes", lambda _: None, path)
    assert tally.counts == {"tracebacks": 1, "changed": 1, "memory": 1}
    assert "KeyError" in tally.told[0]


PAGE = Path(__file__).resolve().parents[2] / "benchmarks" / "simulated_page.py"
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
    argv = [str(PAGE), "--out", str(tmp_path), "--results", *map(str, files)]
    monkeypatch.setattr(sys, "argv", argv)
    runpy.run_path(str(PAGE), run_name="__main__")
    page = (tmp_path / "from_nothing_to_answers.md").read_text()
    assert "| bayes | 0.914 ± 0.013 | 5.2 | 77.1 | 0.031 (0.022) | 0.41 |" in page
    assert "| morc | 0.873" in page
    assert "8.4 (95 % from 4.1 to 12.7)" in page
    assert "| look | shake |\n| --: | --: |\n| 0.50 | 1.00 |" in page
    assert "In the last 50 trials, 0.86 of the answers are right" in page
    assert "| bayes | 40.0, 41.0, 42.0, 43.0, 44.0, 45.0 | 0.700 | 0.050 | 0.50 |" in page
    for name in ("simulated_arm.png", "simulated_live.png"):
        assert f"]({name})" in page
        assert (tmp_path / name).stat().st_size > 1000


@pytest.fixture
def losses(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("losses")


def test_what_a_reward_lacks_is_data_plans_and_sensors(losses):
    known = Estimate(300.0, 10.0, 30)
    gap = Estimate(-5.0, 8.0, 30)
    for doubled in (-20.0, 50.0, 900.0):
        gains = losses.split(known, Estimate(doubled, 12.0, 30), gap, 499.5)
        assert sum(gain.estimate for gain in gains) == pytest.approx(199.5)
        assert min(gain.estimate for gain in gains) >= 0
    assert losses.split(known, Estimate(50.0, 12.0, 30), gap, 499.5).data.estimate == 50.0
    assert losses.cheapest_percept(load_percepts("roc36")) == 0.5


def test_halves_have_the_tasks_of_all_and_learn_from_their_own_half(losses):
    whole = load_percepts("roc36")
    every = np.arange(len(whole.objects))
    same = losses.joined(whole, [every], [whole])
    np.testing.assert_array_equal(same.log_odds, whole.log_odds)
    np.testing.assert_array_equal(same.training_bins, whole.training_bins)
    parts = [every[::2], every[1::2]]
    tables = [
        replace(
            whole,
            objects=tuple(whole.objects[o] for o in part),
            labels=whole.labels[part],
            log_odds=whole.log_odds[part],
            training_bins=whole.training_bins[np.ix_(part, part)],
            recording_counts=whole.recording_counts[part],
            groups=np.arange(len(part)),
        )
        for part in parts
    ]
    halves = losses.joined(whole, parts, tables)
    np.testing.assert_array_equal(halves.log_odds, whole.log_odds)  # each object's own
    assert (halves.labels == whole.labels).all()
    for o in (4, 17):
        mine = np.isin(every, parts[o % 2])
        np.testing.assert_array_equal(halves.training_bins[o, mine], whole.training_bins[o, mine])
        assert not halves.training_bins[o, ~mine].any()


def test_bars_add_up_to_what_the_reward_lacks(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    rows = importlib.import_module("readme").kept()["losses"]["rows"]
    ax = importlib.import_module("readme_picture").draw_losses(rows)
    ends = np.max([[bar.get_x() + bar.get_width() for bar in part] for part in ax.containers], 0)
    assert np.allclose(ends, [row["data"] + row["plans"] + row["sensors"] for row in rows])

"""The planner benchmark runs, repeats itself whatever the number of processes, and adds up."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

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
    one, two = (
        {row["policy"]: {key: row[key] for key in row if key not in TIMES} for row in each}
        for each in (rows, again)
    )
    assert two == {policy: one[policy] for policy in two}


def test_unknown_names_are_told() -> None:
    done = subprocess.run(
        [sys.executable, os.fspath(SCRIPT), "--models", "A9"],
        capture_output=True, encoding="utf-8", check=False,
    )  # fmt: skip
    assert done.returncode == 2
    assert "'A9' is none of A1" in done.stderr

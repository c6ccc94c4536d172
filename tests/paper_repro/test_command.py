"""`meal-bayes reproduce` as a reader types it."""

import json
import os
import subprocess
import sys
from pathlib import Path

import click
import pytest
from click.testing import CliRunner

import meal_bayes
from meal_bayes.cli import main
from meal_bayes.cli.reproduce import find_package
from meal_bayes.planners import POMCP, warm_up
from paper_repro import frame

ROOT = Path(__file__).resolve().parents[2]
FOLDER = ROOT / "paper_repro"
PACKAGE = Path(meal_bayes.__file__).resolve().parents[1]
NEED_RECORDINGS = {"table2", "table3", "table4", "eq7", "fig10", "fig11", "fig12", "eq10",
                   "pomdpsol", "hierarchical"}  # fmt: skip


def reproduce(*arguments, cwd=ROOT, **variables):
    path = os.pathsep.join([str(PACKAGE), os.environ.get("PYTHONPATH", "")])
    if "MEAL_BAYES_DATA_URL" not in os.environ:
        variables.setdefault("MEAL_BAYES_OFFLINE", "1")  # a test downloads nothing
    return subprocess.run(
        [sys.executable, "-P", "-m", "meal_bayes", "reproduce", *map(str, arguments)],
        cwd=cwd, env={**os.environ, "PYTHONPATH": path, **variables}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip


@pytest.mark.long
def test_all_items_quickly(tmp_path):
    before = {path: path.stat().st_mtime_ns for path in FOLDER.rglob("*.[jmp]*") if path.is_file()}
    warm_up(POMCP())  # the first run on a machine does, in half a minute
    done = reproduce("all", "--quick", "--json", "--jobs", 2, "--logs", tmp_path)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    found = {one["item"]: one for one in told["items"]}
    assert {*found, *told["skipped"]} == set(frame.items())
    assert set(told["skipped"]) <= NEED_RECORDINGS
    if "MEAL_BAYES_DATA_URL" in os.environ:
        assert set(told["skipped"]) <= {"pomdpsol"}  # where no pomdpsol is
    for item, one in found.items():
        assert one["tables"][0]["rows"], item
        assert one["verdict"], item
        assert "--quick" in one["command"]
        for name in one["figures"]:
            assert (tmp_path / "paper_repro" / name).stat().st_size > 1000
    after = {path: path.stat().st_mtime_ns for path in before}
    assert after == before
    again = reproduce("all", "--quick", "--json", "--logs", tmp_path)
    assert json.loads(again.stdout) == told  # from the logs


def test_without_the_items_one_line_says_where_they_are(tmp_path):
    done = reproduce("table5", cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert "--scripts" in done.stderr
    assert "checkout" in done.stderr
    done = reproduce("table5", "--quick", "--scripts", FOLDER, cwd=tmp_path)
    assert done.returncode == 0
    assert "reproduced (1 stands, 7 by construction)" in done.stdout
    assert "| shake | no | 0.060 | 0.059 |" in done.stdout


def test_the_items_are_found_here_and_above(tmp_path, monkeypatch):
    monkeypatch.chdir(FOLDER / "items")
    assert find_package(None) == FOLDER
    monkeypatch.chdir(tmp_path)
    with pytest.raises(click.UsageError, match="source code"):
        find_package(None)
    (tmp_path / "paper_repro").mkdir()  # a folder of that name is not enough
    with pytest.raises(click.UsageError):
        find_package(None)


@pytest.fixture
def in_checkout(monkeypatch):
    """Return a function that runs the command in this process, without recordings."""
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "1")

    def invoke(*arguments):
        return CliRunner().invoke(main, ["reproduce", *map(str, arguments)], catch_exceptions=False)

    return invoke


def test_what_is_not_asked_for_is_told(in_checkout, tmp_path):
    done = in_checkout("fig10", "--repeats", 0, "--quick", "--json", "--logs", tmp_path)
    assert json.loads(done.stdout)["skipped"] == {"fig10": "none of its online runs is asked for"}
    done = in_checkout("fig10", "--only", "nothing", "--quick", "--json", "--logs", tmp_path)
    (found,) = json.loads(done.stdout)["items"]
    assert found["verdict"] == "not run"
    assert {one["outcome"] for one in found["statements"]} == {None}


def test_missing_recordings_are_told_in_a_line(in_checkout, tmp_path, monkeypatch):
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", "")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path))
    done = in_checkout("table2", "--quick", "--logs", tmp_path)
    assert done.exit_code == 0, done.stderr
    assert "table2 is skipped" in done.stderr

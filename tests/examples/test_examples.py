"""Every example runs, is short, and says what it should."""

import ast
import runpy
import sys
from pathlib import Path

import pytest

from meal_bayes.trial_log import read_trials

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def play(script, monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", [str(script), *words])
    return runpy.run_path(str(script), run_name="__main__")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_examples_are_short(script):
    assert len(script.read_text(encoding="utf-8").splitlines()) < 60


def test_own_robot(folder, monkeypatch, capsys):
    script = EXAMPLES / "own_robot.py"
    play(script, monkeypatch, str(EXAMPLES / "kitchen.toml"))
    assert capsys.readouterr().out == "it says: not red, full\n"
    (log,) = (folder / "logs" / "kitchen").glob("*.mcap")
    (trial,) = read_trials(log)
    assert trial.agent == "bayes"
    assert (folder / "logs" / "kitchen.mind").is_file()


def test_the_driver_is_short_and_needs_nothing_but_the_package():
    tree = ast.parse((EXAMPLES / "own_robot.py").read_text(encoding="utf-8"))
    imported = {
        name.name for node in ast.walk(tree) if isinstance(node, ast.Import) for name in node.names
    }
    assert imported == {"sys", "numpy", "meal_bayes"}
    assert not [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]
    (arm,) = (node for node in tree.body if isinstance(node, ast.ClassDef))
    assert arm.end_lineno - arm.lineno + 1 <= 25


def test_own_planner(folder, monkeypatch, capsys):
    names = play(EXAMPLES / "own_planner.py", monkeypatch)
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in lines] == ["random_legal", "predefined_plus", "Cautious"]
    assert names["Cautious"]().sure == 0.95
    assert len(list((folder / "logs").rglob("*.mcap"))) == 3

"""Every example runs, is short, and says what it should."""

import re
import runpy
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.trial_log import read_trials

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
NUMBER = re.compile(r"\d+\.\d+")
SCRIPTS = sorted(EXAMPLES.glob("*.py"))


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def shown(page):
    """The text below the example of a page that bears its name."""
    text = (EXAMPLES.parent / "docs" / "tutorials" / f"{page}.md").read_text(encoding="utf-8")
    (output,) = re.findall(r'^--8<-- "examples/.*"\n```\n\n```text\n(.*?)^```$', text, re.M | re.S)
    return output


def check_output(printed, page):
    """Compare a printed text with a page's; numbers with a point may differ by 2 %."""
    assert NUMBER.sub("", printed).split() == NUMBER.sub("", page).split()
    numbers, expected = ([float(n) for n in NUMBER.findall(text)] for text in (printed, page))
    np.testing.assert_allclose(numbers, expected, rtol=0.02, atol=0.02)


def play(script, monkeypatch, *words):
    monkeypatch.setattr(sys, "argv", [str(script), *words])
    return runpy.run_path(str(script), run_name="__main__")


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_examples_are_short(script):
    assert len(script.read_text(encoding="utf-8").splitlines()) < 60


def test_own_robot(folder, monkeypatch, capsys):
    shutil.copytree(EXAMPLES, folder / "examples")
    play(EXAMPLES / "own_robot.py", monkeypatch)
    assert capsys.readouterr().out == "{'red': False, 'full': True}\n"
    (log,) = (folder / "logs" / "kitchen").glob("*.mcap")
    (trial,) = read_trials(log)
    assert trial.agent == "bayes"


def test_arrays(folder, monkeypatch, capsys):
    play(EXAMPLES / "arrays.py", monkeypatch)
    assert capsys.readouterr().out == "{'heavy': True, 'fill': 'half'} True\n"


def test_own_planner(folder, monkeypatch, capsys):
    names = play(EXAMPLES / "own_planner.py", monkeypatch)
    check_output(capsys.readouterr().out, shown("own-planner"))
    assert names["Cautious"]().sure == 0.95
    assert len(list((folder / "logs").rglob("*.mcap"))) == 3


@pytest.mark.long
def test_policy_gradient(folder, monkeypatch, capsys):
    """Trained for two batches, it need not be good yet; `bayes` is."""
    play(EXAMPLES / "policy_gradient.py", monkeypatch, "100")
    learner, bayes = capsys.readouterr().out.splitlines()
    assert learner.startswith("policy gradient: reward ")
    assert 480 < int(bayes.split()[2]) < 500


@pytest.mark.long
def test_own_classifier(capsys):
    runpy.run_path(str(EXAMPLES / "own_classifier.py"))["main"]()
    printed = capsys.readouterr().out
    check_output(printed, shown("own-classifier"))
    lines = printed.splitlines()
    losses = {line.split()[0]: float(line.split()[-1]) for line in lines if "log-loss" in line}
    assert len(losses) == 4
    assert max(losses[name] for name in ("ours", "forest", "logistic")) < losses["base"]


@pytest.mark.long
def test_figures(tmp_path, capsys):
    main = runpy.run_path(str(EXAMPLES / "figures.py"))["main"]
    main(trials=8, folder=tmp_path / "figures", logs=tmp_path / "logs")
    assert "predefined_plus" in capsys.readouterr().out
    made = sorted((tmp_path / "figures").iterdir())
    assert [path.name for path in made] == ["accuracy.png", "calibration.png", "cost.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in made)

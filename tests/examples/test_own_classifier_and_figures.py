"""The examples run as they stand, are short, and say what they promise."""

import importlib.util
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


def load(name):
    spec = importlib.util.spec_from_file_location(name, EXAMPLES / f"{name}.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("name", ["own_classifier", "figures"])
def test_examples_are_short(name):
    assert len((EXAMPLES / f"{name}.py").read_text().splitlines()) < 60


@pytest.mark.long
def test_own_classifier(capsys):
    load("own_classifier").main()
    lines = capsys.readouterr().out.splitlines()
    losses = {line.split()[0]: float(line.split()[-1]) for line in lines if "log-loss" in line}
    assert len(losses) == 4
    assert max(losses[name] for name in ("ours", "forest", "logistic")) < losses["base"]
    assert any(line.startswith("Trial of greedy: is object_01 red?") for line in lines)


def test_figures(tmp_path, capsys):
    load("figures").main(trials=8, folder=tmp_path / "figures", logs=tmp_path / "logs")
    assert "predefined_plus" in capsys.readouterr().out
    made = sorted((tmp_path / "figures").iterdir())
    assert [path.name for path in made] == ["accuracy.png", "calibration.png", "cost.png"]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in made)

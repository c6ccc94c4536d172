"""Run commands in a folder of their own, and one's own data to run them on."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner, Result

import meal_bayes
from meal_bayes.cli import main
from meal_bayes.datasets import PerceptTable
from meal_bayes.datasets.percepts import BIN_EDGES, THRESHOLD, save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.learner import ask
from meal_bayes.trials import Trial

ROOT = Path(meal_bayes.__file__).resolve().parents[1]  # of the package that is tested
DOMAIN = """
name = "kitchen"
attributes = ["red", "full"]
synonyms = { crimson = "red" }
report_reward = 100.0
predefined = ["look", "lift"]
behaviors = [
    { name = "look", cost = 1.0, modalities = ["color"] },
    { name = "lift", cost = 4.0, modalities = ["force"] },
]
[diagram]
states = ["on_table", "in_hand"]
start = "on_table"
effects = [
    { from = "*", do = "look", to = "*" },
    { from = "on_table", do = "lift", to = "in_hand", probability = 0.9 },
]
"""
OBJECTS = {  # red, full
    "red_mug": (1, 0),
    "red_can": (1, 1),
    "red_jar": (1, 1),
    "red_bowl": (1, 0),
    "blue_mug": (0, 1),
    "blue_can": (0, 0),
    "green_jar": (0, 1),
    "green_bowl": (0, 0),
}

Command = Callable[..., Result]


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Command:
    """Return a function that runs a command line in `tmp_path`, 80 columns wide."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "80")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "1")

    def invoke(*arguments: object) -> Result:
        result = CliRunner().invoke(main, [str(argument) for argument in arguments])
        if result.exception is not None and not isinstance(result.exception, SystemExit):
            raise result.exception
        return result

    return invoke


@pytest.fixture(scope="session")
def trials() -> list[Trial]:
    """Return three trials."""
    objects = ("heavy_blue_beans", "light_blue_rice", "medium_green_glass")
    return [ask("heavy, beans", dataset="roc36", object=o, agent="greedy") for o in objects]


@pytest.fixture
def fails(run: Command) -> Callable[..., str]:
    """Return a function that runs what must fail: one line on stderr, exit code 2, or 1."""

    def invoke(*arguments: object) -> str:
        result = run(*arguments)
        assert result.exit_code in (1, 2)  # 1 for the faults of the world
        assert result.stdout == ""
        assert result.stderr.startswith("error: ")
        assert result.stderr.count("\n") == 1
        return result.stderr

    return invoke


@pytest.fixture
def start(tmp_path: Path) -> Callable[..., "subprocess.Popen[str]"]:
    """Return a function that starts a command line as a process of its own in `tmp_path`."""
    path = os.pathsep.join([str(ROOT), os.environ.get("PYTHONPATH", "")])
    environment = {**os.environ, "PYTHONPATH": path, "COLUMNS": "80"}

    def popen(*arguments: str) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            [sys.executable, "-m", "meal_bayes", *arguments],
            cwd=tmp_path, env=environment, text=True, start_new_session=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE,
            # a job in the background ignores Ctrl-C, and so would its children
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),  # noqa: PLW1509
        )  # fmt: skip

    return popen


@pytest.fixture
def kitchen(tmp_path: Path) -> Path:
    """Write one's own domain and recordings: color tells red, force tells full."""
    rng = np.random.default_rng(0)
    (tmp_path / "kitchen.toml").write_text(DOMAIN)
    labels = [f"{name},{red},{full}" for name, (red, full) in OBJECTS.items()]
    (tmp_path / "labels.csv").write_text("\n".join(["object,red,full", *labels]) + "\n")
    color = ["object,recording,r,b"]
    force = ["object,recording,newton"]
    for name, (red, full) in OBJECTS.items():
        for k in (1, 2):
            r, b = rng.normal((200, 50) if red else (50, 180), 10)
            color.append(f"{name},{k},{r:.1f},{b:.1f}")
            force.append(f"{name},{k},{rng.normal(6 if full else 3, 0.3):.2f}")
    (tmp_path / "look_color.csv").write_text("\n".join(color) + "\n")
    (tmp_path / "lift_force.csv").write_text("\n".join(force) + "\n")
    return tmp_path


@pytest.fixture
def table(kitchen: Path) -> PerceptTable:
    """Return a percept table of the kitchen whose percepts are always right, and save it."""
    domain = load_domain(kitchen / "kitchen.toml")
    truth = np.array(list(OBJECTS.values()), np.int8)
    log_odds = np.where(truth == 1, 2.0, -2.0)[:, None, None] + np.zeros((1, 2, 2, 1))
    bins = np.zeros((8, 8, 2, 2, 8), np.uint8)
    place = np.searchsorted(BIN_EDGES, THRESHOLD + np.array([-2.0, 2.0]))[truth]  # (O,P)
    for p in range(2):
        for o in range(8):
            bins[:, o, p, :, place[o, p]] = 2
    bins[np.arange(8), np.arange(8)] = 0
    made = PerceptTable(domain, tuple(OBJECTS), truth, log_odds, BIN_EDGES, bins, {})
    save_percepts(made, kitchen / "kitchen.npz")
    return made

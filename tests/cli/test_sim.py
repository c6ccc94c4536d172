"""`sim`: recorded, asked, learned live, each from the command line."""

import json
import sys
from pathlib import Path

import pytest

from meal_bayes.datasets import load_dataset
from meal_bayes.errors import RobotError
from meal_bayes.trial_log import read_trials

QUESTION = "Is it heavy, and does it rattle?"
SMALL = ("--objects", "8", "--recordings", "1", "--jobs", "1", "--agent", "greedy")


@pytest.fixture(scope="session")
def cache(sim, tmp_path_factory):
    return tmp_path_factory.mktemp("cache")


@pytest.fixture
def ask(run, cache, monkeypatch):
    """Ask after a small training, which is recorded once for all tests."""
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(cache))
    return lambda *more: run("sim", "ask", QUESTION, *SMALL, *more)


@pytest.mark.long
def test_recordings_are_an_own_data_set(run, sim):
    result = run("sim", "record", "--objects", "3", "--recordings", "2", "--out", "made")
    assert result.exit_code == 0
    assert "3 objects" in result.stdout
    data = load_dataset("made/simulated_arm.toml", root="made")
    assert data.objects == ("object_000", "object_001", "object_002")
    assert data.recordings == 2
    assert "made/simulated_arm.toml" in result.stderr
    again = run("sim", "record", "--objects", "2", "--recordings", "1", "--out", "made")
    assert again.exit_code == 2
    assert "made holds files already" in again.stderr


@pytest.mark.long
def test_an_answer_is_a_row_of_the_trial_and_repeats(ask):
    first, second = (ask("--seed", "7", "--json") for _ in range(2))
    assert first.exit_code == 0
    told = json.loads(first.stdout)
    assert set(told["report"]) == set(told["truth"]) == {"heavy", "rattles"}
    assert told["success"] is (told["report"] == told["truth"])
    assert told["cost_s"] == pytest.approx(sum(step["cost_s"] for step in told["steps"]))
    assert told == json.loads(second.stdout)
    (trial,) = read_trials(told["log"])
    assert trial.cost == told["cost_s"]
    assert json.loads(ask("--seed", "8", "--json").stdout)["object"] != told["object"]


@pytest.mark.long
def test_an_answer_in_words_and_a_recording_of_the_body(ask):
    result = ask("--seed", "7", "--save", "seen.rrd")
    assert result.exit_code == 0
    assert "verdict" in result.stdout
    assert Path("seen.rrd").stat().st_size > 10_000


def test_a_fault_of_the_body_is_told_and_logged(ask, sim, monkeypatch):
    def broken(arm, behavior):
        raise RobotError("the gripper jams")

    ask("--seed", "7", "--json")  # training is recorded
    monkeypatch.setattr(sim.SimulatedArm, "execute", broken)
    result = ask("--seed", "7", "--json")
    assert result.exit_code == 1
    assert "robot error: RobotError: the gripper jams" in result.stderr
    told = json.loads(result.stdout)
    assert told["success"] is None
    assert told["report"] is None
    (trial,) = read_trials(told["log"])
    assert trial.ended == told["ended"] == "robot error: RobotError: the gripper jams"


@pytest.mark.long
def test_live_shows_a_curve(run, sim):
    result = run("sim", "live", "--trials", "6", "--agent", "bayes")
    assert result.exit_code == 0
    assert "1-6" in result.stdout
    assert "bayes" in result.stdout
    assert len(list(Path("logs").glob("sim-live-bayes-seed0-*/*.mcap"))) == 6


def test_without_mujoco_one_line_says_what_to_install(run, monkeypatch):
    for name in [name for name in sys.modules if "simulated" in name and "meal_bayes" in name]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr("importlib.util.find_spec", lambda *_: None)
    result = run("sim", "live")
    assert result.exit_code == 2
    assert "pip install '.[sim]'" in result.stderr

"""The command of the arm in physics: it asks, learns from nothing, and records."""

from importlib import import_module
from pathlib import Path

import pytest

from meal_bayes import RobotError, load_dataset, read_trials


@pytest.fixture
def command(sim, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return import_module("simulated_arm.__main__").main


@pytest.fixture
def ask(command, monkeypatch, tmp_path_factory):
    recordings = import_module("simulated_arm.recordings")
    cache = tmp_path_factory.getbasetemp() / "arm"
    monkeypatch.setattr(recordings, "user_cache_path", lambda _: cache)
    small = ("--objects", "8", "--recordings", "1", "--jobs", "1", "--agent", "greedy")
    return lambda *more: command(["ask", "Is it heavy, and does it rattle?", *small, *more])


@pytest.mark.long
def test_recordings_are_a_data_set(command, capsys):
    words = ["record", "--objects", "3", "--recordings", "2", "--jobs", "1", "--out", "made"]
    assert command(words) == 0
    data = load_dataset("made/simulated_arm.toml", root="made")
    assert data.objects == ("object_000", "object_001", "object_002")
    assert data.recordings == 2
    assert command(words) == 2
    assert "made holds files already" in capsys.readouterr().err


@pytest.mark.long
def test_an_answer_repeats_and_is_logged(ask, capsys):
    assert ask("--seed", "7", "--save", "seen.rrd") == 0
    first = capsys.readouterr().out
    assert Path("seen.rrd").stat().st_size > 10_000
    assert ask("--seed", "7") == 0
    assert capsys.readouterr().out.splitlines()[0] in first
    logs = sorted(Path("logs").rglob("*.mcap"))
    costs = {trial.cost for path in logs for trial in read_trials(path)}
    assert len(costs) == 1


@pytest.mark.long
def test_a_fault_of_the_body_ends_the_trial_and_is_logged(ask, sim, monkeypatch):
    def broken(arm, behavior):
        raise RobotError("the gripper jams")

    ask("--seed", "7")  # training is recorded
    monkeypatch.setattr(sim.SimulatedArm, "execute", broken)
    assert ask("--seed", "8", "--logs", "broken") == 1
    (log,) = Path("broken").rglob("*.mcap")
    (trial,) = read_trials(log)
    assert trial.ended == "robot error: RobotError: the gripper jams"


@pytest.mark.long
def test_live_shows_a_curve(command, capsys):
    assert command(["live", "--trials", "6"]) == 0
    assert "trials 1-6: accuracy" in capsys.readouterr().out
    assert len(list(Path("logs").rglob("*.mcap"))) >= 6

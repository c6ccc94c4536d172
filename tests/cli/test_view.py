"""`view`: a recording, a picture, a window; what is asked of it and cannot be is told."""

from pathlib import Path
from unittest.mock import MagicMock

import pytest

from meal_bayes import viewer
from meal_bayes.learner.api import ask
from meal_bayes.trial_log import write_trials
from meal_bayes.trials import TrialOutcomes
from meal_bayes.viewer import window

URL = "rerun+http://127.0.0.1:1/proxy"


@pytest.fixture
def log(run, trials):
    """Write a run of two files."""
    for name, part in (("a", trials[:2]), ("b", trials[2:])):
        write_trials(f"run/{name}.mcap", part, header={"seed": 0})
    return Path("run")


@pytest.fixture
def fake(monkeypatch):
    """Stand in for the viewer's program, which is closed at once."""
    program = MagicMock(address="http://127.0.0.1:1/?url=x", url=URL, running=False)
    program.return_value.__enter__.return_value = program
    monkeypatch.setattr(viewer, "Viewer", program)
    return program


def test_a_file_and_a_folder_are_saved(run, log):
    told = run("view", log, "--save", "out/all.rrd")
    assert told.exit_code == 0
    assert told.stdout.startswith("out/all.rrd: 3 trials, ")
    assert run("view", log / "a.mcap", "--save", "a.rrd").stdout.startswith("a.rrd: 2 trials")
    run("view", log, "--trial", "2", "--save", "one.rrd")
    assert Path("one.rrd").stat().st_size < Path("out/all.rrd").stat().st_size


@pytest.mark.parametrize("web", [False, True])
def test_trials_are_sent_to_a_window_or_a_page_and_no_file_is_made(
    run, log, fake, monkeypatch, web
):
    sent = []

    def send(trials, to, header, *, name, only):
        assert only == shown
        sent.append((to, sum(1 for _ in trials)))
        return sent[-1][1]

    monkeypatch.setattr(viewer, "send_recording", send)
    monkeypatch.setattr("tempfile.TemporaryDirectory", None)
    # The web page shows every trial here, the window the first one.
    shown = None if web else 0
    told = run("view", log, *(["--web", "--all"] if web else []))
    assert told.exit_code == 0
    assert ("open http://127.0.0.1:1/" in told.stdout) == web
    fake.assert_called_once_with(web=web)
    assert sent == [(URL, 3)]


def test_a_compact_log_shows_its_run(run):
    trial = ask("heavy, beans", dataset="roc36", object="heavy_blue_beans", agent="greedy")
    write_trials("c.mcap", [TrialOutcomes.of([trial, trial])], header={"seed": 0})
    assert run("view", "c.mcap", "--save", "c.rrd").stdout.startswith("c.rrd: 2 trials")


def test_a_run_is_followed(run, log, fake, monkeypatch):
    followed = []

    def follow(path, url, *, watching, on_trials):
        followed.append((path, url, watching()))
        on_trials(3)
        return MagicMock(problems=["run/a.mcap: torn"])

    monkeypatch.setattr(viewer, "follow", follow)
    told = run("view", log, "--live")
    assert followed == [(log, URL, False)]
    assert "3 trials" in told.stderr
    assert "warning: run/a.mcap: torn" in told.stderr
    assert "waiting for later.mcap" in run("view", "later.mcap", "--live", "--web").stderr


def test_a_picture_shows_the_last_behavior(run, log, trials, monkeypatch):
    asked = []

    def take_picture(recording, *, row):
        asked.append(row)
        return b"picture"

    monkeypatch.setattr(viewer, "take_picture", take_picture)
    assert run("view", log, "--screenshot", "p.png").stdout == "p.png: 7 bytes\n"
    run("view", log, "--trial", "1", "--screenshot", "p.png")
    assert asked == [len(trials[0].steps) - 1, len(trials[1].steps) - 1]


def test_what_cannot_be_is_one_line(run, log, fails, monkeypatch):
    assert "holds 3 whole trials; give --trial 0 to 2" in fails("view", log, "--trial", "3",
                                                          "--save", "a.rrd")  # fmt: skip
    assert "ends in .png" in fails("view", log, "--screenshot", "a.gif")
    assert "ends in .rrd" in fails("view", log, "--save", "a.txt")
    assert "no log none.mcap" in fails("view", "none.mcap")
    assert "one of --save" in fails("view", log, "--save", "a.rrd", "--web")
    assert "--live goes with --web" in fails("view", log, "--live", "--trial", "0")
    monkeypatch.setattr(window.importlib.util, "find_spec", lambda name: None)
    assert "rerun-sdk" in fails("view", log)

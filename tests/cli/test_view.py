"""`view`: a recording, a picture, a window; what is asked of it and cannot be is told."""

import sys
import warnings
from collections import Counter
from pathlib import Path
from types import SimpleNamespace

import pytest
from rerun.chunk import RrdReader

from meal_bayes import viewer
from meal_bayes.learner import ask
from meal_bayes.trial_log import write_trials
from meal_bayes.trials import TrialOutcomes
from meal_bayes.viewer import window as viewer_window


@pytest.fixture
def log(run, trials):
    """Write a run of two files."""
    for name, part in (("a", trials[:2]), ("b", trials[2:])):
        write_trials(f"run/{name}.mcap", part, header={"seed": 0})
    return Path("run")


@pytest.fixture
def window(tmp_path, monkeypatch, eventually):
    """Let the viewer's program, which is rerun's own, keep in a file what it is sent.

    It needs no screen so. Its user closes it once it has all that is `awaited`.
    """
    shown = SimpleNamespace(path=tmp_path / "sent.rrd", awaited=Counter())

    class Kept(viewer.Viewer):
        def __init__(self, *, web=False):
            super().__init__(["--save", shown.path])
            self.address = "http://127.0.0.1:1/" if web else ""

        def wait(self):
            eventually(lambda: contents(shown.path) >= shown.awaited, "it lacks what was sent")
            self._process.terminate()  # an interrupt is ignored where a shell started it so
            self._process.wait()

    monkeypatch.setattr(viewer, "Viewer", Kept)
    return shown


def contents(path):
    """Count the rows of a recording by entity and column, however they are divided."""
    rows = Counter()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of a file that is being written
        for chunk in RrdReader(str(path)).stream() if path.exists() else ():
            for column, values in chunk.to_record_batch().to_pydict().items():
                rows[chunk.entity_path, column] += len(values)
    return rows


def test_saving_every_step_of_much_is_warned_of(run, log, monkeypatch):
    assert "takes long" not in run("view", log, "--all", "--save", "all.rrd").stderr
    monkeypatch.setattr(sys.modules["meal_bayes.cli.view"], "_LARGE", 1000)
    assert "takes long" in run("view", log, "--all", "--save", "all.rrd").stderr
    assert "takes long" not in run("view", log, "--trial", "1", "--save", "one.rrd").stderr


def test_a_file_and_a_folder_are_saved(run, log):
    told = run("view", log, "--all", "--save", "out/all.rrd")
    assert told.exit_code == 0
    assert told.stdout.startswith("out/all.rrd: 3 trials, ")
    assert run("view", log / "a.mcap", "--save", "a.rrd").stdout.startswith("a.rrd: 2 trials")
    run("view", log, "--trial", "2", "--save", "one.rrd")
    assert Path("one.rrd").stat().st_size < Path("out/all.rrd").stat().st_size


@pytest.mark.long
@pytest.mark.parametrize("web", [False, True])
def test_what_is_sent_to_a_window_or_a_page_is_what_is_saved(run, log, window, monkeypatch, web):
    run("view", log, *(["--all"] if web else ["--trial", "0"]), "--save", "saved.rrd")
    window.awaited = contents(Path("saved.rrd"))
    monkeypatch.setattr("tempfile.TemporaryDirectory", None)  # no file is made on the way
    # The web page shows every trial here, the window the first one.
    told = run("view", log, *(["--web", "--all"] if web else []))
    assert told.exit_code == 0
    assert ("open http://127.0.0.1:1/" in told.stdout) == web
    assert contents(window.path) == window.awaited


def test_a_compact_log_shows_its_run(run):
    trial = ask("heavy, beans", dataset="roc36", object="heavy_blue_beans", agent="greedy")
    write_trials("c.mcap", [TrialOutcomes.of([trial, trial])], header={"seed": 0})
    assert run("view", "c.mcap", "--save", "c.rrd").stdout.startswith("c.rrd: 2 trials")
    told = run("view", "c.mcap", "--trial", "0", "--save", "d.rrd")
    assert told.exit_code == 1
    assert "no steps of trial 0" in told.stderr
    assert not Path("d.rrd").exists()


@pytest.mark.long
def test_a_run_is_followed(run, log, window):
    run("view", log, "--save", "saved.rrd")
    beliefs = {key for key in contents(Path("saved.rrd")) if key[0].startswith("/belief/")}
    torn = log / "c.mcap"
    whole = (log / "b.mcap").read_bytes()
    torn.write_bytes(whole[: len(whole) // 8] + b"torn" + whole[len(whole) // 8 + 4 :])
    told = run("view", log, "--live")
    assert told.exit_code == 0
    assert "3 trials" in told.stderr
    assert f"warning: {torn}" in told.stderr
    assert beliefs <= set(contents(window.path))


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
    assert "contains 3 complete trials; give --trial 0 to 2" in fails("view", log, "--trial", "3",
                                                          "--save", "a.rrd")  # fmt: skip
    assert "ends in .png" in fails("view", log, "--screenshot", "a.gif")
    assert "ends in .rrd" in fails("view", log, "--save", "a.txt")
    assert "no log none.mcap" in fails("view", "none.mcap")
    assert "one of --save" in fails("view", log, "--save", "a.rrd", "--web")
    assert "combined with --web" in fails("view", log, "--live", "--trial", "0")
    monkeypatch.setattr(viewer_window.importlib.util, "find_spec", lambda name: None)
    assert "rerun-sdk" in fails("view", log)

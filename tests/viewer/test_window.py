"""The real viewer, without a window: every view shows something and reports nothing."""

import contextlib
import io
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from matplotlib import image as png

from meal_bayes.look import ERROR_TEXT
from meal_bayes.trial_log import read_header, read_trials
from meal_bayes.trials import TrialOutcomes
from meal_bayes.viewer import (
    Viewer,
    ViewerError,
    send_recording,
    take_picture,
    window,
    write_recording,
)

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
TRIAL = {
    "question and answer", "why this action", "belief over steps",
    "value of going on less answering now", "entropy, bits", "cost so far, s",
    "where the robot is, what it just did", "search tree: action, percepts → next action",
    "action, state, percepts",
}  # fmt: skip
HIDDEN = {"what this behavior tells"}  # in a tab behind: it has a state, and no picture
RUN = {
    f"accuracy so far, band {ERROR_TEXT}", "agents and worst trials", "run facts",
    f"mean cost so far, s, band {ERROR_TEXT}",
}  # fmt: skip


@pytest.fixture(scope="module")
def looked_at(vulkan, tmp_path_factory):
    """Open the sample in the real viewer, once for each tab: views' states and pictures by name."""
    folder = tmp_path_factory.mktemp("sample")
    states = {}
    pictures = {}
    complaints = []
    for name, trials in (
        ("trial", read_trials(SAMPLE)),
        ("run", [TrialOutcomes.of(read_trials(SAMPLE))]),
    ):
        recording = folder / f"{name}.rrd"
        write_recording(trials, recording, read_header(SAMPLE), name=name)
        with Viewer(headless=True) as viewer:
            client = viewer.client()
            client.open(str(recording))
            client.set_time("step", sequence=4, play_state="paused")
            pictures[name] = window._stable_picture(client, 1.0)
            for view in client.get_state().views:
                states[view.name] = view
                if view.name in (TRIAL if name == "trial" else RUN):
                    pictures[view.name] = client.take_screenshot(view.view_id)
            complaints += [entry for entry in client.get_logs() if entry.level == "ERROR"]
    return states, pictures, complaints


@pytest.mark.long
def test_no_view_reports_anything(looked_at):
    states, _, complaints = looked_at
    assert set(states) == TRIAL | HIDDEN | RUN
    assert {name: view.reports for name, view in states.items() if view.reports} == {}
    assert complaints == []


@pytest.mark.long
@pytest.mark.parametrize("name", sorted(TRIAL | RUN))
def test_no_view_is_blank(name, looked_at):
    _, pictures, _ = looked_at
    assert png.imread(io.BytesIO(pictures["trial"])).shape[:2] == (1080, 1920)
    pixels = png.imread(io.BytesIO(pictures[name]))[..., :3]
    shown = pixels[40:]  # below the title
    back = np.median(shown.reshape(-1, 3), axis=0)
    marked = np.abs(shown - back).max(axis=2) > 0.2
    assert marked.mean() > 0.002, f"{marked.sum()} pixels differ from the background"


def test_trials_are_sent_to_a_window_that_is_open(vulkan):
    """As `view LOG` does, so that no file is left behind."""
    with Viewer(headless=True) as viewer:
        client = viewer.client()
        assert listening(viewer._process.pid) == {"0100007F"}  # 127.0.0.1, as the kernel writes it
        sent = send_recording(read_trials(SAMPLE), viewer.url, read_header(SAMPLE))
        assert sent == len(list(read_trials(SAMPLE)))
        for _ in range(300):
            views = client.get_state().views
            if {view.name for view in views} >= TRIAL:
                break
            time.sleep(0.1)
        assert {view.name for view in views} >= TRIAL
        assert [view.reports for view in views if view.reports] == []


def listening(pid: int) -> set[str]:
    """Addresses on which a process accepts connections."""
    inodes = set()
    for entry in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            target = str(entry.readlink())
            if target.startswith("socket:["):
                inodes.add(target[8:-1])
    rows = [line.split() for table in ("tcp", "tcp6")
            for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]]  # fmt: skip
    return {row[1].partition(":")[0] for row in rows if row[3] == "0A" and row[9] in inodes}


def test_what_it_is_started_with(monkeypatch):
    started = {}

    class Process:
        def __init__(self, command, *, env, **kinds):
            started.update(command=command, env=env)

        def kill(self):
            pass

        def wait(self):
            return 0

    monkeypatch.setattr(subprocess, "Popen", Process)
    with Viewer(["a.rrd"]) as viewer:
        assert viewer.url.startswith("rerun+http://127.0.0.1:")
    assert started["env"]["CI"] == "1"  # which turns its telemetry off
    command = started["command"]
    assert command[command.index("--bind") + 1] == "127.0.0.1"
    assert "a.rrd" in command


@pytest.mark.long
def test_a_viewer_that_cannot_open_a_window_says_what_to_do(monkeypatch, tmp_path):
    fake = tmp_path / "rerun"
    fake.touch(0o755)
    monkeypatch.setattr(window, "viewer_program", lambda: fake)
    monkeypatch.setenv("DISPLAY", "")
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    panic = "INFO wgpu adapter; thread panicked at No glyph for '█'"
    for complaint, said in (
        ("No graphics adapter", "mesa-vulkan-drivers"),
        ("x", "no display"),
        (panic, "No glyph"),
    ):
        fake.write_text(f"#!/bin/sh\necho '{complaint}' >&2\nexit 3\n")
        with Viewer() as viewer, pytest.raises(ViewerError, match=f"{said}.*--web"):
            viewer.wait()
        with Viewer() as viewer, pytest.raises(ViewerError, match=said):
            viewer.client()


def test_a_viewer_that_does_not_answer_is_told_as_such(monkeypatch, tmp_path):
    fake = tmp_path / "rerun"
    fake.write_text("#!/bin/sh\nsleep 60\n")
    fake.chmod(0o755)
    monkeypatch.setattr(window, "viewer_program", lambda: fake)
    monkeypatch.setattr(window, "_DYING", 0.01)
    client = Mock()
    client.open.side_effect = TimeoutError("deadline has elapsed")
    monkeypatch.setattr(Viewer, "client", lambda self: client)
    with pytest.raises(ViewerError, match=r"did not answer in time.*--save"):
        take_picture(SAMPLE)


@pytest.mark.long
def test_the_page_is_served_to_this_machine_only_and_ends_with_the_command(eventually, running):
    command = [sys.executable, "-m", "meal_bayes", "view", str(SAMPLE), "--web"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        address = process.stdout.readline().removeprefix("open ").strip()
        with urllib.request.urlopen(address, timeout=60) as answer:
            assert b"re_viewer" in answer.read()
        task = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        (child,) = map(int, task.read_text().split())
        assert listening(child) == {"0100007F"}  # 127.0.0.1, as the kernel writes it
        process.kill()
    eventually(lambda: not running(child), "the viewer outlives the command")

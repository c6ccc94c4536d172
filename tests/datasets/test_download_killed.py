"""A killed fetch leaves nothing that a later one takes for whole; links are not followed."""

import functools
import os
import signal
import subprocess
import sys
import threading
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

import pytest

from meal_bayes import datasets
from meal_bayes.datasets.download import fetch, registry, verify

ROOT = Path(datasets.__file__).resolve().parents[2]
DATA = "roc36"
CODE = f"from meal_bayes.datasets.download import fetch; fetch({DATA!r})"
FEW = 3  # files that are sent before the server stalls


class Stalling(SimpleHTTPRequestHandler):
    """Sends a few files, then half of one, and waits."""

    sent, stalled, go_on = 0, threading.Event(), threading.Event()

    def copyfile(self, source, outputfile):
        Stalling.sent += 1
        if Stalling.sent <= FEW:
            super().copyfile(source, outputfile)
            return
        content = source.read()
        outputfile.write(content[: len(content) // 2])
        outputfile.flush()
        Stalling.stalled.set()
        Stalling.go_on.wait()

    def log_message(self, *told):
        pass


@pytest.fixture(autouse=True)
def _allowed(monkeypatch):
    """Allow fetches where the caller has forbidden them: all of them stay on this machine."""
    monkeypatch.setenv("MEAL_BAYES_OFFLINE", "0")


@pytest.mark.real_data
def test_a_killed_fetch_goes_on_to_the_end(recordings, tmp_path, monkeypatch):
    handler = functools.partial(Stalling, directory=str(recordings))
    server = ThreadingHTTPServer(("127.0.0.1", 0), handler)
    server.daemon_threads = True
    threading.Thread(target=server.serve_forever, daemon=True).start()
    environment = {
        **os.environ, "PYTHONPATH": str(ROOT), "MEAL_BAYES_DATA_DIR": str(tmp_path),
        "MEAL_BAYES_DATA_URL": f"http://127.0.0.1:{server.server_port}",
    }  # fmt: skip
    with subprocess.Popen([sys.executable, "-c", CODE], env=environment) as child:
        assert Stalling.stalled.wait(120)
        child.send_signal(signal.SIGKILL)
    Stalling.go_on.set()
    server.shutdown()
    server.server_close()
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path))
    states = [state for _, state in verify(DATA)]
    assert states.count("ok") == FEW
    assert states.count("missing") == len(registry(DATA)) - FEW  # and none is half there
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", str(recordings))
    fetch(DATA)
    assert {state for _, state in verify(DATA)} == {"ok"}


@pytest.mark.real_data
def test_a_cached_file_that_is_a_link_elsewhere_is_replaced_not_written_through(
    recordings, tmp_path, monkeypatch
):
    precious = tmp_path / "precious"
    precious.write_text("precious")
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", str(tmp_path / "cache"))
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", str(recordings))
    path, _ = verify(DATA)[0]
    path.parent.mkdir(parents=True)
    path.symlink_to(precious)
    assert verify(DATA)[0] == (path, "changed")
    fetch(DATA)
    assert precious.read_text() == "precious"
    assert not path.is_symlink()
    assert {state for _, state in verify(DATA)} == {"ok"}

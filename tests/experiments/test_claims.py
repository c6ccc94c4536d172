"""Several processes on one folder of logs: work is shared, and the dead hold nothing."""

import os
import signal
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from meal_bayes.errors import OutputError
from meal_bayes.experiments import claims
from meal_bayes.experiments.claims import Holder, claimed, run_claimed

ROOT = Path(claims.__file__).resolve().parents[2]
HOLD = """
import sys, time
from pathlib import Path
from meal_bayes.experiments.claims import claimed
with claimed(Path(sys.argv[1])) as holder:
    print(holder, flush=True)
    sys.stdin.readline()
"""


@pytest.fixture
def other(tmp_path):
    """Another process, which holds the claim of `tmp_path / "unit"`."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "unit")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "None\n"
        yield process
        process.kill()


def test_a_claim_is_held_once_and_leaves_nothing(tmp_path):
    path = tmp_path / "unit"
    with claimed(path) as first:
        assert first is None
        with claimed(path) as second:
            assert second.pid == os.getpid()
            assert second.host
            assert f"process {os.getpid()} on " in str(second)
            assert "since 20" in str(second)
    assert list(tmp_path.iterdir()) == []
    with claimed(path) as third:
        assert third is None


def test_what_another_process_holds_is_told(tmp_path, other):
    with claimed(tmp_path / "unit") as holder:
        assert holder.pid == other.pid


@pytest.mark.parametrize(
    "kind", [signal.SIGKILL, pytest.param(signal.SIGTERM, marks=pytest.mark.long)]
)
def test_the_claim_of_a_killed_process_is_taken_over(tmp_path, other, kind):
    other.send_signal(kind)
    other.wait()
    assert [path.name for path in tmp_path.iterdir()] == ["unit.claim"]
    with claimed(tmp_path / "unit") as holder:
        assert holder is None
    assert list(tmp_path.iterdir()) == []


def test_what_is_held_is_left_to_the_end_and_waited_for(tmp_path, other, monkeypatch):
    done, told = [], []

    def let_go(seconds):
        if other.stdin.closed:
            return
        assert done == ["a", "b"]
        other.stdin.close()
        other.wait()

    monkeypatch.setattr(claims.time, "sleep", let_go)
    work = [("held", tmp_path / "unit"), ("a", tmp_path / "a"), ("b", tmp_path / "b")]
    done.extend(run_claimed(str, work, jobs=1, on_note=told.append))
    assert done == ["a", "b", "held"]
    assert len(told) == 1
    assert f"unit is being made by process {other.pid} on" in told[0]


def test_a_file_system_without_locks_is_no_obstacle(tmp_path, monkeypatch):
    def none(descriptor, kind):
        raise OSError(95, "Operation not supported")

    monkeypatch.setattr(claims.fcntl, "flock", none)
    with claimed(tmp_path / "unit") as first, claimed(tmp_path / "unit") as second:
        assert first is second is None


def test_the_place_is_tried_first(tmp_path):
    (tmp_path / "file").touch()
    calls = []
    with pytest.raises(OutputError, match="cannot be written"):
        list(run_claimed(calls.append, [(1, tmp_path / "file" / "unit")], jobs=1))
    assert calls == []


def test_many_threads_never_hold_one_claim_together(tmp_path):
    holding, most = [], []

    def again():
        for _ in range(200):
            with claimed(tmp_path / "unit") as holder:
                if holder is None:
                    holding.append(1)
                    most.append(len(holding))
                    holding.pop()
                else:
                    assert isinstance(holder, Holder)

    threads = [threading.Thread(target=again) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert set(most) == {1}


def test_a_claim_that_its_holder_removes_meanwhile_is_made_anew(tmp_path, monkeypatch):
    path, lock, calls = tmp_path / "unit", claims._lock, []

    def slow(descriptor):
        if not calls:
            (tmp_path / "unit.claim").unlink()  # between our opening and our locking
        calls.append(descriptor)
        return lock(descriptor)

    monkeypatch.setattr(claims, "_lock", slow)
    with claimed(path) as first:
        assert first is None
        with claimed(path) as second:
            assert second.pid == os.getpid()
    assert len(calls) == 3

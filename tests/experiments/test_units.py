"""Several processes: work on one folder is shared, the dead hold nothing, none is left behind."""

import errno
import os
import signal
import subprocess
import sys
import threading
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import pytest

from meal_bayes.errors import OutputError, SettingsError
from meal_bayes.experiments import OfflineConfig, run_offline, units
from meal_bayes.experiments.parallel import in_parallel
from meal_bayes.experiments.units import Planned, locked, run_units
from meal_bayes.trial_log import read_trials
from meal_bayes.trial_log.file import drafts_of, new_draft

ROOT = Path(units.__file__).resolve().parents[2]
HOLD = """
import sys, time
from pathlib import Path
from meal_bayes.experiments.units import locked
with locked(Path(sys.argv[1])) as lock:
    print(lock, flush=True)
    sys.stdin.readline()
"""


@dataclass(frozen=True)
class Part:
    """A unit that writes a file."""

    path: Path
    size: int = 2

    @property
    def done(self):
        return self.size if self.path.is_file() else 0

    def run(self, advance):
        for _ in range(self.size):
            advance(1)
        self.path.write_text("whole")


def planned(*units, warm_up=int):
    """A run of such units."""
    return [Planned(None, Path(), units, warm_up)]


class Patient(Part):
    """A unit that goes on once its first half is known."""

    def run(self, advance):
        advance(0.5)
        for _ in range(1000):
            if not self.path.with_name("known").exists():
                time.sleep(0.01)
        self.path.write_text("whole")


class Interrupted(Part):
    """A unit in whose middle the user interrupts."""

    def run(self, advance):
        advance(1)
        raise KeyboardInterrupt


@pytest.fixture
def other(tmp_path):
    """Another process, which holds the lock of `tmp_path / "unit"`."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path / "unit")],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
    ) as process:  # fmt: skip
        assert process.stdout.readline() == "True\n"
        yield process
        process.kill()


def test_a_lock_is_held_once_and_leaves_nothing(tmp_path):
    path = tmp_path / "unit"
    with locked(path) as first:
        assert first is True
        with locked(path) as second:
            assert f"process {os.getpid()} on " in second
            assert "since 20" in second
    assert list(tmp_path.iterdir()) == []
    with locked(path) as third:
        assert third is True


@pytest.mark.long
@pytest.mark.parametrize("kind", [signal.SIGKILL, signal.SIGTERM])
def test_the_lock_of_a_killed_process_is_taken_over(tmp_path, other, kind):
    with locked(tmp_path / "unit") as lock:
        assert f"process {other.pid} on " in lock
    other.send_signal(kind)
    other.wait()
    assert [path.name for path in tmp_path.iterdir()] == ["unit.lock"]
    with locked(tmp_path / "unit") as lock:
        assert lock is True
    assert list(tmp_path.iterdir()) == []


@pytest.mark.long
def test_what_is_held_is_left_to_the_end_and_waited_for(tmp_path, other, monkeypatch):
    progress = []
    notes = []
    todo = [Part(tmp_path / name) for name in ("unit", "a", "b")]
    (tmp_path / "b").write_text("whole")

    def let_go(seconds):
        assert (tmp_path / "a").is_file()
        other.stdin.close()
        other.wait()

    monkeypatch.setattr(units.time, "sleep", let_go)
    run_units(
        planned(*todo), jobs=1, on_progress=lambda *at: progress.append(at), on_note=notes.append
    )
    assert progress[0] == (2, 6)
    assert progress[-1] == (6, 6)
    assert len(notes) == 1
    assert f"unit is being made by process {other.pid} on" in notes[0]


def test_without_file_locks_two_processes_do_the_same_work(tmp_path, monkeypatch):
    """The first to end leaves the second's draft alone, which then takes the same name."""

    def no_locks(descriptor, kind):
        raise OSError(errno.ENOLCK, os.strerror(errno.ENOLCK))

    monkeypatch.setattr("fcntl.flock", no_locks)
    with locked(tmp_path / "unit") as first, locked(tmp_path / "unit") as second:
        assert first is second is False
    config = OfflineConfig("roc36", 2, 3, ("random",), seed=5)
    (path,) = run_offline(config, logs=tmp_path / "first").paths
    draft = new_draft(path)
    draft.touch()
    run_offline(config, logs=tmp_path / "first", fresh=True)
    assert drafts_of(path) == [draft]
    monkeypatch.undo()
    run_offline(config, logs=tmp_path / "first", fresh=True)
    assert drafts_of(path) == []


@pytest.mark.long
def test_processes_tell_what_is_done_of_a_unit_under_way(tmp_path):
    progress = []

    def look(done, total):
        progress.append(done)
        if done:
            (tmp_path / "known").touch()

    run_units(planned(*(Patient(tmp_path / name) for name in "ab")), jobs=2, on_progress=look)
    assert 0 < next(filter(None, progress)) <= 1
    assert progress[-1] == 4


def test_after_an_interruption_what_is_kept_is_told(tmp_path):
    progress = []
    units_of_run = (Part(tmp_path / "a"), Interrupted(tmp_path / "b"))
    with pytest.raises(KeyboardInterrupt):
        run_units(planned(*units_of_run), jobs=1, on_progress=lambda done, _: progress.append(done))
    assert progress[0] == 0
    assert progress[-1] == 2  # of the first unit; what the second did is not kept


def test_the_place_is_tried_first(tmp_path):
    (tmp_path / "file").touch()
    warmed = []
    with pytest.raises(OutputError, match="cannot be written"):
        run_units(planned(Part(tmp_path / "file" / "unit"), warm_up=lambda: warmed.append(1)))
    assert warmed == []


def test_no_process_is_no_way_to_run(tmp_path):
    with pytest.raises(SettingsError, match="jobs is 0"):
        run_units(planned(Part(tmp_path / "unit")), jobs=0)


def test_several_runs_are_one_list_and_a_unit_of_two_runs_runs_once(tmp_path):
    progress = []
    first, second = (
        planned(Part(tmp_path / "a")),
        planned(Part(tmp_path / "a"), Part(tmp_path / "b")),
    )
    run_units([*first, *second], on_progress=lambda *at: progress.append(at))
    assert progress[-1] == (4, 4)
    assert {path.name for path in tmp_path.iterdir()} == {"a", "b"}


CONFIG = OfflineConfig("roc36", 2, 130, ("random", "predefined_plus"), seed=3)
CODE = """
import os, signal, sys
from meal_bayes.learner import Learner
from meal_bayes.experiments import OfflineConfig, run_offline

run, last = Learner.ask, int(sys.argv[2])

def run_until(self, task, **options):
    global last
    last -= 1
    if last == 0:
        os.kill(os.getpid(), signal.SIGKILL)
    return run(self, task, **options)

Learner.ask = run_until
run_offline(OfflineConfig("roc36", 2, 130, ("random", "predefined_plus"), seed=3), logs=sys.argv[1])
"""


@pytest.fixture(scope="module")
def alone(tmp_path_factory, contents):
    """What one run writes that nobody disturbs."""
    return contents(run_offline(CONFIG, logs=tmp_path_factory.mktemp("alone")).folder)


@pytest.mark.long
def test_what_is_killed_beside_another_ends_the_same(alone, tmp_path, contents):
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    started = []
    for last in (40, 170, 0):  # killed in the first unit, in a later one, never
        command = [sys.executable, "-c", CODE, str(tmp_path), str(last)]
        started.append(subprocess.Popen(command, env=environment))
        while started[0].poll() is None and not list(tmp_path.rglob("*.active")):
            time.sleep(0.01)  # until the first has a unit, so that no other takes all
    codes = [process.wait() for process in started]
    assert codes[0] == -signal.SIGKILL
    assert codes[2] == 0
    run = run_offline(CONFIG, logs=tmp_path)
    assert contents(run.folder) == alone
    assert not list(run.folder.rglob("*.active"))
    assert len([trial for path in run.paths for trial in read_trials(path)]) == 260


def children() -> set[int]:
    """Processes that this one has started."""
    text = Path(f"/proc/self/task/{threading.get_native_id()}/children").read_text()
    return {int(word) for word in text.split()}


def process_id(piece):
    return os.getpid()


def fail(piece):
    raise ZeroDivisionError(piece)


@pytest.mark.long
def test_no_more_processes_than_pieces_of_work():
    used = set(in_parallel(process_id, range(2), jobs=10_000))
    assert len(used) <= 2
    assert os.getpid() not in used


def test_one_piece_is_done_here():
    assert list(in_parallel(process_id, range(1), jobs=2)) == [os.getpid()]
    assert list(in_parallel(process_id, [], jobs=2)) == []


@pytest.mark.long
def test_faults_end_the_processes_and_are_told(eventually):
    before = children()
    with pytest.raises(ZeroDivisionError):
        list(in_parallel(fail, range(4), jobs=2))
    eventually(lambda: len(children() - before) <= 2)  # trackers of resources


def warn(piece):
    warnings.warn(f"piece {piece} is odd", stacklevel=1)


@pytest.mark.long
def test_warnings_of_processes_look_like_those_here(monkeypatch, capfd):
    monkeypatch.setattr(warnings, "formatwarning", lambda message, *_: f"warning: {message}\n")
    list(in_parallel(warn, range(2), jobs=2))
    assert sorted(capfd.readouterr().err.splitlines()) == [
        "warning: piece 0 is odd",
        "warning: piece 1 is odd",
    ]


def die(piece):
    os.kill(os.getpid(), signal.SIGKILL)


@pytest.mark.long
def test_a_process_that_dies_is_one_clear_error():
    with pytest.raises(SettingsError, match="A process died during its work"):
        list(in_parallel(die, range(2), jobs=2))


@pytest.mark.long
def test_ctrl_c_ends_the_processes(eventually, running):
    code = (
        "import os, signal, time\n"
        "from meal_bayes.experiments.parallel import in_parallel\n"
        # A shell that runs the tests in the background has it ignored.
        "signal.signal(signal.SIGINT, signal.default_int_handler)\n"
        "def work(piece):\n    os.write(1, b'%d\\n' % os.getpid())\n    time.sleep(1000)\n"
        "list(in_parallel(work, range(2), jobs=2))"
    )
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", code], env=environment, stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL, text=True,
    ) as parent:  # fmt: skip
        working = [int(parent.stdout.readline()) for _ in range(2)]
        parent.send_signal(signal.SIGINT)
        try:
            assert parent.wait(60) != 0
        finally:
            parent.kill()
        eventually(lambda: not any(map(running, working)))

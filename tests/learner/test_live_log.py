"""Logs of live trials: everyone who asks at the same time gets a number of their own."""

import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from meal_bayes.errors import LogError
from meal_bayes.learner import live_log
from meal_bayes.learner.live_log import _reserve

ROOT = Path(__file__).resolve().parents[2]
ASKS = """
import sys
from pathlib import Path
sys.path.insert(0, sys.argv[1])
from meal_bayes.learner.live_log import _reserve
for _ in range(20):
    number, reserved = _reserve(Path(sys.argv[2]) / "kitchen")
    path = Path(sys.argv[2]) / "kitchen" / f"{number:05d}-mug.mcap"
    path.with_name(path.name + ".active").open("x").close()
    path.with_name(path.name + ".active").replace(path)
    reserved.unlink()
"""


def names(folder):
    return sorted(path.name for path in (folder / "kitchen").iterdir())


def test_two_trials_about_one_object_at_once_have_two_logs(dataset, make, tmp_path):
    learner = make.learner(dataset, logs=tmp_path)
    with learner.begin("red", "mug"), learner.begin("red", "mug"):
        pass
    assert names(tmp_path) == ["00000-mug.mcap", "00001-mug.mcap"]


@pytest.mark.long
def test_processes_overwrite_nothing(tmp_path):
    command = [sys.executable, "-c", ASKS, str(ROOT), str(tmp_path)]
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(lambda _: subprocess.run(command, check=True), range(3)))
    assert names(tmp_path) == [f"{number:05d}-mug.mcap" for number in range(60)]


def test_a_number_taken_between_looking_and_reserving_is_passed_over(tmp_path, monkeypatch):
    look, looks = live_log._numbers, []

    def late(folder, pattern):
        found = look(folder, pattern)
        if len(looks) == 1:  # a whole trial of another process ends just now
            (folder / "00000-mug.mcap").write_text("theirs")
        looks.append(found)
        return found

    monkeypatch.setattr(live_log, "_numbers", late)
    (tmp_path / "kitchen").mkdir()
    number, reserved = _reserve(tmp_path / "kitchen")
    assert number == 1
    reserved.unlink()
    assert names(tmp_path) == ["00000-mug.mcap"]


def test_what_a_killed_process_left_is_passed_over(tmp_path):
    folder = tmp_path / "kitchen"
    folder.mkdir()
    (folder / ".00003.reserved").touch()
    (folder / "00002-mug.w4711-a3f9c2.mcap.active").touch()
    assert _reserve(folder)[0] == 4


def test_there_are_more_than_five_digits(tmp_path):
    (tmp_path / "kitchen").mkdir()
    (tmp_path / "kitchen" / "100000-mug.mcap").touch()
    assert _reserve(tmp_path / "kitchen")[0] == 100001


def test_a_trial_that_fails_leaves_no_reservation(dataset, make, tmp_path):
    with pytest.raises(KeyError), make.learner(dataset, logs=tmp_path).begin("red", "mug"):
        raise KeyError
    assert names(tmp_path) == ["00000-mug.mcap"]


def test_a_folder_that_cannot_be_made_is_told(dataset, make, tmp_path):
    (tmp_path / "kitchen").touch()
    learner = make.learner(dataset, logs=tmp_path)
    with pytest.raises(LogError, match="kitchen cannot be written"):
        learner.begin("red")

"""Following a run: the real viewer's place is taken by a recording in memory."""

import threading

from meal_bayes.trial_log import TrialWriter
from meal_bayes.viewer import replay


def test_trials_are_sent_as_they_land(trials, read_back, tmp_path, monkeypatch, eventually):
    path, saved = tmp_path / "run.mcap", tmp_path / "seen.rrd"
    monkeypatch.setattr(replay, "_POLL", 0.01)
    seen, landed = [], threading.Event()

    def write():
        with TrialWriter(path, {"seed": 1}) as log:
            for number, trial in enumerate(trials):
                log.write(trial)
                eventually(lambda number=number: seen[-1:] == [number + 1])
        landed.set()

    writer = threading.Thread(target=write)
    writer.start()
    follower = replay.follow(path, saved, watching=lambda: True, on_trials=seen.append)
    writer.join()
    assert seen == [1, 2, 3, 4]  # each was seen before the next was written
    assert follower.finished
    assert follower.problems == []
    assert landed.is_set()
    rows = read_back(saved)
    assert len(rows["/entropy"]["step"]) == sum(len(trial.steps) + 2 for trial in trials)


def test_it_ends_when_nobody_watches(tmp_path, monkeypatch):
    monkeypatch.setattr(replay, "_POLL", 0.01)
    answers = iter([True, True, False])
    path = tmp_path / "to come.mcap"
    follower = replay.follow(path, tmp_path / "none.rrd", watching=lambda: next(answers))
    assert not follower.finished

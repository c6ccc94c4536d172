"""Logs of a run found and read as far as they go; files that grow, followed."""

import pytest

from meal_bayes.errors import LogCorruptError, LogError, LogVersionError
from meal_bayes.trial_log import (
    Follower,
    Logs,
    TrialWriter,
    log_file,
    log_files,
    schema,
    write_trials,
)


def test_the_logs_of_a_folder_in_order(make, tmp_path):
    trials = make.trials(6, 4)
    write_trials(tmp_path / "run" / "b" / "unit-0000.mcap", trials[2:4], header={"unit": 1})
    write_trials(tmp_path / "run" / "a.mcap", trials[:2], header={"unit": 0})
    with TrialWriter(tmp_path / "run" / "c.mcap", {"unit": 2}) as log:
        for trial in trials[4:]:
            log.write(trial)
        (tmp_path / "run" / "note.txt").write_text("no log")
        found = Logs(tmp_path / "run")
        names = ["a.mcap", "unit-0000.mcap", log.active_path.name]
        assert [file.name for file in found.files] == names
        assert found.header["unit"] == 0
        assert all(map(make.equal, found.trials(), trials))
        (problem,) = found.problems
        assert "not finished by its writer" in problem
    groups = Logs(tmp_path / "run").groups()
    found = [(group.header["unit"], tuple(group.places)) for group in groups]
    assert found == [(0, (0, 1)), (1, (0, 1)), (2, (0, 1))]


def test_what_cannot_be_read_is_one_clear_error(make, tmp_path, monkeypatch):
    with pytest.raises(LogError, match="no log"):
        log_files(tmp_path / "none.mcap")
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match="holds no log"):
        log_files(tmp_path / "empty")
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(LogCorruptError, match=r"Not one trial can be read: .*text\.mcap"):
        list(Logs(tmp_path / "text.mcap").trials())
    write_trials(tmp_path / "nothing.mcap", [], header={})
    with pytest.raises(LogError, match="holds no trial yet"):
        list(Logs(tmp_path / "nothing.mcap").trials())
    monkeypatch.setattr(log_file, "FORMAT_VERSION", schema.FORMAT_VERSION + 1)
    write_trials(tmp_path / "new.mcap", make.trials(1), header={})
    monkeypatch.undo()
    with pytest.raises(LogVersionError, match="format 6"):
        list(Logs(tmp_path / "new.mcap").trials())
    with pytest.raises(LogVersionError, match=r"new\.mcap was written in log format 6"):
        list(Follower(tmp_path / "new.mcap").poll())


def test_a_growing_file_is_followed_through_its_renaming(make, tmp_path):
    trials, path = make.trials(5, 7), tmp_path / "a.mcap"
    follower, seen = Follower(path), []
    assert list(follower.poll()) == []  # it is still to come
    with TrialWriter(path, {"seed": 7}) as log:
        for number, trial in enumerate(trials, start=1):
            log.write(trial)
            seen += follower.poll()
            assert len(seen) == number
            assert not follower.finished
        assert follower.header["seed"] == 7
    assert list(follower.poll()) == []
    assert follower.finished
    assert all(map(make.equal, seen, trials))
    assert list(Follower(path).poll())  # and a whole one from its beginning
    follower.close()


def test_every_cut_of_a_growing_file_waits_for_the_rest(make, tmp_path):
    trials, path = make.trials(3, 8, edges=1), tmp_path / "a.mcap"
    write_trials(path, trials, header={})
    data, seen = path.read_bytes(), []
    path.unlink()
    follower = Follower(path)
    with path.open("wb") as file:
        for start in range(0, len(data), 211):
            file.write(data[start : start + 211])
            file.flush()
            seen += follower.poll()
    assert all(map(make.equal, seen, trials))
    assert len(seen) == 3
    assert follower.finished
    assert follower.problems == []


def test_damage_ends_the_following_with_what_was_before(make, tmp_path):
    trials, path = make.trials(6, 3), tmp_path / "a.mcap"
    write_trials(path, trials, header={})
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 8
    path.write_bytes(data)
    follower = Follower(path)
    seen = list(follower.poll())
    assert 0 < len(seen) < 6
    assert all(map(make.equal, seen, trials))
    (problem,) = follower.problems
    assert "a.mcap" in problem
    assert follower.finished
    for content in (b"not a log at all", data[:5], b"\x89MCAP0\r\n" + b"\xff" * 50):
        path.write_bytes(content)
        follower = Follower(path)
        assert list(follower.poll()) == []
        assert follower.finished is bool(follower.problems)
        follower.close()

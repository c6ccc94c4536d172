"""Logs of a run found and followed as far as they go; each trial once, and each run alone."""

import dataclasses
from pathlib import Path

import pytest

from meal_bayes.errors import LogCorruptError, LogError, LogVersionError
from meal_bayes.trial_log import (
    Follower,
    Logs,
    TrialWriter,
    log_files,
    recover_log,
    remove_drafts,
    write_trials,
)
from meal_bayes.trial_log.file import drafts_of, stem_of, timing_of
from meal_bayes.trial_log.folder import begun_text, dated_name
from meal_bayes.trial_log.messages import FORMAT_VERSION


def trials_of(logs):
    return [trial for group in logs.groups() for trial in group.trials]


def test_the_logs_of_a_folder_in_order(make, tmp_path):
    trials = make.trials(6, 4)
    write_trials(tmp_path / "run" / "b" / "unit-0000.mcap", trials[2:4], header={"unit": 1})
    write_trials(tmp_path / "run" / "a.mcap", trials[:2], header={"unit": 0})
    with TrialWriter(tmp_path / "run" / "c.mcap", {"unit": 2}) as log:
        for trial in trials[4:]:
            log.write(trial)
        (tmp_path / "run" / "note.txt").write_text("no log")
        logs = Logs(tmp_path / "run")
        names = ["a.mcap", "unit-0000.mcap", log.active_path.name]
        assert [file.name for file in logs.files] == names
        assert logs.header["unit"] == 0
        assert all(map(make.equal, trials_of(logs), trials))
        (problem,) = logs.problems
        assert "not finished by its writer" in problem
    groups = Logs(tmp_path / "run").groups()
    places = [(group.header["unit"], tuple(group.numbers)) for group in groups]
    assert places == [(0, (0, 1)), (1, (0, 1)), (2, (0, 1))]


def test_what_cannot_be_read_is_one_clear_error(make, tmp_path, monkeypatch):
    with pytest.raises(LogError, match="no log"):
        log_files(tmp_path / "none.mcap")
    (tmp_path / "empty").mkdir()
    with pytest.raises(LogError, match="holds no log"):
        log_files(tmp_path / "empty")
    (tmp_path / "text.mcap").write_text("hello")
    with pytest.raises(LogCorruptError, match=r"Not one trial can be read: .*text\.mcap"):
        trials_of(Logs(tmp_path / "text.mcap"))
    write_trials(tmp_path / "nothing.mcap", [], header={})
    with pytest.raises(LogError, match="contains no trial yet"):
        trials_of(Logs(tmp_path / "nothing.mcap"))
    monkeypatch.setattr("meal_bayes.trial_log.file.FORMAT_VERSION", FORMAT_VERSION + 1)
    write_trials(tmp_path / "new.mcap", make.trials(1), header={})
    monkeypatch.undo()
    with pytest.raises(LogVersionError, match=f"format {FORMAT_VERSION + 1}"):
        trials_of(Logs(tmp_path / "new.mcap"))
    newer = rf"new\.mcap was written in log format {FORMAT_VERSION + 1}"
    with pytest.raises(LogVersionError, match=newer):
        list(Follower(tmp_path / "new.mcap").poll())


def test_a_growing_file_is_followed_through_its_renaming(make, tmp_path):
    trials = make.trials(5, 7)
    path = tmp_path / "a.mcap"
    follower = Follower(path)
    seen = []
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
    trials = make.trials(3, 8, edges=1)
    path = tmp_path / "a.mcap"
    write_trials(path, trials, header={})
    data = path.read_bytes()
    seen = []
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
    trials = make.trials(6, 3)
    path = tmp_path / "a.mcap"
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


CONFIG = {"config": {"dataset": "toy", "agents": ["bayes"], "seed": 3}}


def torn(path, trials):
    """Leave a draft, as a killed process does."""
    log = TrialWriter(path, CONFIG, overwrite=True).__enter__()
    for trial in trials:
        log.write(trial)
    log._file.close()
    return log.active_path


@pytest.fixture
def killed(make, tmp_path):
    """A folder after: kill, `log recover`, the same command again."""
    trials = make.trials(6, 3)
    draft = torn(tmp_path / "run" / "unit-0000.mcap", trials[:4])
    saved = recover_log(draft)
    write_trials(tmp_path / "run" / "unit-0000.mcap", trials, header=CONFIG)
    return tmp_path / "run", draft, saved, trials


def test_recovered_and_unfinished_files_do_not_count_twice(killed, make):
    folder, draft, saved, trials = killed
    whole = folder / "unit-0000.mcap"
    smaller = torn(whole, trials[:2])
    for best, count in ((whole, 6), (draft, 4), (smaller, 2), (saved, 4)):
        assert log_files(folder) == [best]
        for logs in (Logs(folder), Logs(folder, folder)):
            read = trials_of(logs)
            assert all(map(make.equal, read, trials))
            assert len(read) == count
        best.unlink()


def test_a_draft_that_is_ended_while_a_folder_is_read_is_read_whole(make, tmp_path):
    """Its name is gone when its turn comes: another process has given it its own."""
    trials = make.trials(3)
    first, second, third = (tmp_path / "run" / f"{name}.mcap" for name in "abc")
    drafts = [torn(path, [trial]) for path, trial in zip((first, second), trials, strict=False)]
    write_trials(third, trials[2:], header=CONFIG)
    logs = Logs(tmp_path / "run")
    drafts[0].unlink()
    write_trials(first, trials[:1], header=CONFIG)
    groups = logs.groups()
    read = [*next(groups).trials]  # the second is ended once reading has begun
    drafts[1].unlink()
    write_trials(second, trials[1:2], header=CONFIG)
    read += [trial for group in groups for trial in group.trials]
    assert len(read) == 3
    assert all(map(make.equal, read, trials))
    assert logs.problems == []
    for path, draft in zip((first, second), drafts, strict=True):
        assert log_files(draft) == [path]
    with pytest.raises(LogError, match="There is no log"):
        log_files(tmp_path / "run" / "a.recovered.mcap")


def test_what_is_being_recovered_is_a_copy_of_its_log(make, tmp_path):
    """Of the log itself, its draft says more; of a draft that got its name, the recovered file."""
    trials = make.trials(3)
    log = tmp_path / "run" / "a.mcap"
    draft = torn(log, trials)
    beginning = torn(log.with_name("a.recovered.mcap"), trials[:1])
    assert log_files(tmp_path / "run") == [draft]
    assert drafts_of(log) == [draft]
    assert len(trials_of(Logs(tmp_path / "run"))) == 3
    logs = Logs(beginning)
    beginning.unlink()  # it gets its name between listing and reading
    saved = recover_log(draft)
    draft.unlink()
    assert log_files(beginning) == [saved]
    assert len(trials_of(logs)) == 3


def test_a_follower_gives_each_trial_once(killed, make):
    folder, draft, saved, trials = killed
    for file in (saved, folder / "unit-0000.mcap"):
        file.unlink()
    follower = Follower(folder)
    assert len(list(follower.poll())) == 4
    assert not follower.finished  # for all it knows, the draft goes on
    write_trials(folder / "unit-0000.mcap", trials, header=CONFIG)
    assert all(map(make.equal, follower.poll(), trials[4:]))
    draft.unlink()
    assert list(follower.poll()) == []
    assert follower.finished


def test_equal_trials_of_one_file_are_different_trials(make, tmp_path):
    (trial,) = make.trials(1)
    write_trials(tmp_path / "a.mcap", [trial, trial], header={})
    assert len(trials_of(Logs(tmp_path / "a.mcap"))) == 2
    assert len(list(Follower(tmp_path / "a.mcap").poll())) == 2


@pytest.mark.parametrize(("entry", "trials"), [("seed", 6), ("agents", 3)])
def test_settings_tell_units_apart_but_not_the_agents_of_a_run(make, tmp_path, entry, trials):
    for value in (1, 2):
        header = {"config": {**CONFIG["config"], entry: value}}
        path = tmp_path / str(value) / "bayes" / "unit.mcap"
        write_trials(path, make.trials(3), header=header)
    if entry == "agents":  # a copy, but for who else was in the run
        path.write_bytes((tmp_path / "1" / "bayes" / "unit.mcap").read_bytes())
    assert len(trials_of(Logs(tmp_path))) == trials


def test_a_data_set_is_one_by_whatever_path_its_table_is_named(make, tmp_path):
    """As a run of a table in memory, and one by its path, name it."""
    for number, content in enumerate((b"a table", b"a table", b"another")):
        table = tmp_path / f"{number}.npz"
        table.write_bytes(content)
        path = tmp_path / "logs" / f"{number}.mcap"
        write_trials(path, make.trials(1), header={"config": {"dataset": str(table)}})
    logs = [tmp_path / "logs" / f"{number}.mcap" for number in range(3)]
    assert len(trials_of(Logs(*logs[:2]))) == 2
    with pytest.raises(LogError, match="belong to 3 data sets"):
        list(Logs(*logs).trials())
    (tmp_path / "1.npz").unlink()  # what it held cannot be told any more
    with pytest.raises(LogError, match="belong to 2 data sets"):
        list(Logs(*logs[:2]).trials())


def test_data_sets_are_not_mixed(make, tmp_path):
    for name in ("toy", "roc36"):
        header = {"config": {"dataset": name}}
        write_trials(tmp_path / f"{name}.mcap", make.trials(1), header=header)
    with pytest.raises(LogError, match=r"2 data sets: roc36 .*roc36\.mcap.*toy .*toy\.mcap"):
        trials_of(Logs(tmp_path))
    assert len(trials_of(Logs(tmp_path / "toy.mcap"))) == 1


def test_two_versions_of_one_run_are_not_mixed(make, tmp_path):
    """As where the code was changed in between, and both folders are named."""
    (trial,) = make.trials(1)
    other = dataclasses.replace(trial, truth=1 - trial.truth)
    for name, each in (("old", trial), ("new", other)):
        write_trials(tmp_path / name / "bayes" / "unit.mcap", [each], header=CONFIG)
    with pytest.raises(LogError, match="different trials with equal settings"):
        trials_of(Logs(tmp_path))


def test_drafts_have_names_of_their_own(make, tmp_path):
    path = tmp_path / "a [1].mcap"
    both = (TrialWriter(path, {}, overwrite=True) for _ in range(2))
    with next(both) as first, next(both) as second:
        assert first.active_path != second.active_path
        for log in (first, second):
            log.write(*make.trials(1), seconds=1.0)
        assert set(drafts_of(path)) == {first.active_path, second.active_path}
        assert stem_of(first.active_path) == "a [1]"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a [1].mcap", "a [1].timing.csv"]


def test_what_killed_writers_left_is_removed(make, tmp_path):
    path = tmp_path / "a.mcap"
    trials = make.trials(2)
    for _ in range(2):
        torn(path, trials)
    others = [torn(tmp_path / "ab.mcap", trials), torn(tmp_path / "a.b.mcap", trials)]
    write_trials(path, trials, header={}, seconds=[1.0, 2.0])
    remove_drafts(path)
    assert set(tmp_path.iterdir()) == {path, timing_of(path), *others}


def test_when_a_log_began_is_read_as_it_was_written(monkeypatch):
    monkeypatch.setattr("meal_bayes.trial_log.folder._chosen_last", ["29990131-235959-999999"])
    assert begun_text(Path(dated_name("blue cup"))) == "2999-02-01 00:00:00"
    for other in ("blue cup.mcap", "99999999-999999-999999-cup.mcap", "0001-cup.mcap"):
        assert begun_text(Path(other)) == ""

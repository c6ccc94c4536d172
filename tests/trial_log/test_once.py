"""Each trial once: recovered files, drafts, files named twice; data sets and runs kept apart."""

import dataclasses

import pytest

from meal_bayes.errors import LogError
from meal_bayes.trial_log import (
    Follower,
    Logs,
    TrialWriter,
    log_files,
    recover_log,
    remove_drafts,
    write_trials,
)
from meal_bayes.trial_log.names import drafts_of, recovered_name, stem_of, timing_of

CONFIG = {"config": {"dataset": "toy", "agents": ["bayes"], "seed": 3}}


def torn(path, trials):
    """Leave a draft, as a killed process does."""
    log = TrialWriter(path, CONFIG).__enter__()
    for trial in trials:
        log.write(trial, seconds=0.5)
    log._file.close()
    log._timing.close()
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
            found = list(logs.trials())
            assert all(map(make.equal, found, trials))
            assert len(found) == count
        best.unlink()


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
    assert len(list(Logs(tmp_path / "a.mcap").trials())) == 2
    assert len(list(Follower(tmp_path / "a.mcap").poll())) == 2


@pytest.mark.parametrize(("entry", "trials"), [("seed", 6), ("agents", 3)])
def test_settings_tell_units_apart_but_not_the_agents_of_a_run(make, tmp_path, entry, trials):
    for value in (1, 2):
        header = {"config": {**CONFIG["config"], entry: value}}
        path = tmp_path / str(value) / "bayes" / "unit.mcap"
        write_trials(path, make.trials(3), header=header)
    if entry == "agents":  # a copy, but for who else was in the run
        path.write_bytes((tmp_path / "1" / "bayes" / "unit.mcap").read_bytes())
    assert len(list(Logs(tmp_path).trials())) == trials


def test_data_sets_are_not_mixed(make, tmp_path):
    for name in ("toy", "roc36"):
        header = {"config": {"dataset": name}}
        write_trials(tmp_path / f"{name}.mcap", make.trials(1), header=header)
    with pytest.raises(LogError, match=r"2 data sets: roc36 .*roc36\.mcap.*toy .*toy\.mcap"):
        list(Logs(tmp_path).trials())
    assert len(list(Logs(tmp_path / "toy.mcap").trials())) == 1


def test_two_versions_of_one_run_are_not_mixed(make, tmp_path):
    """As where the code was changed in between, and both folders are named."""
    (trial,) = make.trials(1)
    other = dataclasses.replace(trial, truth=1 - trial.truth)
    for name, one in (("old", trial), ("new", other)):
        write_trials(tmp_path / name / "bayes" / "unit.mcap", [one], header=CONFIG)
    with pytest.raises(LogError, match="different trials under equal settings"):
        list(Logs(tmp_path).trials())


def test_drafts_have_names_of_their_own(make, tmp_path):
    path = tmp_path / "a [1].mcap"
    with TrialWriter(path, {}) as one, TrialWriter(path, {}) as other:
        assert one.active_path != other.active_path
        for log in (one, other):
            log.write(*make.trials(1), seconds=1.0)
        assert set(drafts_of(path)) == {one.active_path, other.active_path}
        assert stem_of(one.active_path) == "a [1]"
        assert recovered_name(other.active_path) == tmp_path / "a [1].recovered.mcap"
    assert sorted(p.name for p in tmp_path.iterdir()) == ["a [1].mcap", "a [1].timing.csv"]


def test_what_killed_writers_left_is_removed(make, tmp_path):
    path, trials = tmp_path / "a.mcap", make.trials(2)
    drafts = [torn(path, trials), torn(path, trials)]
    older = tmp_path / "a.mcap.active"
    older.write_bytes(drafts[0].read_bytes())
    others = [torn(tmp_path / "ab.mcap", trials), torn(tmp_path / "a.b.mcap", trials)]
    write_trials(path, trials, header={}, seconds=[1.0, 2.0])
    remove_drafts(path)
    kept = {path, timing_of(path), *others, *map(timing_of, others)}
    assert set(tmp_path.iterdir()) == kept

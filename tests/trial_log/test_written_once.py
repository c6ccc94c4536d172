"""A log that is there is never replaced in silence, whoever writes and however the name is said."""

import os
from pathlib import Path

import pytest

from meal_bayes.agents import Agent
from meal_bayes.domain import load_domain
from meal_bayes.errors import LogError, OutputError, SettingsError
from meal_bayes.files import write_whole
from meal_bayes.learner import Learner, ask
from meal_bayes.planners import Predefined
from meal_bayes.robots import Outcome
from meal_bayes.trial_log import TrialWriter, check_log, read_trials, recover_log, write_trials
from meal_bayes.trial_log import file as log_file


def begin(path, trials):
    Learner("toy", agent="greedy", logs=None).begin("Is it red?", "a cup", log=path)


def ask_once(path, trials):
    ask("heavy", dataset="roc36", object="heavy_green_beans", agent="greedy", log=path)


def write(path, trials):
    write_trials(path, trials, header={})


def open_writer(path, trials):
    with TrialWriter(path, {}):
        pass


WRITERS = [write, open_writer, begin, ask_once]


def other_name(way, log):
    """Return another name of a file that is there."""
    folder = log.parent
    if way == "link":
        (folder / "link.mcap").symlink_to(log)
        return folder / "link.mcap"
    if way == "link to nothing":
        (folder / "link.mcap").symlink_to(folder / "gone.mcap")
        return folder / "link.mcap"
    if way == "hard link":
        (folder / "hard.mcap").hardlink_to(log)
        return folder / "hard.mcap"
    if way == "folder":
        (folder / "folder.mcap").mkdir()
        return folder / "folder.mcap"
    if way == "linked folder":
        (folder / "linked").symlink_to(folder)
        return folder / "linked" / log.name
    ways = {
        "name": log,
        "text": str(log),
        "dots": folder / "x" / ".." / log.name,
        "home": "~/log.mcap",
        "relative": log.name,
    }
    (folder / "x").mkdir()
    return ways[way]


WAYS = ["name", "text", "link", "link to nothing", "hard link", "folder", "linked folder", "dots",
        "home", "relative"]  # fmt: skip


@pytest.mark.quick(14)
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("writer", WRITERS)
def test_a_log_that_is_there_stays(make, tmp_path, monkeypatch, writer, way):
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.chdir(tmp_path)
    log = tmp_path / "log.mcap"
    trials = make.trials(2)
    write_trials(log, trials, header={}, seconds=[1.0, 2.0])
    name = other_name(way, log)
    before = {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()}
    there = sorted(map(str, tmp_path.iterdir()))
    with pytest.raises(LogError, match=Path(name).name.replace(".", r"\.")) as refused:
        writer(name, trials[:1])
    if way != "folder":
        assert "another name" in str(refused.value)
    assert {path: path.read_bytes() for path in tmp_path.iterdir() if path.is_file()} == before
    assert sorted(map(str, tmp_path.iterdir())) == there


@pytest.mark.parametrize("name", ["a.w1-abcdef.mcap", "a.w1-abcdef.recovered.mcap"])
@pytest.mark.parametrize("writer", WRITERS)
def test_a_name_of_a_draft_is_refused(make, tmp_path, writer, name):
    """Beside the log itself it would not be read."""
    with pytest.raises(SettingsError, match=r"drafts of a\.mcap"):
        writer(tmp_path / name, make.trials(1))
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["a.MCAP", "a.Mcap", "a.w1-abcdef.mcap.active"])
@pytest.mark.parametrize("writer", WRITERS)
def test_an_ending_that_is_nearly_that_of_a_log_is_refused(make, tmp_path, writer, name):
    with pytest.raises(SettingsError, match=r"ends in \.mcap"):
        writer(tmp_path / name, make.trials(1))
    assert not list(tmp_path.iterdir())


def test_a_program_may_say_that_it_replaces(make, tmp_path):
    log = tmp_path / "a.mcap"
    first, second = make.trials(2)
    for trial in (first, second):
        write_trials(log, [trial], header={}, seconds=[1.0], overwrite=True)
    assert make.equal(list(read_trials(log)), [second])


@pytest.mark.parametrize("hard_links", [True, False])
def test_a_file_that_appears_meanwhile_stays_and_so_do_the_trials(
    make, tmp_path, monkeypatch, hard_links
):
    if not hard_links:

        def refuse(*paths):
            raise PermissionError

        monkeypatch.setattr(os, "link", refuse)
    log = tmp_path / "a.mcap"
    trials = make.trials(1)
    writer = TrialWriter(log, {})
    writer.__enter__()
    writer.write(trials[0])
    log.write_text("precious")
    with pytest.raises(LogError, match="meanwhile"):
        writer.__exit__(None, None, None)
    assert log.read_text() == "precious"
    saved = recover_log(writer.active_path, tmp_path / "saved.mcap")
    assert all(map(make.equal, read_trials(saved), trials))
    write_trials(tmp_path / "b.mcap", trials, header={})
    assert check_log(tmp_path / "b.mcap").whole


def test_a_trial_that_was_broken_off_is_not_replaced(tmp_path):
    log = tmp_path / "a.mcap"
    toy = load_domain("toy")
    agent = Agent("script", lambda domain, query: Predefined(toy.behavior_names[:1]))
    learner = Learner(toy, agent=agent, logs=None)
    session = learner.begin("Is it red?", "a cup", log=log)
    with pytest.raises(LogError, match="is being written"):
        begin(log, [])
    (draft,) = log_file.drafts_of(log)
    session._recorder._file.close()  # the process dies
    with pytest.raises(LogError, match="resume"):
        begin(log, [])
    assert log_file.drafts_of(log) == [draft]
    resumed = learner.resume(log, state=toy.diagram.start)
    while resumed.behavior is not None:
        resumed.observe(Outcome(toy.diagram.start))
    assert len(list(read_trials(log))) == 1
    assert not log_file.drafts_of(log)


def test_what_is_no_table_of_seconds_stays(make, tmp_path):
    table = tmp_path / "a.timing.csv"
    table.write_text("mine")
    for options in ({}, {"overwrite": True}):
        with pytest.raises(LogError, match=r"a\.timing\.csv"):
            write_trials(tmp_path / "a.mcap", make.trials(1), header={}, **options)
    assert [path.name for path in tmp_path.iterdir()] == [table.name]
    assert table.read_text() == "mine"


def test_no_other_output_replaces_a_log_or_a_learner(make, tmp_path):
    write_trials(tmp_path / "a.mcap", make.trials(1), header={})
    learner = Learner("toy", agent="greedy", logs=None)
    learner.save(tmp_path / "a.learner")
    for path in list(tmp_path.iterdir()):
        before = path.read_bytes()
        with pytest.raises(OutputError, match="not replaced"):
            write_whole(path, "text")
        assert path.read_bytes() == before
    learner.save(tmp_path / "a.learner")

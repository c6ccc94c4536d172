"""Every path that Python takes: `~` is the home folder, and any `os.PathLike` is a path."""

import os
from pathlib import Path

import numpy as np
import pytest

import meal_bayes
from meal_bayes import (
    Learner,
    load_agent,
    load_dataset,
    load_domain,
    load_percepts,
    read_trials,
    recall,
    save_percepts,
)
from meal_bayes.cache import cache_root
from meal_bayes.datasets import cache_folder, fetch, make_synthetic, registry, save_csv_folder
from meal_bayes.datasets.bags import find_bags
from meal_bayes.errors import DownloadError, MealBayesError, SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig, run_offline
from meal_bayes.files import checked_path, draft_of, lasting_path, path_text, write_whole
from meal_bayes.perception import TableSource, build_percept_table
from meal_bayes.trial_log import (
    Follower,
    Logs,
    check_log,
    log_info,
    read_outcomes,
    recover_log,
    write_trials,
)


class Named:
    """A path of another package."""

    def __init__(self, text):
        self.text = text

    def __fspath__(self):
        return self.text


@pytest.fixture
def home(tmp_path, monkeypatch):
    """Return a home folder, in a process that works in another folder."""
    for name in ("home", "work"):
        (tmp_path / name).mkdir()
    monkeypatch.chdir(tmp_path / "work")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    yield tmp_path / "home"
    assert not list((tmp_path / "work").iterdir())


FORMS = pytest.mark.parametrize("form", [str, Path, Named])


@FORMS
def test_a_first_tilde_is_the_home_folder(home, form):
    assert checked_path("log", form("~/a")) == home / "a"
    assert lasting_path("log", form("~/a")) == home / "a"
    assert path_text(form("~")) == str(home)
    assert path_text(form("a~b")) == "a~b"
    assert path_text(5) == 5
    write_whole(form("~/b/c.txt"), "text")
    with draft_of(form("~/d.txt")) as draft:
        draft.touch()
    assert (home / "b" / "c.txt").read_text() == "text"
    assert (home / "d.txt").exists()
    with pytest.raises(SettingsError, match="nobody-of-that-name"):
        checked_path("log", form("~nobody-of-that-name/a"))


@FORMS
def test_data_sets_and_tables(home, form):
    domain = home / "own.toml"
    domain.write_text(
        'name = "own"\nattributes = ["red"]\n'
        'behaviors = [{name = "look", cost = 1.0, modalities = ["c"]}]\n'
        '[diagram]\nstates = ["here"]\nstart = "here"\n'
        'effects = [{from = "here", do = "look", to = "here"}]\n'
    )
    (home / "variant.toml").write_text('extends = "~/own.toml"\nname = "variant"\n')
    assert load_domain(form("~/variant.toml")).attributes == ("red",)
    rng = np.random.default_rng(0)
    dataset = make_synthetic(form("~/own.toml"), objects=6, recordings=2, rng=rng)
    save_csv_folder(dataset, form("~/data"))
    assert load_dataset(form("~/own.toml"), root=form("~/data")).objects == dataset.objects
    save_percepts(build_percept_table(dataset), form("~/own.npz"))
    table = load_percepts(form("~/own.npz"))
    assert TableSource.of(form("~/own.npz")).load() == table
    config = OfflineConfig(form("~/own.npz"), attributes=1, trials=2, agents=("prior",))
    run = run_offline(config, logs=form("~/runs"))
    assert home in run.folder.parents
    online = OnlineConfig(form("~/own.toml"), root=form("~/data"))
    assert (online.dataset, online.root) == (str(domain), str(home / "data"))


@FORMS
def test_learners_and_logs(home, form):
    table = load_percepts("roc36")
    learner = Learner("roc36", agent="greedy", logs=form("~/logs")).fit(table)
    trial = learner.ask("red", "heavy_blue_beans")
    log = next((home / "logs").rglob("*.mcap"))
    beneath = f"~/{log.relative_to(home)}"
    assert next(iter(read_trials(form(beneath)))).task.object_name == "heavy_blue_beans"
    assert len(read_outcomes(form(beneath)).reward) == 1
    assert log_info(form(beneath)).path == check_log(form(beneath)).path == log
    assert len(Logs(form("~/logs")).files) == 1
    write_trials(form("~/again.mcap"), [trial], header={})
    assert (home / "again.mcap").exists()
    learner.save(form("~/learner.zip"))
    assert Learner.load(form("~/learner.zip"), logs=None).settings.seed == 0


READERS = {
    "learner": lambda path: Learner.load(path, logs=None),
    "domain.toml": load_domain,
    "table.npz": load_percepts,
    "data": lambda path: load_dataset("toy", root=path),
    "log.mcap": lambda path: list(read_trials(path)),
    "logs.mcap": lambda path: list(Logs(path).trials()),
    "report.mcap": log_info,
    "outcomes.mcap": read_outcomes,
    "torn.mcap": recover_log,
    "recalled.mcap": lambda path: recall(Learner("toy", logs=None), path),
    "resumed.mcap": Learner("toy", logs=None).resume,
    "draft.mcap.active": Learner("toy", logs=None).resume,
    "ended.mcap": Learner("toy", logs=None).give_up,
    "posterior.nc": lambda path: Learner("toy", posterior=str(path), logs=None),
    "agent.py": lambda path: load_agent(f"{path}:agent"),
    "run.npz": lambda path: run_offline(OfflineConfig(path, attributes=1), logs=path.parent / "x"),
    "bag.bag": lambda path: find_bags([path]),
}
PLACES = {
    "pipe": os.mkfifo,
    "folder": Path.mkdir,
    "device": lambda path: path.symlink_to("/dev/zero"),
    "loop": lambda path: path.symlink_to(path),
    "link to nothing": lambda path: path.symlink_to("nothing"),
    "nothing": lambda path: None,
}


@pytest.mark.quick(34)
@pytest.mark.parametrize("reader", READERS)
@pytest.mark.parametrize("kind", PLACES)
def test_what_is_no_file_to_read_is_one_line(reader, kind, tmp_path):
    """None is waited for, and none is read without end."""
    PLACES[kind](tmp_path / reader)
    with pytest.raises(MealBayesError) as raised:
        READERS[reader](tmp_path / reader)
    assert "\n" not in str(raised.value)


def test_a_pipe_in_a_folder_of_logs_is_passed_over(tmp_path):
    trial = meal_bayes.ask(
        "red", dataset="roc36", object="heavy_blue_beans", agent="greedy", logs=tmp_path
    )
    for name in ("a.mcap", "b.mcap.w1-abcdef.active", "z.mcap"):
        os.mkfifo(tmp_path / "roc36" / name)
    assert [again.success for again in Logs(tmp_path).trials()] == [trial.success]
    follower = Follower(tmp_path)
    assert len(list(follower.poll())) == 1
    follower.close()


def test_folders_of_the_environment(home, monkeypatch):
    monkeypatch.delenv("MEAL_BAYES_OFFLINE", raising=False)
    monkeypatch.setenv("MEAL_BAYES_DATA_DIR", "~/cache")
    assert cache_folder() == home / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", "~/compiled")
    assert home in cache_root().parents
    mirror = home / "mirror"
    for name in registry("roc36"):
        (mirror / name).parent.mkdir(parents=True, exist_ok=True)
        (mirror / name).write_bytes(b"")
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", "~/mirror")
    with pytest.raises(
        DownloadError, match=os.fspath(mirror)
    ):  # its files are others: the digest tells
        fetch("roc36")


def test_without_a_home_folder_the_variable_is_named(monkeypatch):
    def nowhere(_):
        raise RuntimeError("could not determine the home directory")

    monkeypatch.delenv("MEAL_BAYES_DATA_DIR", raising=False)
    monkeypatch.setattr("pooch.os_cache", nowhere)
    with pytest.raises(SettingsError, match="set MEAL_BAYES_DATA_DIR"):
        cache_folder()

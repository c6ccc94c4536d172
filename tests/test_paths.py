"""Every path that Python takes: `~` is the home folder, and any `os.PathLike` is a path."""

import os
from pathlib import Path

import numpy as np
import pytest

from meal_bayes import Learner, load_dataset, load_domain, load_percepts, read_trials, save_percepts
from meal_bayes.cache import cache_root
from meal_bayes.datasets import cache_folder, fetch, make_synthetic, registry, save_csv_folder
from meal_bayes.errors import DownloadError, SettingsError
from meal_bayes.experiments import OfflineConfig, OnlineConfig, run_offline
from meal_bayes.files import checked_path, draft_of, lasting_path, path_text, write_whole
from meal_bayes.perception import TableSource, build_percept_table
from meal_bayes.trial_log import Logs, check_log, log_info, read_outcomes, write_trials


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


def test_folders_of_the_environment(home, monkeypatch):
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

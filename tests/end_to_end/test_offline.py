"""Whole runs: made-up recordings to a table of measures, and a run that is killed and taken up."""

import os
import signal
import subprocess
import sys

import numpy as np
import pytest

from meal_bayes.datasets import make_synthetic
from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.domain import load_domain
from meal_bayes.evaluation import compare, summarize
from meal_bayes.experiments import DEFAULT_AGENTS, OfflineConfig, run_offline
from meal_bayes.perception import build_percept_table
from meal_bayes.trial_log import check_log, salvage

KILLED = """
import os, signal, sys
from meal_bayes.learner import Learner
from meal_bayes.experiments import OfflineConfig, run_offline, store

store.environment = lambda: {"code": "pinned"}
run, done = Learner.ask, 0

def run_until(self, task, **options):
    global done
    done += 1
    if done == 130:
        os.kill(os.getpid(), signal.SIGKILL)
    return run(self, task, **options)

Learner.ask = run_until
config = OfflineConfig("roc36", 2, 120, ("random", "predefined_plus", "greedy"), seed=5)
run_offline(config, logs=sys.argv[1])
"""


def logs_of(folder):
    return {p.relative_to(folder): p.read_bytes() for p in sorted(folder.rglob("*.mcap"))}


@pytest.mark.long
def test_a_killed_run_is_taken_up_where_it_was(tmp_path, monkeypatch):
    monkeypatch.setattr("meal_bayes.experiments.store.environment", lambda: {"code": "pinned"})
    config = OfflineConfig("roc36", 2, 120, ("random", "predefined_plus", "greedy"), seed=5)
    whole = run_offline(config, logs=tmp_path / "whole")
    killed = subprocess.run(
        [sys.executable, "-c", KILLED, os.fspath(tmp_path / "killed")], check=False
    )
    assert killed.returncode == -signal.SIGKILL
    folder = tmp_path / "killed" / whole.folder.name
    before = logs_of(folder)
    assert len(before) == 1  # the first unit; of the second 29 trials were finished
    (torn,) = folder.rglob("*.active")
    finished = list(salvage(torn))
    expected = list(whole.trials())[120 : 120 + 29]
    assert [trial.task for trial in finished] == [trial.task for trial in expected]
    assert [trial.cost for trial in finished] == [trial.cost for trial in expected]
    steps = []
    again = run_offline(
        config, logs=tmp_path / "killed", on_progress=lambda *step: steps.append(step)
    )
    assert steps[0] == (100, 360)
    assert again.folder == folder
    assert logs_of(folder) == logs_of(whole.folder)
    assert not list(folder.rglob("*.active"))


@pytest.fixture(scope="module")
def synthetic(tmp_path_factory):
    """Percepts of made-up recordings of `toy`, from features to table, on disk."""
    folder = tmp_path_factory.mktemp("synthetic")
    rng = np.random.default_rng(4)  # of which each attribute can be told, by one behavior or both
    dataset = make_synthetic(
        load_domain("toy"), objects=24, recordings=4, rng=rng, signal=6.0, object_effect=0.5
    )
    save_percepts(build_percept_table(dataset), folder / "toy.npz")
    return folder


@pytest.mark.long
def test_made_up_recordings_from_features_to_measures(synthetic):
    config = OfflineConfig(str(synthetic / "toy.npz"), 2, 48, seed=1)
    run = run_offline(config, logs=synthetic / "logs")
    rows = {row.agent: row for row in summarize(run.trials(), seconds=run.seconds)}
    assert tuple(rows) == DEFAULT_AGENTS
    for row in rows.values():
        assert row.trials == 48
        wrong = 1 - row.accuracy - row.abstained
        assert row.reward == pytest.approx(100 * (row.accuracy - wrong) - row.cost_s)
    assert rows["random"].accuracy < 0.6
    for planned in ("morc", "bayes"):
        assert rows[planned].accuracy > 0.9
        assert rows[planned].reward > rows["random_legal"].reward
        assert rows[planned].cost_s < rows["random_legal"].cost_s
    better = compare(run.trials(), "bayes", "random")
    assert better.low > 0
    assert all(check_log(path).whole for path in run.paths)


GOLDEN = {  # actions of each trial: look, lift, reinit, and the four reports
    "predefined": ["013", "014", "015", "013", "013", "016"],
    "greedy": ["003", "004", "005", "003", "003", "004"],
    "bayes": ["003", "004", "005", "003", "003", "00004"],
}


def test_actions_are_those_of_earlier_versions(synthetic):
    """Who changes them on purpose changes them here."""
    run = run_offline(
        OfflineConfig(str(synthetic / "toy.npz"), 2, 6, tuple(GOLDEN), seed=1),
        logs=synthetic / "golden",
    )
    actions = {agent: [] for agent in GOLDEN}
    for trial in run.trials():
        actions[trial.agent].append("".join(str(step.decision.action) for step in trial.steps))
    assert actions == GOLDEN


@pytest.mark.long
def test_real_recordings_of_objects_never_learned_from(tmp_path):
    """A short run on the shipped ROC36; over 400 trials the paper has .860 at 29.85 s."""
    config = OfflineConfig("roc36", 2, 40, ("random_legal", "bayes"), seed=4)
    run = run_offline(config, logs=tmp_path)
    rows = {row.agent: row for row in summarize(run.trials(), seconds=run.seconds)}
    assert rows["bayes"].accuracy >= 0.95
    assert rows["bayes"].cost_s <= 16
    assert rows["bayes"].reward > rows["random_legal"].reward + 50

"""`data`: what there is, fetching it from a mirror, and tables of one's own recordings."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from meal_bayes.datasets import (
    load_dataset,
    load_percepts,
    make_synthetic,
    registry,
    save_csv_folder,
    sources,
)
from meal_bayes.domain import load_domain
from meal_bayes.perception import build_percept_table

HOME = "shiqizhang6/perception_pomdp/4ab4abf1a47ce184f0327d3c143533d482c2604c/data/icra2014"


@pytest.fixture
def mirror(tmp_path, monkeypatch, run):
    """Make a mirror of one file whose digest stands in the registry."""
    path = tmp_path / "mirror" / HOME / "objects.txt"
    path.parent.mkdir(parents=True)
    path.write_text("light_brown_rice")
    rows = {f"{HOME}/objects.txt": hashlib.sha256(path.read_bytes()).hexdigest()}
    monkeypatch.setattr(sources, "registry", lambda _data: rows)
    monkeypatch.setattr("meal_bayes.datasets.registry", lambda _data: rows)
    monkeypatch.setenv("MEAL_BAYES_DATA_URL", str(tmp_path / "mirror"))
    monkeypatch.delenv("MEAL_BAYES_OFFLINE")
    return path


def test_list_in_words_and_as_json(run):
    text = run("data", "list").stdout
    assert "roc36" in text
    told = json.loads(run("data", "list", "--json").stdout)
    assert [row["name"] for row in told["datasets"]] == ["roc36", "ispy32", "cy101"]
    assert told["datasets"][0] == {
        "name": "roc36", "objects": 36, "behaviors": 12, "attributes": 10, "recordings": 10,
        "files": len(registry("roc36")), "files_cached": 0,
    }  # fmt: skip
    alone = run("data", "list", "--root", ".")
    assert alone.exit_code == 2
    assert "name the data set" in alone.stderr


def test_list_tells_what_can_be_asked(run, table):
    text = run("data", "list", "kitchen.npz").stdout
    assert "red 4 of 8, full 4 of 8 objects" in text
    assert "lift 4 s" in text
    told = json.loads(run("data", "list", "kitchen.npz", "--json").stdout)
    assert told["behaviors"] == {"look": 1.0, "lift": 4.0}
    assert told["objects"][0] == "red_mug"
    assert told["objects_with"]["red"] == {"true": 4, "false": 4}
    assert told == json.loads(run("data", "list", "--dataset", "kitchen.npz", "--json").stdout)
    assert told["together"] == []  # eight objects couple nothing
    assert "both true" not in text


def test_list_tells_which_attributes_runs_ask(run):
    labels = load_percepts("ispy32").labels
    rarer = np.minimum((labels == 1).sum(axis=0), (labels == 0).sum(axis=0))
    told = json.loads(run("data", "list", "ispy32", "--json").stdout)
    assert len(told["asked_by_runs"]) == (rarer > 5).sum()
    assert "more than 5 objects" in run("data", "list", "ispy32").stdout


def test_list_tells_which_attributes_exclude_or_imply_each_other(run):
    told = json.loads(run("data", "list", "cy101", "--json").stdout)["together"]
    toys = {"attributes": ["container", "toy"], "both": 0, "objects": 100, "if_independent": 8.4}
    assert toys in told
    text = " ".join(run("data", "list", "cy101").stdout.split())
    assert "container and toy 0 (8 if independent)" in text


def test_list_of_two_data_sets_is_refused(fails):
    assert "give one of them" in fails("data", "list", "roc36", "--dataset", "cy101")


def test_fetch_then_verify(run, mirror):
    missing = run("data", "verify", "roc36")
    assert missing.exit_code == 1
    assert "missing: " in missing.stdout
    assert "meal-bayes data fetch roc36" in missing.stdout
    assert run("data", "fetch", "roc36").exit_code == 0
    sound = run("data", "verify", "roc36")
    assert (sound.exit_code, sound.stdout) == (0, "roc36: 1 of 1 files are as published\n")


@pytest.mark.parametrize("jobs", ["1", pytest.param("2", marks=pytest.mark.long)])
def test_own_recordings_end_to_end(run, kitchen, jobs):
    words = ("--dataset", "kitchen.toml", "--root", ".")
    made = run("data", "percepts", *words, "--out", "tables/own.npz", "--jobs", jobs)
    assert made.exit_code == 0
    assert made.stdout == "tables/own.npz: 8 objects, 2 behaviors, 2 attributes, 2 recordings\n"
    saved = load_percepts("tables/own.npz")
    built = build_percept_table(load_dataset("kitchen.toml", root="."))
    assert saved.domain == built.domain
    np.testing.assert_array_equal(saved.log_odds, built.log_odds)
    again = run("ask", "Is it red?", *words, "--object", "red_mug", "--agent", "prior")
    assert "computing" not in again.stderr


def test_recordings_of_a_domain_of_the_package_become_a_table(run):
    domain = load_domain("toy")
    rng = np.random.default_rng(1)
    save_csv_folder(make_synthetic(domain, objects=6, recordings=2, rng=rng), "rec")
    made = run("data", "percepts", "--dataset", "toy", "--root", "rec", "--out", "t.npz")
    assert made.exit_code == 0
    assert len(load_percepts("t.npz").objects) == 6


def test_a_missing_recording_is_told(run, kitchen):
    rows = Path("lift_force.csv").read_text().splitlines()
    Path("lift_force.csv").write_text("\n".join(rows[:-1]) + "\n")
    result = run("data", "percepts", "--dataset", "kitchen.toml", "--root", ".", "--out", "own.npz")
    assert "fewer than 2 recordings: green_bowl 1 of lift" in result.stderr
    assert load_percepts("own.npz").recording_counts.sum() == 8 * 2 * 2 - 1


def test_percepts_says_what_it_needs(fails, kitchen):
    options = ("data", "percepts", "--dataset", "kitchen.toml")
    assert "give --out" in fails(*options, "--root", ".")
    assert "ends in .npz" in fails(*options, "--root", ".", "--out", "own.csv")
    assert "give root=" in fails(*options, "--out", "own.npz")
    assert "forbids the network" in fails("data", "percepts", "--dataset", "roc36")


def test_a_table_made_again_is_compared(run, monkeypatch):
    shipped = load_percepts("roc36")
    monkeypatch.setattr("meal_bayes.datasets.load_dataset", lambda *_a, **_k: shipped)
    words = ("data", "percepts", "--dataset", "roc36")
    for shift, code, said in ((0.0, 0, "within 0.01"), (0.5, 1, "beyond 0.01")):
        moved = replace(shipped, log_odds=shipped.log_odds + np.float16(shift))
        monkeypatch.setattr(
            "meal_bayes.perception.build_percept_table", lambda *_a, m=moved, **_k: m
        )
        result = run(*words)
        assert result.exit_code == code
        assert said in result.stdout


def test_percepts_by_a_classifier_of_ones_own(run, kitchen):
    (kitchen / "mine.py").write_text(
        "from sklearn.linear_model import LogisticRegression\nbest = LogisticRegression(C=0.5)\n"
    )
    options = ("--dataset", "kitchen.toml", "--root", ".")
    result = run("data", "percepts", *options, "--classifier", "mine:best", "--out", "mine.npz")
    assert result.exit_code == 0
    told = load_percepts(kitchen / "mine.npz").provenance
    assert told["classifier"].endswith(":LogisticRegression")
    assert "C=0.5" in told["classifier_parameters"]
    name = "sklearn.naive_bayes:GaussianNB"
    assert run("data", "percepts", *options, "--classifier", name, "--out", "nb.npz").exit_code == 0


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("forest", "does not name a Python object; write it as package.module:name"),
        ("nowhere:forest", "cannot be imported"),
        ("sklearn.naive_bayes:GausianNB", "did you mean 'GaussianNB'"),
        ("os:getcwd", "expected a scikit-learn classifier"),
    ],
)
def test_names_of_no_classifier_are_told(fails, kitchen, name, message):
    options = ("--dataset", "kitchen.toml", "--root", ".")
    assert message in fails("data", "percepts", *options, "--classifier", name, "--out", "x.npz")

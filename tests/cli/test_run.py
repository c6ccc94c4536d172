"""`run offline`: one JSON object, paired comparisons, resumed after whatever stopped it."""

import json
from dataclasses import fields, replace
from pathlib import Path

import pytest

from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.evaluation import SummaryRow, compare
from meal_bayes.trial_log import read_trials

OWN = ("run", "offline", "--dataset", "kitchen.npz", "--attributes", "1")
OFFLINE = ("run", "offline", "--trials", "12", "--agent", "greedy,predefined_plus")


def test_json_is_one_object_with_every_field(run):
    result = run(*OFFLINE, "--agent", "random", "--seed", "5", "--json")
    assert result.exit_code == 0
    assert result.stdout.count("\n") == 1
    told = json.loads(result.stdout)
    assert list(told) == ["config", "rows", "paired", "log"]
    assert told["config"] == {
        "dataset": "roc36", "attributes": 2, "trials": 12, "seed": 5, "percepts": "recorded",
        "agents": ["greedy", "predefined_plus", "random"], "perception": "default", "reward": None,
        "answer": "values", "payoffs": None, "key": "",
    }  # fmt: skip
    assert [row["agent"] for row in told["rows"]] == told["config"]["agents"]
    for row in told["rows"]:
        assert list(row) == [field.name for field in fields(SummaryRow)]
        assert row["trials"] == 12
        assert 0 <= row["accuracy"] <= 1
        assert row["seconds"] > 0
    assert told["paired"] == []
    trials = [t for path in Path(told["log"]).rglob("*.mcap") for t in read_trials(path)]
    assert len(trials) == 36


def test_the_table_fits_and_names_the_log(run):
    result = run(*OFFLINE)
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    assert lines[0].split()[:3] == ["agent", "accuracy", "cost,"]
    assert [line.split()[0] for line in lines[1:3]] == ["greedy", "predefined_plus"]
    assert lines[3].startswith("12 trials for each agent")
    assert "trials in logs/offline-roc36-n2-seed0-" in result.stderr


def test_agents_are_held_against_answering_untouched(run, table):
    text = run("run", "offline", "--trials", "40", "--agent", "prior,random").stdout
    assert "than prior, which answers without touching the object: random (" in text


def test_agents_are_compared_with_the_papers(run, table):
    words = (*OWN, "--trials", "12", "--agent", "morc,greedy", "--agent", "random")
    told = json.loads(run(*words, "--json").stdout)
    assert [entry["agent"] for entry in told["paired"]] == ["greedy", "random"]
    trials = [t for path in Path(told["log"]).rglob("*.mcap") for t in read_trials(path)]
    for entry in told["paired"]:
        expected = compare(trials, entry["agent"], "morc", measure="reward")
        assert entry == {
            "agent": entry["agent"], "against": "morc", "measure": "reward", **expected._asdict()
        }  # fmt: skip
    text = run(*words).stdout
    assert "reward against morc" in text
    assert "95 % interval" in text


def test_percepts_and_reward_reach_the_trials(run):
    words = ("run", "offline", "--trials", "3", "--agent", "predefined_plus", "--percepts", "model")
    told = json.loads(run(*words, "--reward", "50", "--json").stdout)
    (path,) = Path(told["log"]).rglob("*.mcap")
    for trial in read_trials(path):
        assert trial.momdp.correct == 50
        assert trial.reward == pytest.approx((50 if trial.success else -50) - trial.cost)
    assert told["config"]["percepts"] == "model"


def test_a_second_call_computes_nothing_unless_fresh(run):
    first = run(*OFFLINE, "--json")
    folder = Path(json.loads(first.stdout)["log"])
    stamps = {path: path.stat().st_mtime_ns for path in folder.rglob("*.mcap")}
    again = run(*OFFLINE, "--json")
    assert again.stdout == first.stdout
    assert "24 of 24 trials are there already" in again.stderr
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.mcap")} == stamps
    assert run(*OFFLINE, "--fresh").exit_code == 0
    assert all(path.stat().st_mtime_ns > stamp for path, stamp in stamps.items())


def test_another_table_of_the_same_name_is_another_run(run, table):
    words = (*OWN, "--trials", "4", "--agent", "greedy", "--json")
    first = json.loads(run(*words).stdout)
    save_percepts(replace(table, log_odds=-table.log_odds), "kitchen.npz")
    second = json.loads(run(*words).stdout)
    assert first["log"] != second["log"]
    assert first["rows"][0]["accuracy"] == 1.0
    assert second["rows"][0]["accuracy"] == 0.0


def test_the_papers_classifiers_need_recordings(fails, table):
    error = fails("run", "offline", "--dataset", "kitchen.npz", "--perception", "paper")
    assert "is a percept table of another method" in error
    public = fails("run", "offline", "--perception", "paper", "--agent", "greedy")
    assert "MEAL_BAYES_OFFLINE forbids the network" in public

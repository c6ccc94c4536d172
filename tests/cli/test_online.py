"""`run online`: one JSON object, a table, one line for what is wrong, nothing done twice."""

import json
from dataclasses import fields
from pathlib import Path

import pytest

from meal_bayes.evaluation.learning import LearningRow, LearningSummary
from meal_bayes.trial_log import log_info

SMALL = ("--batches", "2", "--trials", "4")


@pytest.fixture
def words(own_data):
    """The command, on data of one's own."""
    return ("run", "online", "--dataset", own_data, "--root", own_data.parent, *SMALL)


def test_json_has_every_field_and_a_table_of_two_splits_no_interval(run, words):
    # by this seed both repeats know objects before training that tell something: who has learned
    # nothing answers at once, and explores for no hours
    seeded = ("--repeats", "2", "--seed", "3")
    result = run(*words, "--agent", "bayes,iterative_morc", *seeded, "--json")
    assert result.exit_code == 0
    assert result.stdout.count("\n") == 1
    told = json.loads(result.stdout)
    assert list(told) == ["config", "rows", "summary"]
    config = told["config"]
    assert config["agents"] == ["bayes", "iterative_morc"]
    assert [(r["agent"], r["repeat"], r["batch"]) for r in told["rows"]] == [
        (agent, repeat, batch)
        for agent in config["agents"]
        for repeat in (0, 1)
        for batch in (0, 1, 2)
    ]
    for row in told["rows"]:
        assert list(row) == [field.name for field in fields(LearningRow)]
        assert 0 <= row["accuracy"] <= 1
        assert 0 <= row["certainty"] <= 1
        assert (row["hours"] == 0) == (row["batch"] == 0)
    assert [row["agent"] for row in told["summary"]] == config["agents"]
    for row in told["summary"]:
        assert list(row) == [field.name for field in fields(LearningSummary)]
    reference = told["summary"][0]
    assert reference["area_reward_difference"] == reference["reward_after_difference"] == 0
    forms = [(p.name[3:-5], log_info(p).form) for p in Path("logs").rglob("*.mcap")]
    assert len(forms) == 2 * 2 * 5
    assert set(forms) == {("train", "full"), ("test", "compact")}
    result = run(*words, "--agent", "bayes,iterative_morc", *seeded)  # the same, as a table
    (row,) = (line for line in result.stdout.splitlines()[5:] if line.startswith("iterative"))
    assert "±" not in row
    assert "+-" not in row
    assert "too few splits for an interval; give --repeats 5" in result.stdout
    assert "nan" not in result.stdout


def test_the_table_fits_and_names_the_log(run, words):
    result = run(*words, "--agent", "bayes,iterative_morc")
    lines = result.stdout.splitlines()
    assert max(map(len, lines)) <= 80
    names = "agent explored, h accuracy certainty test cost, s reward ECE"
    assert lines[0].split() == names.split()
    assert [line.split()[0] for line in lines[1:3]] == ["bayes", "iterative_morc"]
    assert lines[3].startswith("repeats: 1;")
    assert "reward less bayes's" in result.stdout
    assert "nan" not in result.stdout
    assert "trials in logs/online-own-n1-" in result.stderr


@pytest.mark.long
def test_a_run_until_decided_ends_at_its_most_repeats(run, words):
    same = ("--agent", "iterative_morc,morc", "--until-decided", "--repeats", "2")
    told = json.loads(run(*words, *same, "--json").stdout)
    assert told["config"]["repeats"] == 2
    assert told["summary"][1]["area_low"] <= 0 <= told["summary"][1]["area_high"]


@pytest.mark.long
def test_a_second_call_computes_nothing_unless_fresh(run, words):
    words = (*words, "--agent", "bayes", "--json")
    first = run(*words)
    (folder,) = Path("logs").iterdir()
    stamps = {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")}
    again = run(*words)
    assert again.stdout == first.stdout
    assert "3 of 3 batches are there already" in again.stderr
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.*")} == stamps
    fresh = run(*words, "--fresh")
    assert fresh.stdout == first.stdout
    assert "there already" not in fresh.stderr
    assert all(path.stat().st_mtime_ns > stamp for path, stamp in stamps.items())


def test_options_reach_the_run(run, words):
    options = (
        "--attributes", "2", "--split", "1", "1", "2", "--alpha", "3", "--beta", "10",
        "--seed", "9", "--log", "full", "--agent", "morc_itrs", "--normalizer", "all",
    )  # fmt: skip
    told = json.loads(run(*words, *options, "--json").stdout)
    config = told["config"]
    expected = {
        "attributes": 2, "split": [1, 1, 2], "alpha": 3.0, "beta": 10.0, "seed": 9,
        "log": "full", "normalizer": "all", "agents": ["morc_itrs"],
    }  # fmt: skip
    assert {name: config[name] for name in expected} == expected
    logs = [*Path("logs").rglob("*.mcap")]
    assert {log_info(path).form for path in logs} == {"full"}


def test_a_cluster_that_does_not_answer_is_one_line(dask, fails, words, monkeypatch):
    monkeypatch.setattr("meal_bayes.experiments.parallel._PATIENCE", 0.3)
    told = fails(*words, "--agent", "bayes", "--cluster", "tcp://127.0.0.1:9")
    assert "No Dask scheduler answers at tcp://127.0.0.1:9" in told

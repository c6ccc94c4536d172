"""`ask --learn` remembers what it is told; `memory` shows and forgets it."""

import json
import warnings
from pathlib import Path

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.learner import Learner
from meal_bayes.learner.recalled import hear
from meal_bayes.trial_log import read_trials
from meal_bayes.trials import Trial

OWN = ("--dataset", "kitchen.npz")
BOTH = "Is it crimson, and is it full?"


@pytest.fixture
def ask(run, table):
    """Return a function that asks with --learn, and says what a person replies."""

    def invoke(question, reply, name="red_jar", *more):
        words = ["ask", question, *OWN, "--object", name, "--agent", "greedy", "--learn", *more]
        result = CliRunner().invoke(main, words, input=reply)
        assert result.exit_code == 0, result.stderr
        return result

    return invoke


def facts(result):
    return json.loads(result.stdout)["trial"]


def remembered(run):
    told = json.loads(run("memory", "show", *OWN, "--json").stdout)["memory"]
    return [(entry["object"], entry["labels"]) for entry in told]


def test_the_next_ask_is_wiser(ask):
    first = facts(ask("Is it red?", "yes\n", "red_jar", "--json"))
    assert first["cost_s"] > 0
    assert first["report"] == {"red": True}
    second = facts(ask("Is it red?", "skip\n", "red_jar", "--json"))
    assert second["report"] == {"red": True}
    assert second["cost_s"] == 0.0
    assert second["belief"]["red"] == pytest.approx(0.99)
    other = facts(ask("Is it red?", "skip\n", "red_mug", "--json"))
    assert other["cost_s"] > 0  # of another object nothing was told


def test_no_tells_the_opposite_of_one_attribute(ask, run):
    ask("Is it red?", "no\n")
    assert remembered(run) == [("red_jar", {"red": False})]
    ask("Is it red?", "no\n")  # it said "not red"; that was wrong, too, and the later word holds
    assert facts(ask("Is it red?", "", "red_jar", "--json"))["report"] == {"red": True}


def test_y_and_n_are_enough_and_what_is_known_is_not_asked_again(ask, run):
    ask("Is it red?", "y\n")
    result = ask(BOTH, "maybe\nn\nn\n")
    assert "'maybe' is not one of 'y', 'yes', 'n'" in result.stderr
    assert "Is it full?" in result.stderr
    assert "Is it red?" not in result.stderr  # it was told
    assert remembered(run) == [("red_jar", {"red": True, "full": False})]


@pytest.mark.parametrize("answered", [True, False])
def test_without_a_right_answer_it_asks_for_each(ask, run, monkeypatch, answered):
    if not answered:
        without = lambda trial: object.__setattr__(trial, "report", None)  # noqa: E731
        monkeypatch.setattr(Trial, "__post_init__", without)
    result = ask(BOTH, "no\n" * answered + "yes\nskip\n")
    assert ("right?" in result.stderr) == answered
    assert "Is it full?" in result.stderr
    assert remembered(run) == [("red_jar", {"red": True})]


@pytest.mark.parametrize("reply", ["", "no\nskip\nskip\n"])
def test_nothing_told_is_nothing_remembered(ask, run, reply):
    assert "none are kept" in ask(BOTH, reply).stderr
    assert remembered(run) == []
    assert len(list(Path("logs").glob("ask-*.mcap"))) == 1  # the trial is kept


def test_show_and_forget(ask, run):
    assert "no labels yet" in run("memory", "show", *OWN).stderr
    ask("Is it red?", "yes\n")
    ask("Is it full?", "yes\n", "blue_mug")
    shown = run("memory", "show", *OWN).stdout
    assert "red_jar" in shown
    assert "blue_mug" in shown
    told = json.loads(run("memory", "show", *OWN, "--json").stdout)["memory"]
    assert [row["labels"] for row in told] == [{"red": True}, {"full": True}]
    logs = list(Path("logs").glob("ask-*.mcap"))
    before = {log: [trial.cost for trial in read_trials(log)] for log in logs}
    wrong = run("memory", "forget", *OWN, "--object", "red_jra")
    assert wrong.exit_code == 2
    assert "'red_jra'" in wrong.stderr
    assert "'red_jar'" in wrong.stderr
    assert "of 1 objects" in run("memory", "forget", *OWN, "--object", "red_jar").stderr
    assert remembered(run) == [("blue_mug", {"full": True})]
    run("memory", "forget", *OWN)
    assert remembered(run) == []
    for log, costs in before.items():
        assert [t.cost for t in read_trials(log)] == costs  # trials stay


def test_a_recorded_object_is_no_slip_of_another(ask, monkeypatch):
    monkeypatch.setattr("meal_bayes.learner.told._ALIKE", 0.6)
    ask("Is it red?", "yes\n", "red_can")
    with warnings.catch_warnings(record=True) as told:
        said = ask("Is it red?", "yes\n", "red_jar").stderr
    assert not [one for one in told if "did you mean" in str(one.message)]
    assert "did you mean" not in said


def test_what_is_taken_back_may_be_told_again(ask, run):
    for reply, red in (("yes\n", True), ("no\n", False)):
        ask("Is it red?", reply)
        assert remembered(run) == [("red_jar", {"red": red})]
        run("memory", "forget", *OWN)
        assert remembered(run) == []


@pytest.mark.parametrize("end", [0, 9, -9])
def test_a_torn_label_is_left_out_with_a_note(ask, run, end):
    ask("Is it red?", "yes\n", "blue_mug")
    (path,) = Path("logs").rglob("*.feedback.mcap")
    path.write_bytes(torn := path.read_bytes()[:end])
    assert "left out of what was told" in ask("Is it red?", "yes\n").stderr
    assert remembered(run) == [("red_jar", {"red": True})]
    assert "of 1 objects" in run("memory", "forget", *OWN).stderr
    assert path.read_bytes() == torn  # what nobody can read is not thrown away


def test_what_a_learner_in_python_is_told_is_remembered_too(ask, run, table):
    learner = Learner(table.domain, agent="greedy", logs="logs")
    learner.tell("red_jar", {"red": True})
    assert remembered(run) == [("red_jar", {"red": True})]
    assert facts(ask("Is it red?", "skip\n", "red_jar", "--json"))["cost_s"] == 0.0
    run("memory", "forget", *OWN)
    hear(learner, Path("logs") / table.domain.name, pytest.fail)
    assert not (learner.experience.object_labels.values >= 0).any()

"""`ask --learn` remembers what it is told; `memory` shows and forgets it."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.trial_log import read_header, read_memory, read_trials
from meal_bayes.trials import Trial

TRIAL_LOGS = Path(__file__).resolve().parents[1] / "trial_log"
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


def test_no_tells_the_opposite_of_one_attribute(ask):
    ask("Is it red?", "no\n")
    (told,) = read_memory("logs", "kitchen")
    assert (told.object_name, dict(told.values)) == ("red_jar", {"red": False})
    ask("Is it red?", "no\n")  # it said "not red"; that was wrong, too, and the later word holds
    assert facts(ask("Is it red?", "", "red_jar", "--json"))["report"] == {"red": True}


def test_y_and_n_are_enough_and_what_is_known_is_not_asked_again(ask):
    ask("Is it red?", "y\n")
    result = ask(BOTH, "maybe\nn\nn\n")
    assert "'maybe' is not understood; type y or n" in result.stderr
    assert "Is it full?" in result.stderr
    assert "Is it red?" not in result.stderr  # it was told
    assert dict(read_memory("logs", "kitchen")[-1].values) == {"full": False}


@pytest.mark.parametrize("answered", [True, False])
def test_without_a_right_answer_it_asks_for_each(ask, monkeypatch, answered):
    if not answered:
        without = lambda trial: object.__setattr__(trial, "report", None)  # noqa: E731
        monkeypatch.setattr(Trial, "__post_init__", without)
    result = ask(BOTH, "no\n" * answered + "yes\nskip\n")
    assert ("right?" in result.stderr) == answered
    assert "Is it full?" in result.stderr
    (told,) = read_memory("logs", "kitchen")
    assert dict(told.values) == {"red": True}


@pytest.mark.parametrize("reply", ["", "no\nskip\nskip\n"])
def test_nothing_told_is_nothing_remembered(ask, reply):
    assert "none are kept" in ask(BOTH, reply).stderr
    assert read_memory("logs", "kitchen") == []
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
    before = {row["log"]: [t.cost for t in read_trials(row["log"])] for row in told}
    assert "in 1 trials" in run("memory", "forget", *OWN, "--object", "red_jar").stderr
    assert [t.object_name for t in read_memory("logs", "kitchen")] == ["blue_mug"]
    run("memory", "forget", *OWN)
    assert read_memory("logs", "kitchen") == []
    for log, costs in before.items():
        assert [t.cost for t in read_trials(log)] == costs  # trials stay
        assert "told" not in read_header(log)


@pytest.mark.parametrize("damage", ["torn", "old"])
def test_a_log_that_cannot_be_read_is_left_out_with_a_warning(ask, run, caplog, damage):
    ask("Is it red?", "yes\n", "blue_mug")
    (path,) = Path("logs").glob("ask-*.mcap")
    content = {
        "torn": path.read_bytes()[:200],
        "old": (TRIAL_LOGS / "format1.mcap").read_bytes(),
    }[damage]
    path.write_bytes(content)
    facts(ask("Is it red?", "yes\n", "red_jar", "--json"))
    shown = json.loads(run("memory", "show", *OWN, "--json").stdout)["memory"]
    assert [row["object"] for row in shown] == ["red_jar"]
    assert all("left out of the memory" in record.message for record in caplog.records)
    assert path.name in caplog.text
    assert "in 1 trials" in run("memory", "forget", *OWN).stderr
    assert path.read_bytes() == content


def test_a_torn_log_is_forgotten_with_its_whole_trials_kept(ask, run):
    ask("Is it red?", "yes\n")
    (path,) = Path("logs").glob("ask-*.mcap")
    timing = path.with_name(path.stem + ".timing.csv").read_bytes()
    path.write_bytes(path.read_bytes()[:-60])
    assert "in 1 trials" in run("memory", "forget", *OWN).stderr
    assert read_memory("logs", "kitchen") == []
    assert len(list(read_trials(path))) == 1
    assert path.with_name(path.stem + ".timing.csv").read_bytes() == timing

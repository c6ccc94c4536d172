"""`ask` answers, in words and as JSON, and logs what it did; the demo says what to do next."""

import json
import shlex
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.datasets.percepts import save_percepts
from meal_bayes.trial_log import log_info, read_trials

QUESTION = "Is it crimson, and is it full?"
OWN = ("ask", QUESTION, "--dataset", "kitchen.npz", "--object", "red_jar", "--agent", "greedy")


def test_an_answer_in_words(run):
    result = run("ask", "Is it heavy?", "--object", "heavy_blue_beans", "--agent", "greedy")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()
    assert lines[:2] == ["  question   Is it heavy?", "  object     heavy_blue_beans"]
    assert lines[2].startswith("  steps      look, ")
    assert lines[3].startswith("  belief     heavy >99")
    assert "  answer     heavy" in lines
    assert "  verdict    right" in lines
    assert max(map(len, lines)) <= 80
    (path,) = Path("logs").glob("ask-heavy_blue_beans-*.mcap")
    assert str(path) in result.stderr


def test_own_table_and_synonyms(run, table):
    told = json.loads(run(*OWN, "--json").stdout)
    assert told["config"] == {
        "command": "ask", "question": QUESTION, "dataset": "kitchen.npz", "object": "red_jar",
        "agent": "greedy", "seed": 0, "yes_no": False, "payoffs": None,
    }  # fmt: skip
    trial = told["trial"]
    assert trial["report"] == trial["truth"] == {"red": True, "full": True}
    assert trial["success"] is True
    assert trial["reward"] == pytest.approx(100 - trial["cost_s"])
    assert trial["cost_s"] == pytest.approx(sum(step["cost_s"] for step in trial["steps"]))
    assert trial["steps"][-1]["action"] == "report red, full"
    assert trial["steps"][0]["percept"] == {"red": 1, "full": 1}
    assert trial["belief"] == trial["steps"][-1]["belief"]
    (logged,) = read_trials(told["log"])
    assert (logged.agent, logged.cost) == ("greedy", trial["cost_s"])
    header = log_info(told["log"]).header
    assert (header["config"], header["seed"]) == (told["config"], 0)


def test_equal_commands_write_equal_logs(run, table):
    logs = []
    for folder in ("one", "two"):
        path = Path(json.loads(run(*OWN, "--json", "--logs", folder).stdout)["log"])
        assert path.parent == Path(folder)
        logs.append((path.name, path.read_bytes()))
    assert logs[0] == logs[1]
    other = Path(json.loads(run(*OWN, "--json", "--seed", "1").stdout)["log"])
    assert other.name != logs[0][0]


def test_an_object_with_an_odd_name_gets_a_plain_file_name(run, table):
    odd = "../../red jar"
    save_percepts(replace(table, objects=(odd, *table.objects[1:])), "odd.npz")
    words = ("ask", "red", "--dataset", "odd.npz", "--object", odd, "--agent", "greedy", "--json")
    path = Path(json.loads(run(*words).stdout)["log"])
    assert path.parent == Path("logs")
    assert path.name.startswith("ask-__.._red_jar-")
    assert path.is_file()


def test_an_unknown_truth_is_not_judged(run, table):
    labels = table.labels.copy()
    labels[0, 0] = -1
    save_percepts(replace(table, labels=labels), "hidden.npz")
    words = ("ask", "red", "--dataset", "hidden.npz", "--object", "red_mug", "--agent", "greedy")
    told = run(*words).stdout
    assert "unknown" in told
    assert "verdict" not in told
    trial = json.loads(run(*words, "--json").stdout)["trial"]
    assert (trial["truth"], trial["success"], trial["reward"]) == ({"red": None}, None, None)


@pytest.fixture(scope="module")
def told(tmp_path_factory):
    """Return what the demo prints in a terminal of 80 columns, and its folder."""
    with pytest.MonkeyPatch.context() as patch:
        folder = tmp_path_factory.mktemp("demo")
        patch.chdir(folder)
        patch.setenv("COLUMNS", "80")
        result = CliRunner().invoke(main, ["demo"])
    assert result.exit_code == 0, result.output
    return result.stdout, folder


def test_it_tells_every_part_of_a_trial(told):
    text, _ = told
    assert "\x1b" not in text
    assert max(map(len, text[: text.index("what next")].splitlines())) <= 80
    for part in (
        "Is it heavy, and does it hold beans?", "heavy_blue_beans", "before any behavior",
        "1  look", "expected reward", "not heavy, not beans", "succeeded, looked at → grasped",
        "percept    heavy: ", "answer     heavy, beans", "verdict    right",
    ):  # fmt: skip
        assert part in text
    assert text.count("  belief ") == text.count("  outcome ") + 1


def test_what_comes_next_works(told, run, monkeypatch):
    text, folder = told
    monkeypatch.chdir(folder)
    commands = [line.strip() for line in text.splitlines() if line.startswith("  meal-bayes ")]
    assert len(commands) == 3
    show, ask, many = (shlex.split(command)[1:] for command in commands)
    shown = run(*show)
    assert shown.exit_code == 0
    assert text[text.index("before any") : text.index("what next")].strip() in shown.stdout
    assert run(*ask, "--agent", "greedy").exit_code == 0
    few = ["2" if word == "100" else word.replace("bayes", "greedy") for word in many]
    assert run(*few).exit_code == 0

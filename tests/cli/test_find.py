"""`meal-bayes find`: what it prints, logs and refuses."""

import json

import pytest
from click.testing import CliRunner

from meal_bayes.cli import main
from meal_bayes.trial_log import read_trials

BOXES = "heavy_blue_beans,light_blue_beans,medium_brown_rice"


def run(*args):
    return CliRunner().invoke(main, list(args))


def test_it_names_the_object_and_logs_what_it_explored(tmp_path):
    options = ("--objects", BOXES, "--agent", "olfc", "--logs", str(tmp_path))
    shown = run("find", "Which one is heavy and blue?", *options)
    assert shown.exit_code == 0, shown.output
    assert "heavy_blue_beans" in shown.stdout
    assert "right" in shown.stdout
    told = json.loads(run("find", "Which one is heavy and blue?", *options, "--json").stdout)
    assert told["search"]["claim"] == "heavy_blue_beans"
    assert told["search"]["success"] is True
    trials = list(read_trials(told["log"]))
    assert [t.task.object_name for t in trials if t.report is not None] == ["heavy_blue_beans"]
    page = run("log", "show", told["log"])
    assert "heavy_blue_beans" in page.stdout


def test_a_search_that_explores_nothing_has_no_log(tmp_path):
    options = ("--objects", BOXES, "--agent", "olfc", "--logs", str(tmp_path))
    shown = run("find", "heavy", *options, "--turn-cost", "1e6")
    assert "none of them" in shown.stdout
    assert "log show" not in shown.output
    assert list(tmp_path.rglob("*.mcap")) == []


@pytest.mark.parametrize(
    ("args", "match"),
    [
        (("--objects", "heavy_blue_beans,heavy_blue_beans"), "named twice"),
        (("--objects", "cup"), "cup"),
        (("--objects", BOXES, "--none", "900"), "nothing would be searched"),
        (("--objects", BOXES, "--agent", "random"), "compares no values"),
        ((), "--objects"),
    ],
)
def test_wrong_input_is_one_line(tmp_path, args, match):
    done = run("find", "heavy", *args, "--logs", str(tmp_path))
    assert done.exit_code == 2
    assert match in done.stderr
    assert "Traceback" not in done.output
    assert not list(tmp_path.rglob("*.mcap"))

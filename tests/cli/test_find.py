"""`meal-bayes find` on recordings."""

import json
from pathlib import Path

import pytest

from meal_bayes.trial_log import read_trials

BOXES = "light_blue_beans,heavy_green_glass,heavy_blue_beans"
ASKED = ("find", "Which one is heavy and blue?", "--objects", BOXES, "--agent", "olfc")


def test_it_says_which_one_and_where_the_trials_are(run, tmp_path):
    result = run(*ASKED, "--logs", tmp_path, "--json")
    assert result.exit_code == 0, result.output
    told = json.loads(result.stdout)
    assert told["object"] == "heavy_blue_beans"
    assert told["success"] is True
    costs = [trial["cost_s"] for trial in told["trials"].values()]
    assert told["cost_s"] == pytest.approx(sum(costs))
    assert [trial.cost for trial in read_trials(told["log"])] == costs


def test_equal_runs_leave_equal_logs(run, tmp_path):
    def logs():
        result = run(*ASKED, "--logs", tmp_path)
        assert result.exit_code == 0, result.output
        assert "heavy_blue_beans" in result.stdout
        return {path.name: path.read_bytes() for path in tmp_path.rglob("*.mcap")}

    assert logs() == logs()


def test_the_folder_holds_the_trials_of_the_last_run_alone(run, tmp_path):
    where = ("--logs", tmp_path, "--json")
    told = json.loads(run(*ASKED, *where).stdout)
    (log, *_) = sorted(Path(told["log"]).glob("*.mcap"))
    (log.parent / "07-of_other_data.mcap").write_bytes(log.read_bytes())
    assert json.loads(run(*ASKED, *where).stdout) == told
    assert len(list(read_trials(told["log"]))) == len(told["trials"])


def test_an_unknown_object_is_told_in_one_line(run, tmp_path):
    result = run("find", "blue", "--objects", "nothing", "--logs", tmp_path)
    assert result.exit_code == 2
    assert "nothing" in result.stderr

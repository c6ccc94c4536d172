"""`log`: what a file holds, one trial of it, whether it is sound, what a torn one still has."""

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from meal_bayes.trial_log import (
    FORMAT_VERSION,
    Feedback,
    check_log,
    read_trials,
    write_trials,
)
from meal_bayes.trial_log.folder import write_feedback
from meal_bayes.trials import TrialOutcomes

SAMPLE = Path(__file__).resolve().parents[2] / "logs" / "sample.mcap"
HEADER = {"config": {"dataset": "roc36", "agents": ["greedy"]}, "seed": 4}


@pytest.fixture
def log(run, trials):
    """Write a log of three trials."""
    write_trials("a.mcap", trials, header=HEADER)
    return Path("a.mcap")


@pytest.fixture
def torn(log):
    """Cut the log in its last trial."""
    path = Path("torn.mcap")
    content = log.read_bytes()
    for size in range(len(content), 0, -500):
        path.write_bytes(content[:size])
        if check_log(path).trials == 2:
            break
    return path


def test_info_and_show(run, log, fails):
    text = run("log", "info", log).stdout
    assert "3 trials" in text
    assert "dataset roc36" in text
    told = json.loads(run("log", "info", log, "--json").stdout)
    assert (told["path"], told["trials"]) == ("a.mcap", 3)
    assert told["header"]["config"] == HEADER["config"]
    first = run("log", "show", log).stdout
    assert "heavy_blue_beans" in first
    assert "verdict    right" in first
    assert "medium_green_glass" in run("log", "show", log, "--trial", "2").stdout
    assert "contains 3 complete trials; give --trial 0" in fails("log", "show", log, "--trial", "3")


def test_info_has_a_line_a_question_and_each_fact_once(run):
    lines = run("log", "info", SAMPLE).stdout.splitlines()
    seeds = [line for line in lines if "seed" in line]
    assert [line.split() for line in seeds] == [["seed", "0"]]
    asked = [
        line.split("questions")[-1].strip() for line in lines if line.endswith(("?", "beans?"))
    ]
    assert asked[:2] == ["Is it heavy, and does it hold beans?", "Is it blue?"]
    assert len(asked) == 5


def test_folders_and_compact_logs_are_read(run, log, torn):
    write_trials("run/a.mcap", read_trials(log), header=HEADER)
    outcomes = TrialOutcomes.of(read_trials(log))
    write_trials("run/b.mcap", [outcomes], header={**HEADER, "seed": 5})
    assert "(2 files)" in run("log", "info", "run").stdout
    assert [row["form"] for row in json.loads(run("log", "info", "run", "--json").stdout)["files"]]
    assert "heavy_blue_beans" in run("log", "show", "run", "--trial", "3").stdout
    shown = run("log", "show", "run/b.mcap", "--trial", "1").stdout
    assert "light_blue_rice" in shown
    assert "truth" in shown
    assert run("log", "check", "run").exit_code == 0
    Path("run/c.mcap").write_bytes(torn.read_bytes())
    assert run("log", "check", "run").exit_code == 1


def test_check(run, log, torn):
    assert "undamaged" in run("log", "check", log).stdout
    broken = run("log", "check", torn, "--json")
    assert broken.exit_code == 1
    told = json.loads(broken.stdout)
    assert told["whole"] is False
    assert told["problems"]
    assert "meal-bayes log recover torn.mcap" in run("log", "check", torn).stdout


def test_recover(run, log, torn, fails):
    told = json.loads(run("log", "recover", torn, "--json").stdout)
    assert told["path"] == "torn.recovered.mcap"
    saved = list(read_trials(told["path"]))
    assert len(saved) == told["trials"] > 0
    assert saved[0].cost == next(read_trials(log)).cost
    assert "exists already" in fails("log", "recover", torn)
    line = run("log", "recover", torn, "--out", "b.mcap").stdout
    assert f"{len(saved)} trials saved" in line


def test_what_is_no_sound_log_is_told(fails, torn, log, monkeypatch):
    assert "contains 2 complete trials" in fails("log", "show", torn, "--trial", "2")
    Path("text.mcap").write_text("hello")
    told = fails("log", "info", "text.mcap")
    assert "text.mcap" in told
    assert "log recover" not in told  # nothing of it is a log
    assert "text.mcap" in fails("log", "recover", "text.mcap")
    trials = list(read_trials(log))
    with monkeypatch.context() as later:
        later.setattr("meal_bayes.trial_log.file.FORMAT_VERSION", FORMAT_VERSION + 1)
        write_trials("new.mcap", trials, header=HEADER)
    for command in ("info", "show", "check", "recover"):
        told = fails("log", command, "new.mcap")
        assert f"format {FORMAT_VERSION + 1}" in told
        assert f"reads format {FORMAT_VERSION}" in told


def test_a_trial_is_drawn_from_its_log(run, tmp_path):
    shutil.copy(SAMPLE, tmp_path / "a.mcap")
    for name, options in (("a.svg", ()), ("b.png", ("--dark",)), ("c.svg", ("--narrow",))):
        told = run("log", "show", "a.mcap", "--picture", name, *options)
        assert told.stdout == f"{name}: {Path(name).stat().st_size:,} bytes\n"
    assert Path("a.svg").read_bytes() != Path("c.svg").read_bytes()
    for words, says in (
        (("--picture", "a.gif"), "ends in .png, .pdf or .svg"),
        (("--dark",), "--dark and --narrow only change a picture"),
        (("--picture", "a.mcap"), "ends in .png, .pdf or .svg"),
    ):
        told = run("log", "show", "a.mcap", *words)
        assert told.exit_code != 0
        assert says in " ".join(told.stderr.split())


def test_every_log_of_a_file_is_recovered_and_what_is_not_read_is_told(run, log):
    data = Path(log).read_bytes()
    trials = len(list(read_trials(log)))
    Path("both.mcap").write_bytes(data * 2)
    done = run("log", "recover", "both.mcap")
    assert done.exit_code == 0
    assert f"{2 * trials} trials saved" in done.stdout
    assert "bytes follow the end of the log" in done.stderr
    Path("both.mcap").write_bytes(data + b"torn" + data)
    done = run("log", "recover", "both.mcap", "--out", "out.mcap", "--json")
    assert done.exit_code == 3
    told = json.loads(done.stdout)
    assert (told["trials"], told["unread_bytes"]) == (2 * trials, 4)


def test_a_label_s_log_says_what_was_told(run, tmp_path):
    told = Feedback("blue cup", {"heavy": 1, "beans": 0, "full": -1}, ("kitchen", "live", "1"))
    path = write_feedback(tmp_path, told, header={"data": "kitchen"})
    said = "what was told of blue cup: heavy, not beans, full taken back"
    assert said in " ".join(run("log", "info", path).stdout.split())
    assert "undamaged" in run("log", "check", path).stdout


@pytest.mark.parametrize("measure", ["reward", "cost", "success"])
def test_compare_says_who_is_ahead_or_that_it_cannot_be_said(run, fails, measure):
    run("run", "offline", "--trials", "12", "--agent", "predefined_plus,prior", "--logs", "study")
    words = ("compare", "study", "--measure", measure, "--reference", "prior")
    (row,) = json.loads(run(*words, "--json").stdout)["comparisons"]
    assert (row["agent"], row["reference"], row["tasks"]) == ("predefined_plus", "prior", 12)
    better = -1 if measure == "cost" else 1
    side = (row["low"] > 0) - (row["high"] < 0)
    assert row["verdict"] == {1: "ahead", -1: "behind", 0: "cannot be said"}[better * side]
    assert row["verdict"] in run(*words).stdout
    assert "'nobody'" in fails("compare", "study", "--reference", "nobody")


def test_a_comparison_on_one_object_has_no_interval(run, log):
    trials = [
        replace(trial, agent=agent) for trial in read_trials(log) for agent in ("prior", "bayes")
    ]
    write_trials("one.mcap", trials[:2], header={})
    table = run("compare", "one.mcap").stdout
    assert "nan" not in table
    assert " - " in table


@pytest.mark.parametrize("command", [("compare", "study"), ("report", "study")])
def test_what_counts_trials_says_which_logs_are_damaged(run, command):
    run("run", "offline", "--trials", "6", "--agent", "predefined_plus,prior", "--logs", "study")
    (log,) = Path("study").glob("*/prior/*.mcap")
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    result = run(*command)
    assert result.exit_code == 0
    assert log.name in result.stderr
    assert "what can be read" in result.stderr


def test_a_folder_is_checked_with_its_labels(run, log, tmp_path):
    (folder := tmp_path / "live").mkdir()
    shutil.copy(log, folder)
    paths = [write_feedback(folder, Feedback("cup", {"heavy": k}), header={}) for k in (1, 0)]
    whole = run("log", "check", folder)
    assert whole.exit_code == 0
    assert all(path.name in "".join(whole.stdout.split()) for path in paths)
    paths[0].write_bytes(paths[0].read_bytes()[:-60])
    told = run("log", "check", folder, "--json")
    assert told.exit_code == 1
    assert [Path(f["path"]).name for f in json.loads(told.stdout)["files"] if not f["whole"]] == [
        paths[0].name
    ]

"""`report`: one page of one run or several."""

from pathlib import Path

from meal_bayes.learner.api import ask
from meal_bayes.trial_log import write_trials


def test_one_page_of_several_logs(run, fails):
    for agent in ("greedy", "predefined"):
        trial = ask("heavy", dataset="roc36", object="heavy_blue_beans", agent=agent)
        write_trials(f"{agent}.mcap", [trial], header={"seed": 0})
    told = run("report", "greedy.mcap", "predefined.mcap", "-o", "out/page.html")
    assert told.exit_code == 0
    assert told.stdout.startswith("out/page.html: 2 trials of 2 agents, ")
    text = Path("out/page.html").read_text()
    assert "greedy" in text
    assert "predefined" in text
    assert run("report", "greedy.mcap").stdout.startswith("report.html: 1 trial of 1 agent,")
    assert "no log none.mcap" in fails("report", "none.mcap")
    assert "Missing argument" in fails("report")


def test_a_torn_log_is_warned_of(run):
    objects = ("heavy_blue_beans", "light_blue_rice", "medium_green_glass")
    trials = [ask("heavy", dataset="roc36", object=o, agent="greedy") for o in objects]
    write_trials("a.mcap", trials, header={"seed": 0})
    data = Path("a.mcap").read_bytes()
    Path("a.mcap").write_bytes(data[: int(len(data) * 0.6)])
    told = run("report", "a.mcap")
    assert told.exit_code == 0
    assert "warning: a.mcap: " in told.stderr
    assert "Warning" in Path("report.html").read_text()

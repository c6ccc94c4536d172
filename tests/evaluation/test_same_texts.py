"""Terminal, page, notebook and viewer tell the measures of an agent by the same texts."""

import dataclasses
import math
import re
from pathlib import Path

import numpy as np
import pytest

from meal_bayes import display
from meal_bayes.cli.run import _print_summary
from meal_bayes.evaluation import compare, summarize
from meal_bayes.evaluation.report import write_report
from meal_bayes.evaluation.summary import accuracy_text, reward_text
from meal_bayes.evaluation.worst import shown_rows, verdict_of, worst_first
from meal_bayes.learner.api import ask
from meal_bayes.trial_log import Group, Logs, write_trials
from meal_bayes.trials import Search, TrialOutcomes
from meal_bayes.trials.search import search_facts
from meal_bayes.trials.strip import _moments
from meal_bayes.trials.text import (
    RIGHT,
    UNKNOWN,
    WRONG,
    came_to_nothing,
    final_facts,
    outcome_text,
    trial_reward_text,
    verdict_text,
)
from meal_bayes.viewer.labels import narrate
from meal_bayes.viewer.recorder import Clock, Time
from meal_bayes.viewer.run_view import TABLE, RunView

OBJECTS = ("heavy_blue_beans", "light_blue_rice", "medium_green_glass", "light_brown_screws")
AGENTS = ("greedy", "morc")


class Texts:
    """In place of the recorder of rows: the last text of each entity."""

    def __init__(self):
        self.of = {}

    def add_static(self, entity, archetype):
        if hasattr(archetype, "text"):
            (self.of[entity],) = archetype.text.as_arrow_array().to_pylist()

    def add(self, *_, **fields):
        """Plots have no texts."""


@pytest.fixture(scope="module")
def trials():
    return [
        ask("heavy, beans", dataset="roc36", object=name, agent=agent, logs=None)
        for agent in AGENTS
        for name in OBJECTS
    ]


@pytest.fixture(scope="module")
def surfaces(trials, tmp_path_factory):
    """What each of them shows of the same trials, as text."""
    folder = tmp_path_factory.mktemp("run")
    write_trials(folder / "a.mcap", trials, header={"config": {"dataset": "roc36"}})
    write_report(Logs(folder), folder / "report.html")
    outcomes = TrialOutcomes.of(trials)
    texts = Texts()
    view = RunView(texts, {})
    view.add(outcomes, [Time(n, n, 0.0) for n in range(len(outcomes))])
    view.flush()
    return {
        "evaluation/sections.py": (folder / "report.html").read_text(),
        "evaluation/summary.py": repr(summarize(trials)),
        "viewer/run_view.py": texts.of[TABLE],
    }


def test_accuracy_and_its_interval_are_told_alike(trials, surfaces, capsys):
    rows = summarize(trials)
    _print_summary(rows, [])
    for place, text in {"cli/run.py": capsys.readouterr().out, **surfaces}.items():
        for row in rows:
            assert accuracy_text(row) in text, f"{place} has a form of its own; use accuracy_text"


def test_reward_and_its_error_are_told_alike(trials, surfaces, capsys):
    rows = summarize(trials)
    _print_summary(rows, [])
    told = {"cli/run.py": capsys.readouterr().out, **surfaces}
    for place in told.keys() - {"viewer/run_view.py"}:  # it shows the error of the cost
        text = told[place]
        for row in rows:
            assert reward_text(row) in text, f"{place} has a form of its own; use reward_text"


def test_differences_are_told_alike(trials, surfaces):
    page = surfaces["evaluation/sections.py"]
    less = compare(trials, *AGENTS).text(signed=True)
    assert re.search(r"[+-][\d.]+ \[[+-][\d.]+, [+-][\d.]+\]", less)
    assert less in page
    best, other = sorted(
        AGENTS, key=lambda name: -TrialOutcomes.of(trials).of_agent(name).reward.mean()
    )
    assert f"{other} ({compare(trials, other, best).text(signed=True)})" in page


def test_legends_name_the_error_that_is_shown(trials, surfaces, capsys):
    _print_summary(summarize(trials), [])
    assert display.ERROR_TEXT in capsys.readouterr().out.replace("\n", " ")
    assert display.ERROR_TEXT in surfaces["evaluation/sections.py"]


def test_page_and_viewer_rank_the_worst_trials_alike(trials, surfaces):
    outcomes = TrialOutcomes.of(trials)
    order = worst_first(outcomes)
    shown = re.findall(r"^\|(\d+)\|", surfaces["viewer/run_view.py"], re.MULTILINE)
    assert list(map(int, shown)) == order.tolist()
    rewards = outcomes.reward[order].tolist()
    assert rewards == sorted(rewards)
    page = surfaces["evaluation/sections.py"].partition("The worst trials")[2]
    for agent in AGENTS:
        first = next(row for row in order.tolist() if outcomes.agent[row] == agent)
        told = re.search(rf"heavy, beans\? (\w+), {agent}:", page)
        assert told[1] == outcomes.object_name[first]


@pytest.mark.parametrize(("success", "word"), [(True, RIGHT), (False, WRONG), (None, UNKNOWN)])
def test_a_verdict_is_one_word_everywhere(trials, success, word):
    trial = trials[0]
    truth = {True: trial.report, False: ~trial.report, None: np.full(2, -1)}[success]
    judged = trial.with_truth(np.asarray(truth, np.int8))
    assert judged.success is success
    (outcomes,) = shown_rows(Group({}, Path("a.mcap"), [0], TrialOutcomes.of([judged]), ()), [0])
    told = {
        "Trial": repr(judged),
        "the picture": verdict_text(judged),
        "the report": verdict_of(outcomes) or UNKNOWN,
        "the terminal": final_facts(judged).get("verdict", UNKNOWN),
    }
    viewer = narrate(list(Clock().frames(0, judged))[-1]).lower()
    if success is not None:
        told["the viewer"] = viewer
    else:  # it says nothing of what is not known
        assert not {RIGHT, WRONG} & set(re.findall(r"\w+", viewer))
    for surface, text in told.items():
        assert word in text, f"{surface} has a word of its own; use trials.text.verdict_word"


def test_what_is_broken_off_has_no_verdict(trials, tmp_path):
    """Whether its truth is known plays no part."""
    trial = dataclasses.replace(trials[0], report=None, ended="robot error")
    name = trial.task.object_name
    search = Search("heavy", {name: trial}, (name,), claim=None, ended="robot error")
    assert search_facts(search)["verdict"] == "none"
    write_trials(tmp_path / "a.mcap", [trial], header={})
    write_report(Logs(tmp_path), tmp_path / "report.html")
    page = (tmp_path / "report.html").read_text()
    assert "<b>none</b><span>verdict</span>" in page


@pytest.mark.parametrize(("reward", "text"), [(483.24, "483.2"), (math.nan, "unknown")])
def test_a_trial_s_reward_is_one_text_everywhere(trials, tmp_path, reward, text):
    assert trial_reward_text(reward) == text
    truth = trials[0].report if reward > 0 else np.full(2, -1)
    trial = trials[0].with_truth(np.asarray(truth, np.int8))
    text = trial_reward_text(trial.reward)
    write_trials(tmp_path / "a.mcap", [trial], header={})
    write_report(Logs(tmp_path), tmp_path / "report.html")
    assert f"<b>{text}</b><span>reward</span>" in (tmp_path / "report.html").read_text()
    assert f"reward {text}" in repr(trial)
    assert f"reward {text}" in final_facts(trial)["cost"]


def test_a_failed_behavior_is_said_and_drawn_as_one(trials):
    """The picture hatches what the terminal calls failed, and nothing else."""
    for trial in trials:
        executed = trial.steps[: -1 if trial.report is not None else None]
        for step, moment in zip(executed, _moments(trial), strict=True):
            succeeded = outcome_text(trial.momdp, step).startswith("succeeded")
            assert moment.failed is not succeeded
            assert came_to_nothing(trial.momdp, step) is moment.failed


def test_seconds_and_rewards_have_one_format():
    """`display.AMOUNT`; beside it are hours, megabytes and percentages."""
    package = Path(display.__file__).parent
    others = re.compile(r"\bhours\b|_hours|\bMB\b|%|'.1f'")
    own = {
        f"{path.relative_to(package)}: {line.strip()}"
        for path in package.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.search(r":[+\d]*\.1f\}", line) and not others.search(line)
    }
    assert own == set(), "a format of its own; write it by display.AMOUNT"

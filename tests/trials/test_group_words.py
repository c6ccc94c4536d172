"""A group reads as one question, wherever a person reads it."""

import io

import numpy as np
import pytest
from rich.console import Console

from meal_bayes import Learner, load_percepts
from meal_bayes.cli.narration import print_trial, trial_json
from meal_bayes.evaluation.report import write_report
from meal_bayes.trial_log import Logs, read_trials, write_trials
from meal_bayes.trials import TrialOutcomes, percept_labels, trials_frame
from meal_bayes.trials.text import final_facts, outcome_facts


@pytest.fixture(scope="module")
def trial(tmp_path_factory):
    learner = Learner("roc36", logs=None).fit(load_percepts("roc36"))
    trial = learner.ask("What color is it, and is it heavy?", "heavy_blue_beans")
    path = tmp_path_factory.mktemp("words") / "trial.mcap"
    write_trials(path, [trial], header={})
    (logged,) = read_trials(path)
    return logged


def test_what_is_asked_is_named(trial):
    assert trial.task.query.text == "color, heavy?"
    assert "with heavy_blue_beans: color, heavy?" in repr(trial)
    assert "color: blue 99." in repr(trial)
    assert "Pr(color: brown)" in trial._repr_html_()
    assert "MOMDP of color, heavy" in repr(trial.momdp)
    assert trials_frame([trial]).loc[0, "query"] == "color, heavy"
    assert final_facts(trial)["answer"] == "blue, heavy"
    facts = outcome_facts(TrialOutcomes.of([trial]), 0)
    assert (facts["question"], facts["answer"], facts["truth"]) == (
        "color, heavy?", "blue, heavy", "blue, heavy",
    )  # fmt: skip


def test_a_terminal_and_json_say_the_value(trial):
    console = Console(file=io.StringIO(), width=100)
    print_trial(console, trial)
    text = console.file.getvalue()
    assert "color: surely blue" in text
    assert "brown: no" not in text
    values = trial_json(trial)
    assert values["report"] == values["truth"] == {"color": "blue", "heavy": True}
    assert set(values["belief"]["color"]) == {"brown", "green", "blue"}


@pytest.mark.parametrize(
    ("levels", "words"),
    [([0, 0, 3, 0], "surely blue"), ([0, 1, 2, 0], "blue"), ([3, 0, 3, 0], "surely brown or blue"),
     ([0, 1, 0, 0], "surely not brown or blue"), ([0, 0, 0, 0], "none of them")],
)  # fmt: skip
def test_the_percept_of_a_group_is_the_value_that_it_speaks_for(trial, levels, words):
    momdp = trial.momdp
    look = momdp.behavior_names.index("look")
    assert momdp.levels == 4
    assert percept_labels(momdp, look, np.array(levels, np.int8))[0] == words


def test_a_report_and_a_picture_show_groups_and_yes_or_no(trial, tmp_path):
    learner = Learner("roc36", agent="olfc", logs=None).fit(load_percepts("roc36"))
    asked = learner.ask("blue or green", "heavy_blue_beans", answer="yes or no")
    write_trials(tmp_path / "two.mcap", [trial, asked], header={})
    write_report(Logs(tmp_path / "two.mcap"), tmp_path / "page.html")
    page = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "color: blue" in page
    assert "green or blue" in page

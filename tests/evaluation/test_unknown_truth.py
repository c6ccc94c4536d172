"""What is not known is shown as such: in reports, in pictures, in words."""

import dataclasses

import matplotlib.pyplot as plt
import numpy as np
import pytest

from meal_bayes.evaluation import summarize
from meal_bayes.evaluation.plots import belief_trace
from meal_bayes.evaluation.report import write_report
from meal_bayes.learner.api import ask
from meal_bayes.trial_log import Logs, write_trials
from meal_bayes.trials import truth_text, verdict_text
from meal_bayes.viewer.labels import log_line, narrate
from meal_bayes.viewer.recorder import Clock


@pytest.fixture(scope="module")
def trials():
    """Four trials: of two the truth is known, of one in part, one was broken off."""
    names = ("heavy_blue_beans", "light_blue_rice", "medium_green_glass", "heavy_green_rice")
    made = [ask("heavy, blue", dataset="roc36", object=name, agent="greedy") for name in names]
    nan = dataclasses.replace(made[2].steps[-1], reward=float("nan"))
    partly = (*made[2].steps[:-1], nan)
    made[2] = dataclasses.replace(made[2], truth=np.array([0, -1]), steps=partly)
    made[3] = dataclasses.replace(
        made[3], report=None, steps=made[3].steps[:2], ended="robot error: hot"
    )
    return made


def test_words(trials):
    assert [verdict_text(trial) for trial in trials[2:]] == ["truth unknown", "broken off"]
    assert truth_text(trials[2].task.query.attributes, trials[2].truth) == "not heavy, unknown"
    assert truth_text(trials[0].task.query.attributes, trials[0].truth) == "heavy, blue"
    assert trials[2].success is trials[3].success is None


def test_summaries_leave_it_out(trials):
    (row,), (known,) = summarize(trials), summarize(trials[:2])
    assert (row.trials, row.judged) == (4, 2)
    for name in ("accuracy", "accuracy_se", "reward", "answered_accuracy"):
        assert getattr(row, name) == getattr(known, name)


@pytest.mark.parametrize("chosen", [slice(None), slice(2, None)])
def test_a_report_is_made_of_it(trials, tmp_path, chosen):
    log, page = tmp_path / "a.mcap", tmp_path / "a.html"
    write_trials(log, trials[chosen], header={})
    write_report(Logs(log), page)
    assert ">nan" not in page.read_text(encoding="utf-8")


def test_circles_stand_where_the_truth_is_known(trials):
    for trial, known in ((trials[0], 2), (trials[2], 1)):
        axes = belief_trace(trial)
        ends = [line.get_ydata()[0] for line in axes.lines if line.get_marker() == "o"
                and len(line.get_ydata()) == 1]  # fmt: skip
        assert np.isfinite(ends).sum() == known
        plt.close("all")


def test_the_viewer_says_so(trials):
    for trial, words, line in (
        (trials[2], "truth: not heavy, unknown", "truth unknown"),
        (trials[3], "robot error: hot", None),
    ):
        last = list(Clock().frames(0, trial))[-1]
        assert words in narrate(last)
        assert "WRONG" not in narrate(last)
        if line is not None:
            assert line in log_line(last)

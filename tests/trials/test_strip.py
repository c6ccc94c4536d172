"""The picture of a trial says what it did, what it believed, and why it stopped."""

from dataclasses import replace
from importlib.metadata import version
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.text import Text

import meal_bayes
from meal_bayes import canvas
from meal_bayes.display import percent
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.learner.api import ask
from meal_bayes.palette import attribute_color
from meal_bayes.trial_log import read_trials

ROOT = Path(__file__).resolve().parents[2]
PICTURES = {  # of README and site: dark, narrow
    "trial.svg": (False, False),
    "trial-dark.svg": (True, False),
    "trial-narrow.svg": (False, True),
    "trial-narrow-dark.svg": (True, True),
}
SHOWN = {"trial.svg": 838, "trial-narrow.svg": 368}  # pixels of a column


@pytest.fixture(scope="module")
def sample():
    return next(iter(read_trials(ROOT / "logs" / "sample.mcap")))


def texts(axes):
    """Return what is written anywhere in a figure."""
    written = axes.figure.findobj(Text)
    return [text.get_text() for text in written if text.get_visible() and text.get_text()]


@pytest.mark.parametrize("name", PICTURES)
def test_the_committed_pictures_are_of_the_sample_log(name, sample):
    dark, narrow = PICTURES[name]
    drawn = canvas.render(sample.plot(dark=dark, narrow=narrow), "svg")
    pinned = dict(line.split("==") for line in (ROOT / "constraints.txt").read_text().split("\n")
                  if "==" in line)["matplotlib"]  # fmt: skip
    if version("matplotlib") == pinned:  # others may draw letters otherwise
        assert drawn == (ROOT / "docs" / "assets" / name).read_bytes()
    assert len(drawn) < 300_000


def test_it_says_the_question_the_answer_and_why_it_stopped(sample):
    words = texts(sample.plot())
    assert "Is it heavy, and does it hold beans?" in words
    assert f"answer after {sample.cost:.1f} s: heavy, beans (right)" in words
    for name in ("look", "grasp", "lift\nslow", "hold", "high\nvelocity\nshake", "answers"):
        assert name in words
    for belief in (sample.first_belief, sample.last_belief):
        for name, value in zip(("heavy", "beans"), belief.positive.tolist(), strict=True):
            assert f"{name} {percent(value)}" in words
    worth = []
    for step in sample.steps:
        values = step.decision.values
        worth.append(float(np.nanmax(values[:-1]) - values[-1]))
    numbers = [f"{value:+.0f}" for value in worth[:-1]]
    assert [word for word in words if word.startswith("+")] == numbers
    assert f"\N{MINUS SIGN}{-worth[-1]:.0f}: stop" in words
    assert all(value > 0 for value in worth[:-1])
    assert worth[-1] < 0
    assert not any("says nothing" in word for word in words)


def test_words_are_written_where_a_belief_bends(sample):
    words = [text for text in texts(sample.plot()) if text in ("yes", "no", "surely yes")]
    assert sorted(words) == ["no", "surely yes", "surely yes", "yes"]  # of ten percepts


@pytest.mark.parametrize("name", SHOWN)
def test_letters_are_large_enough_where_it_is_shown(name, sample):
    axes = sample.plot(narrow="narrow" in name)
    scale = SHOWN[name] / (axes.figure.get_figwidth() * 72)  # pixels a point
    sizes = {text.get_text(): text.get_fontsize() * scale for text in axes.figure.findobj(Text)
             if text.get_text() and text.get_visible()}  # fmt: skip
    assert min(sizes.values()) >= 11, min(sizes, key=sizes.get)


def test_a_color_is_an_attribute_s_and_lighter_on_dark(sample):
    for dark in (False, True):
        lines = sample.plot(dark=dark).lines
        colors = {line.get_color() for line in lines if line.get_drawstyle() == "steps-post"}
        same = {attribute_color(0), attribute_color(1)}
        assert (colors == same) == (not dark)


def test_what_failed_is_hatched_and_a_rule_compares_nothing(sample):
    first = replace(sample.steps[0], observation=None)
    axes = replace(sample, steps=(first, *sample.steps[1:])).plot()
    blocks = axes.figure.axes[0]
    assert [bool(patch.get_hatch()) for patch in blocks.patches] == [True, *[False] * 5]
    trial = ask("heavy", dataset="roc36", object="heavy_blue_beans", agent="predefined", logs=None)
    assert "this agent follows a rule and compares nothing" in texts(plots.trial_strip(trial))


@pytest.mark.parametrize("agent", ["random", "random_legal", "greedy", "olfc", "predefined_plus"])
@pytest.mark.parametrize("question", ["red", "red, plastic, full, soft, container, glass, metal"])
def test_any_trial_is_drawn(agent, question, tmp_path):
    known = meal_bayes.load_percepts("ispy32").domain.attributes
    asked = [name for name in known if name in question.split(", ")] or known[:7]
    names = meal_bayes.load_percepts("ispy32").objects
    trial = ask(asked, dataset="ispy32", object=names[0], agent=agent, logs=None)
    for shown in (
        trial,
        replace(trial, report=None),
        replace(trial, report=None, ended="robot error: hot", steps=trial.steps[:1]),
        replace(trial, report=None, ended="robot error: hot", steps=()),
        replace(trial, truth=np.full(len(trial.truth), -1)),
    ):
        for narrow in (False, True):
            axes = plots.trial_strip(shown, narrow=narrow)
            assert "nan" not in " ".join(texts(axes))
            assert canvas.render(axes, "svg").startswith(b"<?xml")
        assert "<picture>" in shown._repr_html_() or not shown.steps
    plt.close("all")


@pytest.mark.parametrize("question", ["heavy and not blue", "heavy or blue"])
def test_a_question_of_yes_or_no_has_a_line_of_its_own(question):
    learner = meal_bayes.Learner("roc36", agent="olfc", logs=None)
    learner.fit(meal_bayes.load_percepts("roc36"))
    trial = learner.ask(question, "heavy_blue_beans", answer="yes or no")
    axes = trial.plot()
    lines = [line for line in axes.lines if line.get_drawstyle() == "steps-post"]
    heavy, blue = (lines[place].get_ydata() for place in (0, 1))
    expected = heavy * (1 - blue) if "and" in question else 1 - (1 - heavy) * (1 - blue)
    np.testing.assert_allclose(lines[2].get_ydata(), expected, atol=1e-12)
    assert len(lines) == 3
    words = texts(axes)
    for p in (expected[0], trial.probability):
        assert f"yes {percent(p)}" in words
    table = trial._repr_html_().partition("<table")[2]
    assert table.index("Pr(yes)") < table.index("Pr(heavy)")
    plt.close("all")


def test_a_picture_of_another_kind_is_refused(sample, tmp_path):
    with pytest.raises(SettingsError, match=r"ends in \.png, \.pdf or \.svg"):
        canvas.save(sample.plot(), tmp_path / "a.gif")

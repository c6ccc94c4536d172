"""The picture of a trial says what it did, what it believed, and why it stopped."""

from dataclasses import replace
from importlib.metadata import version
from itertools import combinations, pairwise
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text

import meal_bayes
from meal_bayes import look
from meal_bayes.domain import load_domain, read_query
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.learner import ask
from meal_bayes.look import attribute_color, percent
from meal_bayes.momdp import Transition, build_momdp, initial_belief, update_belief
from meal_bayes.planners import Decision
from meal_bayes.trial_log import read_trials
from meal_bayes.trials import Step, Task, Trial
from meal_bayes.trials.record import answer_step

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
    drawn = look.render(sample.plot(dark=dark, narrow=narrow), "svg")
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
            assert name in words
            assert percent(value) in words
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
        bands = sample.plot(dark=dark).figure.axes
        lines = [line for ax in bands for line in ax.lines]
        colors = {line.get_color() for line in lines if line.get_drawstyle() == "steps-post"}
        same = {attribute_color(0), attribute_color(1)}
        assert (colors == same) == (not dark)


def test_what_failed_is_hatched_and_a_rule_compares_nothing(sample):
    first = replace(sample.steps[0], observation=None)
    axes = replace(sample, steps=(first, *sample.steps[1:])).plot()
    blocks = axes.figure.axes[0]
    assert [bool(patch.get_hatch()) for patch in blocks.patches] == [True, *[False] * 5]
    trial = ask("heavy", dataset="roc36", object="heavy_blue_beans", agent="predefined", logs=None)
    assert "this agent follows a rule and compares nothing" in texts(plots.trial_picture(trial))


@pytest.mark.parametrize("bonus", [False, True])
@pytest.mark.parametrize("value", [np.inf, -np.inf, np.nan, 1e300, -1e300])
@pytest.mark.parametrize("every", [False, True])
def test_values_of_a_planner_that_no_axis_holds_are_left_out(value, every, bonus, sample):
    """A planner of the user's may return infinite values, as of what is not legal."""
    steps = list(sample.steps)
    for number in range(len(steps) if every else 1):
        decision = steps[number].decision
        values = np.full(len(decision.values), value)
        values[-1] = 1.0
        paid = np.where(np.arange(len(values)) == 0, value, 0.0) if bonus else None
        with np.errstate(invalid="ignore"):
            steps[number] = replace(
                steps[number], decision=replace(decision, values=values, bonus=paid)
            )
    with np.errstate(invalid="ignore"):
        assert "nan" not in "".join(texts(replace(sample, steps=tuple(steps)).plot())).lower()


@pytest.mark.quick(1)
@pytest.mark.parametrize("agent", ["random", "random_legal", "greedy", "olfc", "predefined_plus"])
@pytest.mark.parametrize("question", ["red", "red, plastic, full, soft, container, glass, metal"])
def test_any_trial_is_drawn(agent, question):
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
            axes = plots.trial_picture(shown, narrow=narrow)
            assert "nan" not in " ".join(texts(axes))
            assert look.render(axes, "svg").startswith(b"<?xml")
        assert "<picture>" in shown._repr_html_() or not shown.steps
    plt.close("all")


@pytest.mark.quick(1)
@pytest.mark.parametrize("question", ["heavy and not blue", "heavy or blue"])
def test_a_question_of_yes_or_no_has_a_line_of_its_own(question):
    learner = meal_bayes.Learner("roc36", agent="olfc", logs=None)
    learner.fit(meal_bayes.load_percepts("roc36"))
    trial = learner.ask(question, "heavy_blue_beans", answer="yes or no")
    axes = trial.plot()
    lines = [
        line for ax in axes.figure.axes for line in ax.lines if line.get_drawstyle() == "steps-post"
    ]
    answer, heavy, blue = (line.get_ydata() for line in lines)
    expected = heavy * (1 - blue) if "and" in question else 1 - (1 - heavy) * (1 - blue)
    np.testing.assert_allclose(answer, expected, atol=1e-12)
    words = texts(axes)
    for p in (expected[0], trial.probability):
        assert percent(p) in words
    assert "yes" in words
    table = trial._repr_html_().partition("<table")[2]
    assert table.index("Pr(yes)") < table.index("Pr(heavy)")
    plt.close("all")


def drawn_trial(seed, attributes, group, length):
    """Return a trial of a made-up robot whose names have a length, with drawn percepts."""
    rng = np.random.default_rng(seed)
    letters = list("abcdefghijklmnopqrstuvwxyz") + ["_", "-"] * 2

    def name(start):
        size = int(rng.integers(3, length + 1))
        return start + "".join(rng.choice(letters, size - 2)) + "x"

    names = [name(chr(97 + i)) for i in range(attributes)]
    behaviors = [name(chr(65 + i)) for i in range(6)]
    costs = rng.choice([0.3, 2.0, 20.0], 6)
    domain = load_domain(
        {
            "name": "drawn",
            "attributes": names,
            "groups": {name("G"): names[:group]} if group else {},
            "report_reward": 100.0,
            "behaviors": [
                {"name": behavior, "cost": float(cost), "modalities": ["touch"]}
                for behavior, cost in zip(behaviors, costs, strict=True)
            ],
            "diagram": {
                "states": ["here"],
                "start": "here",
                "effects": [{"from": "here", "do": name, "to": "here"} for name in behaviors],
            },
        }
    )
    query = read_query(names, domain)
    likely = rng.dirichlet(np.ones(4), (attributes, 6, 2))
    momdp = build_momdp(domain, query, likely)
    belief = first = initial_belief(momdp)
    steps = []
    for _ in range(int(rng.integers(1, 14))):
        action = int(rng.integers(6))
        percept = rng.integers(0, 4, attributes).astype(np.int8) if rng.random() < 0.9 else None
        after = update_belief(belief, momdp, Transition(action, belief.x, percept))
        values = rng.normal(50, 100, 7)
        bonus = rng.exponential(9, 7) if seed % 2 else None
        decision = Decision(action, values, np.zeros(7), np.zeros(7, np.int64), bonus=bonus)
        cost = float(costs[action])
        steps.append(Step(belief.x, decision, after.x, percept, cost, -cost, after))
        belief = after
    end = Decision(6, rng.normal(0, 50, 7), np.zeros(7), np.zeros(7, np.int64), momdp=momdp)
    truth = query.values[int(rng.integers(len(query.values)))].astype(np.int8)
    steps.append(answer_step(momdp, belief, end, truth))
    task = Task(query.text, query, -1, "cup", ("drawn", seed))
    report = momdp.reported(6)
    return Trial(task, "drawn", momdp, first, tuple(steps), truth, report)


def boxes(axes):
    """Return text and rectangle (pixels) of everything that is written in a figure."""
    FigureCanvasAgg(axes.figure).draw()
    shown = [text for text in axes.figure.findobj(Text) if text.get_visible() and text.get_text()]
    hidden = {
        text
        for ax in axes.figure.axes
        for axis in (ax.xaxis, ax.yaxis)
        if not axis.get_visible() or axis is ax.yaxis
        for text in axis.findobj(Text)
    }
    for ax in axes.figure.axes:  # matplotlib keeps ticks beyond the ends, which it does not draw
        low, high = ax.get_xlim()
        ticks = ax.xaxis.get_major_ticks()
        hidden |= {tick.label1 for tick in ticks if not low <= tick.get_loc() <= high}
    return [(t, t.get_window_extent()) for t in shown if t not in hidden]


@pytest.mark.quick(1)
@pytest.mark.parametrize("narrow", [False, True])
@pytest.mark.parametrize("attributes", [1, 2, 4, 7, 12])
def test_no_text_is_cut_or_on_another_one_or_on_a_belief(attributes, narrow):
    for seed in range(4):
        group = (0, 3)[seed % 2] if attributes > 3 else 0
        trial = drawn_trial(100 * attributes + seed, attributes, group, (3, 12, 25, 40)[seed])
        axes = trial.plot(narrow=narrow)
        written = boxes(axes)
        width, height = axes.figure.canvas.get_width_height()
        for text, box in written:
            assert box.x0 >= 0, text
            assert box.x1 <= width, text
            assert box.y0 >= 0, text
            assert box.y1 <= height, text
        for (text, box), (other, its) in combinations(written, 2):
            overlap = (
                min(box.x1, its.x1) - max(box.x0, its.x0),
                min(box.y1, its.y1) - max(box.y0, its.y0),
            )
            assert min(overlap) <= 1.0, (text, other)
        for ax in axes.figure.axes[1:-1]:
            for line in ax.lines:
                if line.get_drawstyle() == "steps-post":
                    check_apart(line, [(t, box) for t, box in written if t.axes is ax])


def check_apart(line, written):
    """Fail where a text of a band lies on a belief."""
    corners = line.get_xydata()
    path = np.repeat(corners, 2, axis=0)[:-1]
    path[1::2, 0] = corners[1:, 0]  # steps: first along, then up
    path = line.axes.transData.transform(path)
    for (x0, y0), (x1, y1) in pairwise(path):
        for text, box in written:
            crosses = min(x0, x1) < box.x1 - 0.5 and max(x0, x1) > box.x0 + 0.5
            crosses &= min(y0, y1) < box.y1 - 0.5 and max(y0, y1) > box.y0 + 0.5
            assert not crosses, text


def test_a_picture_of_another_kind_is_refused(sample, tmp_path):
    with pytest.raises(SettingsError, match=r"ends in \.png, \.pdf or \.svg"):
        look.save(sample.plot(), tmp_path / "a.gif")

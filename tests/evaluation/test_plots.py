"""Figures: what is drawn is what was given, in colors and words that everybody can read."""

import matplotlib as mpl
import numpy as np
import pytest

from meal_bayes import look
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.plots import Series, forest, predictive
from meal_bayes.evaluation.statistics import Interval, wilson_interval
from meal_bayes.learner import ask
from meal_bayes.look import agent_style, save

X = np.arange(4.0)
TWO = [Series("a", X, X / 4, X / 4 - 0.1, X / 4 + 0.1), Series("b", X, 1 - X / 4)]


@pytest.fixture(scope="module")
def trial():
    return ask(
        "heavy, beans",
        dataset="roc36",
        object="heavy_blue_beans",
        agent="predefined_plus",
        logs=None,
    )


def every_figure(trial):
    half = Interval(0.5, 0.1, 0.3, 0.7)
    positive = np.linspace(0, 1, 60)
    yield plots.lines(TWO, x_label="cost, s", y_label="accuracy")
    yield plots.learning_curve(TWO)
    yield plots.reliability_diagram(positive, positive > 0.5)
    yield plots.trial_picture(trial)
    yield plots.cost_distribution({"a": [1.0, 5.0, 5.0], "b": [2.0]})
    yield plots.accuracy_and_cost({"a": (half, Interval(4.0, 1.0, 2.0, 6.0)), "b": (half, half)})


@pytest.mark.parametrize(
    ("ending", "magic"),
    [(".png", b"\x89PNG"), pytest.param(".pdf", b"%PDF", marks=pytest.mark.long)],
)
def test_every_figure_is_labelled_and_written(trial, tmp_path, ending, magic):
    before = dict(mpl.rcParams)
    for number, ax in enumerate(every_figure(trial)):
        axes = ax.figure.axes
        assert any(each.get_xlabel() or each.get_ylabel() for each in axes)
        path = look.save(ax, tmp_path / "figures" / f"{number}{ending}")
        assert path.read_bytes().startswith(magic)
        assert path.stat().st_size > 2000
    assert dict(mpl.rcParams) == before


def test_lines_and_bands_are_the_numbers():
    ax = plots.lines(TWO, x_label="x", y_label="y")
    for line, series in zip(ax.lines, TWO, strict=True):
        np.testing.assert_array_equal(line.get_xydata(), np.stack([series.x, series.y], axis=1))
        assert line.get_label() == series.name
    (band,) = ax.collections  # b has none
    corners = {tuple(corner) for corner in band.get_paths()[0].vertices.round(9)}
    assert {*zip(X, TWO[0].low, strict=True), *zip(X, TWO[0].high, strict=True)} <= corners
    assert ax.get_legend() is not None


def test_the_reliability_diagram_counts():
    positive = np.array([0.05] * 10 + [0.95] * 20)
    truth = np.array([True] + [False] * 9 + [True] * 15 + [False] * 5)
    ax = plots.reliability_diagram(positive, truth)
    points = next(line for line in ax.lines if line.get_marker() == "o").get_xydata()
    assert np.allclose(points, [(0.05, 0.1), (0.95, 0.75)])
    columns = [patch.get_height() for patch in ax.patches]
    assert columns == pytest.approx([1 / 3, *[0] * 8, 2 / 3])
    (ends,) = [c.get_segments() for c in ax.collections]
    assert np.allclose(ends[0][:, 1], wilson_interval(1, 10)[2:])


def test_the_lines_of_a_trial_are_its_beliefs(trial):
    ax = plots.trial_picture(trial)
    done = [step for step in trial.steps if step.decision.action < trial.momdp.n_behaviors]
    beliefs = [trial.first_belief, *(step.belief for step in done)]
    lines = [line for band in ax.figure.axes for line in band.lines]
    drawn = [line for line in lines if line.get_drawstyle() == "steps-post"]
    expected = np.array([belief.positive for belief in beliefs]).T
    np.testing.assert_allclose([line.get_ydata() for line in drawn], expected)
    seconds = np.cumsum([0.0, *(step.cost for step in done)])
    np.testing.assert_allclose([line.get_xdata() for line in drawn], [seconds] * 2)


AGENTS = ("bayes", "morc", "random", "bayes_memory", "somebody")


def colors_of(ax):
    """Return the color of each agent in the legend of a figure."""
    handles, labels = ax.get_legend_handles_labels()
    colors = {}
    for label, handle in zip(labels, handles, strict=True):
        line = handle.lines[0] if hasattr(handle, "lines") else handle
        if hasattr(line, "get_color"):
            colors[label] = line.get_color()
    return colors


def drawn_by(names):
    """Yield every figure that has a color an agent."""
    half = Interval(0.5, 0.1, 0.3, 0.7)
    series = [Series(name, X, X / 4) for name in names]
    yield plots.lines(series, x_label="x", y_label="y")
    yield plots.learning_curve(series)
    yield plots.cost_distribution({name: [1.0, 2.0] for name in names})
    yield plots.accuracy_and_cost(dict.fromkeys(names, (half, half)))


def test_a_color_is_an_agent_s_whatever_else_is_drawn_and_in_which_order():
    alone = {name: agent_style(name).color for name in AGENTS}
    assert len({alone[name] for name in AGENTS}) == len(AGENTS)
    for names in (AGENTS, AGENTS[::-1], AGENTS[1:], ("bayes", "somebody")):
        for ax in drawn_by(names):
            assert colors_of(ax) == {name: alone[name] for name in names}
    small = plots.reliability_diagram([0.1, 0.9], [False, True], agent="morc")
    assert colors_of(small)["true"] == agent_style("morc").color


@pytest.mark.parametrize(("largest", "scale"), [(9.0, "linear"), (90.0, "symlog")])
def test_one_point_an_agent_on_the_plane_of_accuracy_and_cost(largest, scale):
    nan = float("nan")
    costs = {"bayes": 0.0, "morc": 5.0, "bayes_memory": largest}
    accuracy = Interval(0.5, 0.1, 0.3, 0.6)
    points = {name: (accuracy, Interval(x, nan, nan, nan)) for name, x in costs.items()}
    ax = plots.accuracy_and_cost(points)
    markers = [line.get_xydata() for line in ax.lines if line.get_marker() in "os^"]
    drawn = [xy[0] for xy in markers if len(xy)]  # without those of the legend
    np.testing.assert_allclose(drawn, [(x, 0.5) for x in costs.values()])
    ends = [c.get_segments()[0] for c in ax.collections]
    np.testing.assert_allclose(ends[1], [(0, 0.3), (0, 0.6)])
    np.testing.assert_allclose(ends[0], [(0, 0.5), (0, 0.5)])  # unknown: no interval
    assert ax.get_xscale() == scale
    ax = plots.cost_distribution({k: [x] for k, x in costs.items()} | {"d": [1.0, 5.0, 5.0, 9.0]})
    assert ax.get_xscale() == scale
    fractions = dict(zip(*ax.lines[-1].get_data(), strict=True))
    assert (fractions[1.0], fractions[5.0]) == pytest.approx((0.25, 0.75))


def test_names_with_signs_of_mathematics_are_names(tmp_path):
    series = [Series("$x^2$ & <b>", X, X), Series("\\frac{", X, X)]
    ax = plots.lines(series, x_label="$", y_label="a_b$c")
    assert look.save(ax, tmp_path / "a.png").is_file()


def test_what_does_not_fit_is_refused(tmp_path):
    with pytest.raises(SettingsError, match="one truth for each"):
        plots.reliability_diagram([0.5], [True, False])
    with pytest.raises(SettingsError, match=r"\.png, \.pdf or \.svg"):
        look.save(plots.learning_curve(TWO), tmp_path / "a.gif")


MIDDLE = np.array([[[0.1, 0.9], [0.4, 0.5], [0.2, 0.7]], [[0.3, 0.3], [0.1, 0.95], [0.5, 0.4]]])
NAMES = (["red", "full"], ["look", "lift", "tap"])


def texts(axes):
    return [text.get_text() for text in axes.texts]


def test_forest_orders_pairs_by_their_difference(tmp_path):
    axes = forest(MIDDLE, MIDDLE - 0.05, MIDDLE + 0.05, *NAMES)
    assert [tick.get_text() for tick in axes.get_yticklabels()] == [
        "look", "tap", "lift", "lift", "look", "tap",
    ]  # fmt: skip
    assert texts(axes) == ["red", "full"]
    lines = {bars.get_label(): bars for bars in axes.containers}
    assert set(lines) == {"of false objects", "of true objects"}
    x = lines["of true objects"].lines[0].get_xdata()
    np.testing.assert_allclose(x, [0.9, 0.7, 0.5, 0.95, 0.3, 0.4])
    segments = lines["of true objects"].lines[2][0].get_segments()
    np.testing.assert_allclose([end[0] for end in segments[0]], [0.85, 0.95])
    assert "interval" in axes.get_xlabel()
    assert save(axes, tmp_path / "forest.png").stat().st_size > 5000


def test_forest_says_what_it_leaves_out():
    axes = forest(MIDDLE, MIDDLE, MIDDLE, *NAMES, most=2)
    assert [tick.get_text() for tick in axes.get_yticklabels()] == ["look", "lift"]
    assert "the 2 pairs that differ most; 4 more are not shown" in axes.get_xlabel()


def test_predictive_shows_fractions_beside_their_intervals(tmp_path):
    observed = np.array([[8, 1, 1], [0, 0, 5]])
    predicted = np.stack([observed] * 99 + [[[7, 2, 1], [1, 0, 4]]])
    axes = predictive(observed, predicted)
    heights = [bar.get_height() for bar in axes.patches]
    np.testing.assert_allclose(heights, [0.8, 0.1, 0.1, 0, 0, 1])
    labels = {container.get_label() for container in axes.containers}
    assert {"false, observed", "true, predicted"} <= labels
    assert axes.get_xlabel() == 'percepts of 2 that say "yes"'
    assert save(axes, tmp_path / "predictive.png").stat().st_size > 5000

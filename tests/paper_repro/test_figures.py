"""Figures are drawn from the records: their titles, colors and sizes, and what they show."""

import json
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest
from matplotlib.colors import to_hex
from matplotlib.text import Text

from meal_bayes.domain import load_domain
from meal_bayes.evaluation import Interval
from meal_bayes.look import agent_style, save
from paper_repro import figures, frame
from paper_repro.figures import shapes
from paper_repro.figures.shapes import interval_of

RESULTS = Path(frame.__file__).parent / "results"
DRAWN = [item for item in frame.items() if item in figures.DRAWINGS]
SHOWN_AT = 700  # px of a page's column
DOTS_AN_INCH = 160  # of a file


def record_of(item):
    return json.loads((RESULTS / f"{item}.json").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def drawn():
    """The figures of every committed record, by the names of their files."""
    return {item: figures.draw(record_of(item)) for item in DRAWN}


def title_of(ax):
    return ax.get_figure(root=True).get_suptitle()


@pytest.mark.quick(4)
@pytest.mark.parametrize("item", DRAWN)
def test_a_record_names_its_figures(drawn, item):
    assert record_of(item)["figures"] == list(drawn[item])
    for name in drawn[item]:
        assert (RESULTS / name).is_file()


@pytest.mark.quick(2)
@pytest.mark.parametrize("item", DRAWN)
def test_figures_are_readable_at_the_width_of_a_page(drawn, item):
    for name, ax in drawn[item].items():
        figure = ax.get_figure(root=True)
        figure.draw_without_rendering()
        wide = figure.get_size_inches()[0] * DOTS_AN_INCH
        texts = [text for text in figure.findobj(Text) if text.get_text().strip()]
        least = min(text.get_fontsize() for text in texts) / 72 * DOTS_AN_INCH
        assert least * min(1, SHOWN_AT / wide) >= 9, name


@pytest.mark.quick(2)
@pytest.mark.parametrize("item", DRAWN)
def test_no_legend_covers_a_title_or_what_is_drawn(drawn, item):
    for name, ax in drawn[item].items():
        figure = ax.get_figure(root=True)
        figure.draw_without_rendering()
        assert title_of(ax), name
        assert "\n" not in title_of(ax), name
        assert figure._suptitle.get_window_extent().x1 <= figure.bbox.x1, name
        legends = [*figure.legends, *(each.get_legend() for each in figure.axes)]
        for legend in (each for each in legends if each is not None):
            box = legend.get_window_extent()
            assert not box.overlaps(figure._suptitle.get_window_extent()), name
            assert not any(box.overlaps(each.bbox) for each in figure.axes), name


def test_a_title_says_what_the_numbers_say():
    record = record_of("fig8")
    before = title_of(figures.draw(record)["fig8_reward_theirs.png"])
    assert before.startswith("Highest reward: MORC")
    turned = deepcopy(record)
    column = record["tables"][0]["columns"].index("reward")
    for row in turned["tables"][0]["rows"]:
        if row[2] == "random":
            row[column] = [900.0, 1.0]
    after = title_of(figures.draw(turned)["fig8_reward_theirs.png"])
    assert after == "Highest reward: Random (1, 2 and 3 attributes)"


@pytest.mark.parametrize("item", ["fig8", "fig10", "fig11", "eq7"])
def test_an_agent_has_its_color(drawn, item):
    """By its name, whatever else is drawn and in which order."""
    agents = {name: agent for agent, name in shapes.AGENT_NAMES.items()}
    seen = set()
    for ax in drawn[item].values():
        for each in ax.get_figure(root=True).axes:
            for handle, name in zip(*each.get_legend_handles_labels(), strict=True):
                line = handle[0] if isinstance(handle, tuple) else handle
                style = agent_style(agents[name])
                assert to_hex(line.get_color()) == style.color.lower()
                assert line.get_marker() == style.marker
                seen.add(name)
    assert seen or item == "eq7"  # whose lines are named at their ends


@pytest.mark.parametrize("measure", ["reward", "accuracy"])
def test_fig_10_draws_the_differences_of_its_tables(drawn, measure):
    end = "" if measure == "reward" else "_accuracy"
    ax = drawn["fig10"][f"fig10{end}_recorded.png"]
    table = next(t for t in record_of("fig10")["tables"] if t["title"].endswith("recorded"))
    rows = [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]
    base = next(row for row in rows if row["agent"] == "iterative_morc")
    for line in ax.get_lines():
        row = next(
            (row for row in rows if shapes.AGENT_NAMES[row["agent"]] == line.get_label()), None
        )
        if row is not None:
            until = min(row["explored, h"][0], base["explored, h"][0])
            assert max(line.get_xdata()) <= until
            told = [row[f"{measure} at {h:g} h"][0] for h in line.get_xdata()]
            assert told == list(line.get_ydata())


def test_means_have_two_errors_or_students_interval():
    assert interval_of([1.0, 0.5])[2:] == (0.0, 2.0)
    assert interval_of([0.0, 1.0], units=10).high == pytest.approx(2.262, abs=1e-3)
    assert interval_of([0.5, 0.4, 0.7])[2:] == (0.4, 0.7)
    assert all(np.isnan(interval_of(cell).low) for cell in (None, [None, None], [1.0, None]))


@pytest.mark.parametrize("name", ["roc36", "ispy32", "cy101", "roc36_published", "toy"])
def test_every_state_and_behavior_is_drawn(name, tmp_path):
    diagram = load_domain(name).diagram
    ax = shapes.transition_diagram(diagram)
    words = " ".join(text.get_text() for text in ax.texts)
    for state in diagram.states[:-1]:
        assert state in words
    for effect in diagram.effects:
        assert effect.behavior in words
    assert "term" not in words
    assert save(ax, tmp_path / "diagram.png").stat().st_size > 1000


def test_states_do_not_lie_on_each_other():
    diagram = load_domain("roc36").diagram
    ax = shapes.transition_diagram(diagram)
    places = {text.get_text(): text.get_position() for text in ax.texts}
    assert len({places[state] for state in diagram.states[:-1]}) == len(diagram.states) - 1


def test_dots_and_their_intervals_are_the_numbers():
    spans = [Interval(0.4, 0.1, 0.2, 0.5), Interval(0.9, 0.02, 0.85, 1.0)]
    ax = shapes.dots(
        {"random": spans, "morc": spans}, ["a", "b"], y_label="accuracy", fraction=True
    )
    for drawn in ax.containers:
        assert list(drawn[0].get_ydata()) == [0.4, 0.9]
        ends = drawn[2][0].get_segments()
        assert np.allclose([end[:, 1] for end in ends], [(0.2, 0.5), (0.85, 1.0)])
    ax.figure.draw_without_rendering()
    assert ax.get_legend().get_window_extent().y0 >= ax.bbox.y1  # it covers no dot


def test_numbers_stand_in_the_maps():
    table = np.array([[0.25, 0.5], [0.75, np.nan]])
    labels = ("a", "b", "accuracy")
    ax = shapes.heat_map(table, [1, 2], [3, 4], labels=labels)
    assert [text.get_text() for text in ax.texts] == ["0.25", "0.50", "0.75"]
    assert ax.images[0].get_clim() == (0.25, 0.75)
    rows = np.array([[[0.9, 0.1], [0.2, 0.8]]])
    ax = shapes.confusion_matrices(rows, ["red"])
    assert [text.get_text() for text in ax.texts][:2] == ["0.90", "0.10"]
    assert ax.images[0].get_clim() == (0.0, 1.0)
    assert [label.get_text() for label in ax.get_yticklabels()] == ["not red", "red"]

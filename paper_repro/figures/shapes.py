"""What figures of the paper share: numbers of a record's tables, and dots, maps, a diagram."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.special import stdtrit

from meal_bayes.domain import TransitionDiagram
from meal_bayes.domain.diagram import ANY_STATE
from meal_bayes.evaluation.plots import error_lengths
from meal_bayes.evaluation.statistics import Interval
from meal_bayes.look import (
    LINE_GRAY,
    agent_style,
    axes_to_draw,
    drawn_in_style,
    legend,
    level_names,
    name_axes,
)

Record = Mapping[str, Any]
Row = Mapping[str, Any]
UNKNOWN = Interval(np.nan, np.nan, np.nan, np.nan)
AGENT_NAMES = {  # in titles and legends, as in the pages' sentences
    "random": "Random",
    "random_legal": "Random Legal",
    "predefined": "Predefined",
    "predefined_plus": "Predefined Plus",
    "morc": "MORC",
    "morc_illegal": "MORC declining illegally",
    "morc_must_answer": "MORC that must answer",
    "iterative_random_legal": "Iterative Random Legal",
    "iterative_morc": "Iterative MORC",
    "morc_itrs": "MORC-ITRS",
    "prior": "base rates",
}
TWO_ERRORS = 2.0  # standard errors, where nobody says how many units a mean rests on


def rows_of(table: Mapping[str, Any]) -> list[Row]:
    """Return the rows of a table by the names of its columns."""
    return [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]


def interval_of(cell: Any, units: int | None = None, *, cases: int = 1) -> Interval:
    """Return the estimate and the ends of a cell.

    Parameters
    ----------
    cell : None, a number, [estimate, standard error], or [estimate, low, high] of a fraction.
    units : independent units of a mean, for a 95 % interval by Student's t; without them it
        reaches two standard errors.
    cases : how many such intervals of means hold together with 95 % (Bonferroni).
    """
    if cell is None or (isinstance(cell, list) and cell[0] is None):
        return UNKNOWN
    if not isinstance(cell, list):
        return Interval(float(cell), 0.0, float(cell), float(cell))
    estimate, *errors = cell
    if len(errors) > 1:
        return Interval(estimate, np.nan, errors[0], errors[1])
    error = errors[0] if errors[0] is not None else np.nan
    reach = error * (TWO_ERRORS if units is None else float(stdtrit(units - 1, 1 - 0.025 / cases)))
    return Interval(estimate, error, estimate - reach, estimate + reach)


def apart(first: Interval, second: Interval) -> bool:
    """Return whether two intervals have no value in common."""
    return first.low > second.high or second.low > first.high


def joined(words: Sequence[object]) -> str:
    """Join words as in a sentence; none are an empty text.

    >>> joined([1, 2, 3])
    '1, 2 and 3'
    """
    *first, last = map(str, words or [""])
    return f"{', '.join(first)} and {last}" if first else last


def leaders(groups: Mapping[int, Mapping[str, Interval]], *, least: bool = False) -> str:
    """Say who has the largest estimate in each group, or the least.

    Groups are named by their number of attributes.

    >>> one, two = Interval(1.0, 0.1, 0.8, 1.2), Interval(1.1, 0.1, 0.9, 1.3)
    >>> leaders({1: {"morc": one, "random": UNKNOWN}, 2: {"morc": one, "prior": two}})
    'MORC (1 attribute), base rates (2)'
    """
    told: dict[str, list[int]] = {}
    for place, intervals in groups.items():
        told.setdefault(leader(intervals, least=least), []).append(place)
    texts = [f"{AGENT_NAMES[best]} ({joined(places)})" for best, places in told.items()]
    noun = " attribute" if len(next(iter(told.values()))) == 1 else " attributes"
    return ", ".join([texts[0].replace(")", f"{noun})"), *texts[1:]])


def leader(intervals: Mapping[str, Interval], *, least: bool = False) -> str:
    """Return the name of the largest known estimate, or of the least."""
    sign = -1 if least else 1
    known = {name: span for name, span in intervals.items() if np.isfinite(span.estimate)}
    return max(known, key=lambda name: sign * known[name].estimate)


def rivals(intervals: Mapping[str, Interval], best: str) -> list[str]:
    """Return the names whose intervals overlap with that of the best.

    >>> one, two = Interval(1.0, 0.1, 0.8, 1.2), Interval(1.1, 0.1, 0.9, 1.3)
    >>> rivals({"morc": one, "prior": two, "random": UNKNOWN}, "prior")
    ['morc']
    """
    return [
        name
        for name, span in intervals.items()
        if name != best and np.isfinite(span.estimate) and not apart(intervals[best], span)
    ]


_LETTERS = 64  # that fit side by side below an axis
# Letters an inch of a line.
_TITLE_LETTERS = 12.0
_CAPTION_LETTERS = 16.5
_CLEAR = 0.07  # inches between a title or a caption and what is drawn
_NAME_GAP = 0.075  # of the height of the axes, between two names
_CELLS = 64  # of an image, beyond which its numbers are small


def headline(ax: Axes, finding: str, caption: str) -> Axes:
    """Write the finding in one line above a figure, and below it what the marks are.

    A long finding has smaller letters; the caption is broken into lines of the figure's width.
    """
    figure: Any = ax.get_figure(root=True)
    width = figure.get_size_inches()[0]
    figure.get_layout_engine().set(h_pad=_CLEAR)
    with drawn_in_style():
        figure.suptitle(
            finding,
            x=0.01,
            ha="left",
            fontsize=10 * min(1.0, width * _TITLE_LETTERS / len(finding)),
            weight="bold",
        )
        figure.supxlabel(
            fill(caption, int(width * _CAPTION_LETTERS)),
            x=0.01,
            ha="left",
            fontsize=8,
            color="#555555",
        )
    return ax


def name_ends(ax: Axes, ends: Mapping[str, tuple[float, float]]) -> None:
    """Write the name of each line behind its last point (x, y), names apart from one another."""
    to_axes = ax.transScale.transform  # linear in what is drawn, also on a logarithmic axis
    x = max(x for x, _ in ends.values())
    # Room for half of a mark behind the last point.
    start = to_axes((ax.get_xlim()[0], 1))[0]
    last = to_axes((x, 1))[0]
    ax.set_xlim(right=ax.transScale.inverted().transform((last + 0.015 * (last - start), 0))[0])
    order = sorted(ends, key=lambda name: ends[name][1])
    heights = np.array([to_axes((x, ends[name][1]))[1] for name in order])
    low, high = (to_axes((x, edge))[1] for edge in ax.get_ylim())
    # From below upwards each name is raised clear of the one before; then all move down together,
    # so that names lie about their lines in the mean.
    places = heights.copy()
    for at in range(1, len(places)):
        places[at] = max(places[at], places[at - 1] + _NAME_GAP * (high - low))
    places -= (places - heights).mean()
    for name, place in zip(order, (places - low) / (high - low), strict=True):
        ax.annotate(
            name,
            (1, place),
            xytext=(4, 0),
            xycoords="axes fraction",
            textcoords="offset points",
            va="center",
            fontsize=8,
            annotation_clip=False,
        )


def shared_legend(axes: Sequence[Axes]) -> None:
    """Add one legend of all panels to the right of them, clear of title and caption."""
    handles = {
        name: handle
        for ax in axes
        for handle, name in zip(*ax.get_legend_handles_labels(), strict=True)
    }
    with drawn_in_style():
        axes[-1].figure.legend(handles.values(), handles.keys(), loc="outside right center")


def panels(rows: int, columns: int, *, width: float, height: float) -> list[Axes]:
    """Return the Axes of a new figure (inches), row by row."""
    with drawn_in_style():
        figure = Figure(figsize=(width, height), layout="constrained")
        return list(figure.subplots(rows, columns, squeeze=False).ravel())


def dots(
    groups: Mapping[str, Sequence[Interval]],
    names: Sequence[str],
    *,
    y_label: str,
    fraction: bool = False,
) -> Axes:
    """Draw estimates with their intervals as dots side by side (as Figs 8 and 11).

    Groups hold for each agent an interval for each of the names below the axis. Of a `fraction` y
    goes from 0 to 1. Marks of a second agent of one style are hollow.
    """
    step = 0.72 / max(len(groups), 1)
    turned: dict[str, Any] = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
    with axes_to_draw(None, width=6.4, height=3.6) as to:
        place = np.arange(len(names))
        styles = set()
        for number, (agent, intervals) in enumerate(groups.items()):
            style = agent_style(agent)
            face = "white" if style in styles else style.color
            styles.add(style)
            to.errorbar(
                place + (number - (len(groups) - 1) / 2) * step,
                [span.estimate for span in intervals],
                error_lengths(intervals),
                fmt=style.marker,
                color=style.color,
                mfc=face,
                ms=5,
                elinewidth=1.3,
                capsize=2.5,
                label=AGENT_NAMES[agent],
            )
        for edge in place[1:]:
            to.axvline(edge - 0.5, color="#E6E6E6", lw=0.7)
        to.set_xticks(place, names, **turned if sum(map(len, names)) > _LETTERS else {})
        to.set_xlim(-0.5, len(names) - 0.5)
        name_axes(to, "", y_label, grid="y")
        to.axhline(0, color=LINE_GRAY, lw=0.8)
        if fraction:
            to.set_ylim(0, 1.04)
        legend(to, len(groups), above=True)
        return to


def heat_map(
    values: ArrayLike,
    x: Sequence[object],
    y: Sequence[object],
    *,
    labels: tuple[str, str, str],
    digits: int = 2,
    limits: tuple[float, float] | None = None,
    height: float = 2.9,
    ax: Axes | None = None,
) -> Axes:
    """Draw a table (len(y), len(x)) as colors with its numbers in them (as Fig. 12).

    `labels` are those of x, y and the values; `limits` the values of the darkest and the lightest
    color, the table's own by default.
    """
    table = np.asarray(values, float)
    with axes_to_draw(ax, height=height) as to:
        low, high = limits or (None, None)
        image = to.imshow(table, cmap="viridis", origin="lower", aspect="auto", vmin=low, vmax=high)
        dark = image.get_clim()
        small = 8 if table.size <= _CELLS else 7
        for (row, column), value in np.ndenumerate(table):
            if np.isfinite(value):
                # White numbers on the dark end of the colors, black ones on the light end.
                light = value < dark[0] + 0.6 * (dark[1] - dark[0])
                to.text(
                    column,
                    row,
                    f"{value:.{digits}f}",
                    ha="center",
                    va="center",
                    color="white" if light else "black",
                    fontsize=small,
                )
        to.set_xticks(range(len(x)), [str(name) for name in x])
        to.set_yticks(range(len(y)), [str(name) for name in y])
        to.set(xlabel=labels[0], ylabel=labels[1])
        to.figure.colorbar(image, ax=to, label=labels[2])
        return to


def confusion_matrices(
    confusion: ArrayLike, attributes: Sequence[str], *, title: str = "", ax: Axes | None = None
) -> Axes:
    """Draw one behavior's matrices (N,2,K), rows = truth."""
    table = np.asarray(confusion, float)
    n, _, k = table.shape
    names = [f"{word}{name}" for name in attributes for word in ("not ", "")]
    to = heat_map(
        table.reshape(2 * n, k),
        level_names(k),
        names,
        labels=("percept", "truth", "probability"),
        limits=(0.0, 1.0),
        height=1.2 + n,
        ax=ax,
    )
    to.invert_yaxis()  # the first attribute above
    to.set_title(title)
    to.hlines(np.arange(1, n) * 2 - 0.5, -0.5, k - 0.5, color="white", lw=3)
    return to


def transition_diagram(diagram: TransitionDiagram, *, ax: Axes | None = None) -> Axes:
    """Draw a diagram (as Fig. 5): a column for each number of behaviors that it takes to get there.

    Arrows are named by their behaviors, with a probability where it is below 1; loops stand under
    their state, what is possible everywhere under the title. The last state, where illegal
    behaviors and reports lead, is left out.
    """
    place = _places(diagram)
    arrows: dict[tuple[str, str], list[str]] = defaultdict(list)
    for effect in diagram.effects:
        source = effect.source
        target = effect.target
        chance = "" if effect.probability == 1 else f" {effect.probability:.2g}"
        arrows[source, source if target == ANY_STATE else target].append(effect.behavior + chance)
    with axes_to_draw(ax, width=7.2, height=3.4) as to:
        for name, (x, y) in place.items():
            color = "#000000" if name == diagram.start else LINE_GRAY
            to.plot(x, y, "o", ms=24, mfc="white", mec=color, mew=1.6, zorder=3)
            to.text(x, y, name, ha="center", va="center", zorder=4)
        for (source, target), names in arrows.items():
            if source == ANY_STATE:
                to.text(0, 1, "anywhere: " + ", ".join(names), transform=to.transAxes, va="top")
            elif source == target:
                x, y = place[source]
                text = "loop: " + "\n".join(names)
                to.text(x, y + 0.3, text, ha="center", va="bottom", fontsize=8)
            else:
                _arrow(to, place[source], place[target], "\n".join(names))
        ends = np.array(list(place.values()))
        low = ends.min(axis=0)
        high = ends.max(axis=0)
        to.set(xlim=(low[0] - 0.5, high[0] + 0.5), ylim=(low[1] - 0.7, high[1] + 1.0))
        to.set_axis_off()
        return to


def _places(diagram: TransitionDiagram) -> dict[str, tuple[float, float]]:
    """Compute the position of each state: its depth to the right, states of one depth apart."""
    # Breadth first: the depth of a state is the fewest behaviors that lead there.
    depth = {diagram.start: 0}
    frontier = [diagram.start]
    while frontier:
        state = frontier.pop(0)
        for effect in diagram.effects:
            if effect.source == state and effect.target not in (*depth, ANY_STATE):
                depth[effect.target] = depth[state] + 1
                frontier.append(effect.target)
    back = {
        e.source for e in diagram.effects if depth.get(e.target, np.inf) < depth.get(e.source, 0)
    }
    columns: dict[int, list[str]] = defaultdict(list)
    for name in sorted(depth, key=lambda name: name in back):  # ways back bend below all others
        columns[depth[name]].append(name)
    return {
        name: (1.6 * column, (len(names) - 1) / 2 - row)
        for column, names in columns.items()
        for row, name in enumerate(names)
    }


def _arrow(ax: Axes, start: tuple[float, float], end: tuple[float, float], name: str) -> None:
    """Draw an arrow; one that goes back bends below all states."""
    x, y = start
    to_x, to_y = end
    back = to_x < x
    bend = -0.35 if back else 0.0
    shape = {
        "arrowstyle": "-|>",
        "color": LINE_GRAY,
        "shrinkA": 13,
        "shrinkB": 13,
        "connectionstyle": f"arc3,rad={bend}",
    }
    ax.annotate("", end, start, arrowprops=shape)
    length = float(np.hypot(to_x - x, to_y - y))
    drop = 0.5 * bend * length if back else 0.0
    ax.text(
        (x + to_x) / 2,
        (y + to_y) / 2 + drop,
        name,
        ha="center",
        va="center",
        fontsize=8,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
    )

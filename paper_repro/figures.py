"""Figures that the paper has and a run's report has not: bars, maps, a transition diagram."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.canvas import COLORS, Axes, axes_to_draw, legend, name_axes
from meal_bayes.display import level_names
from meal_bayes.domain import TransitionDiagram
from meal_bayes.domain.diagram import ANY_STATE
from meal_bayes.evaluation.plots import reach
from meal_bayes.evaluation.statistics import Interval

_LETTERS = 48  # that fit side by side under bars
_CELLS = 64  # of an image, beyond which its numbers are small


def bars(
    groups: Mapping[str, Sequence[Interval]],
    names: Sequence[str],
    *,
    y_label: str,
    fraction: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw estimates with their intervals as bars side by side (as Fig. 8).

    Groups hold for each color an interval for each of the names under the bars; one group stands
    without a legend. Of a `fraction` y goes from 0 to 1.
    """
    with axes_to_draw(ax) as to:
        width, single = 0.8 / max(len(groups), 1), len(groups) == 1
        place = np.arange(len(names))
        for number, (group, intervals) in enumerate(groups.items()):
            x = place + (number - (len(groups) - 1) / 2) * width
            colors = [COLORS[i % len(COLORS)] for i in place] if single else COLORS[number % 8]
            heights = [interval.estimate for interval in intervals]
            to.bar(x, heights, width * 0.9, color=colors, label=None if single else group)
            to.errorbar(
                x, heights, reach(intervals), fmt="none", ecolor="#222222", elinewidth=1.1,
                capsize=2.5,
            )  # fmt: skip
        turned: dict[str, Any] = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
        to.set_xticks(place, names, **turned if sum(map(len, names)) > _LETTERS else {})
        name_axes(to, "", y_label, grid="y")
        if fraction:
            to.set_ylim(0, 1.04)
        legend(to, len(groups), above=True)  # bars fill their axes
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
        dark, small = image.get_clim(), 8 if table.size <= _CELLS else 6
        for (row, column), value in np.ndenumerate(table):
            if np.isfinite(value):
                light = value < dark[0] + 0.6 * (dark[1] - dark[0])
                to.text(column, row, f"{value:.{digits}f}", ha="center", va="center",
                        color="white" if light else "black", fontsize=small)  # fmt: skip
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
        table.reshape(2 * n, k), level_names(k), names, labels=("percept", "truth", "probability"),
        limits=(0.0, 1.0), height=1.2 + n, ax=ax,
    )  # fmt: skip
    to.invert_yaxis()  # the first attribute above
    to.set_title(title)
    to.hlines(np.arange(1, n) * 2 - 0.5, -0.5, k - 0.5, color="white", lw=3)
    return to


def transition_diagram(
    diagram: TransitionDiagram, *, title: str = "", ax: Axes | None = None
) -> Axes:
    """Draw a diagram (as Fig. 5): a column for each number of behaviors that it takes to get there.

    Arrows are named by their behaviors, with a probability where it is below 1; loops stand under
    their state, what is possible everywhere under the title. The last state, where illegal
    behaviors and reports lead, is left out.
    """
    place = _places(diagram)
    arrows: dict[tuple[str, str], list[str]] = defaultdict(list)
    for effect in diagram.effects:
        source, target = effect.source, effect.target
        chance = "" if effect.probability == 1 else f" {effect.probability:.2g}"
        arrows[source, source if target == ANY_STATE else target].append(effect.behavior + chance)
    with axes_to_draw(ax, width=7.2, height=3.4) as to:
        for name, (x, y) in place.items():
            color = COLORS[0] if name == diagram.start else "#4A4A4A"
            to.plot(x, y, "o", ms=24, mfc="white", mec=color, mew=1.6, zorder=3)
            to.text(x, y, name, ha="center", va="center", zorder=4)
        for (source, target), names in arrows.items():
            if source == ANY_STATE:
                to.text(0, 1, "anywhere: " + ", ".join(names), transform=to.transAxes, va="top")
            elif source == target:
                x, y = place[source]
                text = "loop: " + "\n".join(names)
                to.text(x, y + 0.3, text, ha="center", va="bottom", fontsize=7)
            else:
                _arrow(to, place[source], place[target], "\n".join(names))
        ends = np.array(list(place.values()))
        low, high = ends.min(axis=0), ends.max(axis=0)
        to.set(xlim=(low[0] - 0.5, high[0] + 0.5), ylim=(low[1] - 0.7, high[1] + 1.0))
        to.set_axis_off()
        to.set_title(title)
        return to


def _places(diagram: TransitionDiagram) -> dict[str, tuple[float, float]]:
    """Compute the position of each state: its depth to the right, states of one depth apart."""
    depth, frontier = {diagram.start: 0}, [diagram.start]
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
    (x, y), (to_x, to_y) = start, end
    back = to_x < x
    bend = -0.35 if back else 0.0
    ax.annotate(
        "", end, start,
        arrowprops={"arrowstyle": "-|>", "color": "#7A7A7A", "shrinkA": 13, "shrinkB": 13,
                    "connectionstyle": f"arc3,rad={bend}"},
    )  # fmt: skip
    length = float(np.hypot(to_x - x, to_y - y))
    drop = 0.5 * bend * length if back else 0.0
    ax.text(
        (x + to_x) / 2, (y + to_y) / 2 + drop, name, ha="center", va="center", fontsize=7,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 0.6},
    )  # fmt: skip

"""The figure of a transition diagram: states, and the behaviors that lead from one to another."""

from collections import defaultdict

import numpy as np

from meal_bayes.domain import TransitionDiagram
from meal_bayes.domain.diagram import ANY_STATE
from meal_bayes.evaluation.canvas import COLORS, Axes, axes_to_draw


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
        here = frontier.pop(0)
        for effect in diagram.effects:
            if effect.source == here and effect.target not in (*depth, ANY_STATE):
                depth[effect.target] = depth[here] + 1
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

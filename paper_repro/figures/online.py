"""Figures of agents that learn online: curves as differences, attributes, weights."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from meal_bayes.evaluation.statistics import Interval
from meal_bayes.look import LINE_GRAY, agent_style, axes_to_draw, name_axes
from paper_repro.figures.shapes import (
    AGENT_NAMES,
    Record,
    Row,
    apart,
    dots,
    headline,
    heat_map,
    interval_of,
    joined,
    panels,
    rows_of,
    shared_legend,
)

_BASE = "iterative_morc"
_BEST = "morc_itrs"
_DRAWN = ("iterative_random_legal", _BEST)
_RIGHT = "accuracy (share answered right)"
_BUDGETS = (0.5, 1, 2, 4)  # hours at which the tables compare
_ENDS = {"reward": "", "accuracy": "_accuracy"}  # of the names of the files


def fig10(record: Record) -> dict[str, Axes]:
    """Draw the differences in reward and in accuracy to Iterative MORC over the hours."""
    figures = {}
    for protocol in ("recorded", "theirs"):
        tables = [table for table in record["tables"] if table["title"].endswith(f", {protocol}")]
        for measure, end in _ENDS.items() if tables else ():
            figures[f"{end}_{protocol}"] = _leads(record, tables, measure)
    return figures


def _leads(record: Record, tables: Sequence[Mapping[str, Any]], measure: str) -> Axes:
    """Draw the differences of a measure to Iterative MORC's, a panel a table."""
    columns = min(len(tables), 2)
    rows = -(-len(tables) // columns)
    axes = panels(rows, columns, width=6.8, height=1.4 + 1.9 * rows)
    told: dict[str, list[str]] = {}
    unit = ", s" if measure == "reward" else ""
    for ax, table in zip(axes, tables, strict=False):
        agents = {row["agent"]: row for row in rows_of(table)}
        for agent in (name for name in _DRAWN if name in agents):
            _difference(ax, agents[agent], agents[_BASE], measure)
            area = interval_of(
                agents[agent][f"{measure} over H h, less its"],
                agents[agent]["repeats"],
                cases=len(tables),
            )
            told.setdefault(agent, []).append(_side(area))
        with axes_to_draw(ax):
            ax.axhline(0, color=LINE_GRAY, lw=1)
            ax.set_title(table["title"].rpartition(", ")[0], fontsize=9, loc="left")
            name_axes(ax, "exploration, h", f"{measure} difference\nto Iterative MORC{unit}")
            ax.set_xscale("log")
            ax.set_xticks(_BUDGETS, [f"{h:g}" for h in _BUDGETS])
            ax.minorticks_off()
            ax.set_xlim(0.45, 4.4)
    for ax in axes[len(tables) :]:
        ax.remove()
    others = "; ".join(
        f"{AGENT_NAMES[agent]} is {_counts(sides)}"
        for agent, sides in told.items()
        if agent != _BEST
    )
    shared_legend(axes[: len(tables)])
    headline(
        axes[0],
        f"{measure.capitalize()} against Iterative MORC: {AGENT_NAMES[_BEST]} is "
        f"{_counts(told.get(_BEST, []))} of {len(tables)} panels",
        f"Judged by the mean over the hours that both explored, all panels together; {others}. "
        f"{record['size']} Bands: 95 % intervals over splits of the same objects (Student's t). "
        "A line ends where either agent stopped exploring.",
    )
    return axes[0]


def _difference(ax: Axes, row: Row, base: Row, measure: str) -> None:
    """Draw an agent's line, to where both have explored.

    Differences are paired repeat by repeat, as curves of one split of the objects move together.
    """
    until = min(row["explored, h"][0], base["explored, h"][0])
    cells = {h: row[f"{measure} at {h:g} h"] for h in _BUDGETS if h <= until}
    hours = [h for h, cell in cells.items() if cell is not None]
    spans = [interval_of(cells[h], row["repeats"]) for h in hours]
    if not spans:
        return
    y, _, low, high = np.transpose(spans)
    style = agent_style(row["agent"])
    ax.plot(
        hours,
        y,
        style.dash,
        marker=style.marker,
        color=style.color,
        ms=4.5,
        lw=1.5,
        label=AGENT_NAMES[row["agent"]],
    )
    ax.fill_between(hours, low, high, color=style.color, alpha=0.15, lw=0)


def _side(interval: Interval) -> str:
    """Say on which side of 0 an interval lies."""
    if interval.low > 0:
        return "ahead"
    return "behind" if interval.high < 0 else "not told apart"


def _counts(sides: Sequence[str]) -> str:
    return joined([f"{side} in {sides.count(side)}" for side in dict.fromkeys(sides)])


def fig11(record: Record) -> dict[str, Axes]:
    """Draw the accuracy of each attribute, a dot an agent, ranked by MORC-ITRS."""
    table = record["tables"][0]
    figures = {}
    agents = table["columns"][2:]
    for protocol in dict.fromkeys(row[0] for row in table["rows"]):
        rows = [row for row in rows_of(table) if row["percepts"] == protocol]
        groups = {agent: [interval_of(row[agent]) for row in rows] for agent in agents}
        ax = dots(groups, [row["attribute"] for row in rows], y_label=_RIGHT, fraction=True)
        others = [agent for agent in agents if agent != _BEST]
        ahead = sum(all(row[_BEST][0] > row[agent][0] for agent in others) for row in rows)
        clear = sum(
            all(apart(interval_of(row[_BEST]), interval_of(row[agent])) for agent in others)
            for row in rows
        )
        headline(
            ax,
            f"MORC-ITRS is most accurate on {ahead} of {len(rows)} attributes, clearly on {clear}",
            "Clearly: its interval does not overlap with those of the other two. "
            f"CY101, percepts {protocol}. {record['size']} "
            "95 % intervals over splits of the same objects.",
        )
        figures[f"_{protocol}"] = ax
    return figures


def fig12(record: Record) -> dict[str, Axes]:
    """Draw accuracy over alpha and beta, a map a moment, in the colors of one scale."""
    table = record["tables"][0]
    rows = rows_of(table)
    alphas = list(dict.fromkeys(row["alpha"] for row in rows))
    betas = list(dict.fromkeys(row["beta"] for row in rows))
    moments = table["columns"][3:]
    means = {
        moment: np.reshape([row[moment][0] for row in rows], (len(alphas), len(betas))).T
        for moment in moments
    }
    # One scale for all three maps, or a reader would take a moment's colors for another's numbers.
    everything = np.concatenate(list(means.values()))
    limits = (float(everything.min()), float(everything.max()))
    figures = {}
    for moment, values in means.items():
        ax = heat_map(
            values,
            alphas,
            betas,
            labels=("alpha, s per bit", "beta, s per labeled object", "share answered right"),
            digits=3,
            limits=limits,
        )
        best = max(rows, key=lambda row: row[moment][0])
        span = interval_of(best[moment])
        where = f"alpha {best['alpha']}, beta {best['beta']}"
        near = sum(not apart(span, interval_of(row[moment])) for row in rows) - 1
        headline(
            ax,
            f"{moment.capitalize()}: "
            + ("no pair (alpha, beta) is clearly best" if near else where),
            f"The highest is {where}: {span.estimate:.3f} [{span.low:.3f}, {span.high:.3f}], not "
            f"told apart from {near} of the other {len(rows) - 1} pairs. Accuracy of MORC-ITRS on "
            f"CY101. {record['size']}",
        )
        figures[f"_{moment}"] = ax
    return figures

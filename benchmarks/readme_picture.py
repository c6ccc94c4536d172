"""The picture of results: mean rewards of agents by question, on a light and a dark page."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from readme_tables import LOSSES, OURS, SUMMARIZED, Rows, Tables, question, runs_of

from meal_bayes.look import (
    agent_style,
    axes_to_draw,
    legend,
    lightened,
    name_axes,
    readable,
    save,
)

ASSETS = Path(__file__).resolve().parents[1] / "docs" / "assets"
NUMBER_WIDTH = 75.0  # of a reward beside its mark, in seconds of the axis
INK = {False: "#1C2430", True: "#E8EBEF"}  # on a light and on a dark page


def write_pictures(tables: Tables) -> None:
    """Write the pictures that the README shows, for light and dark pages, and for phones."""
    for narrow in (False, True):
        for dark in (False, True):
            name = "results" + ("-narrow" if narrow else "") + ("-dark" if dark else "")
            save(draw_results(tables, dark=dark, narrow=narrow), ASSETS / f"{name}.svg")
    save(draw_losses(tables[LOSSES]["rows"]), ASSETS / "losses.png")


def draw_results(tables: Tables, *, dark: bool, narrow: bool = False) -> Axes:
    """Draw the reward of agents with 95 % intervals, a row a question; declining earns 0.

    In a narrow picture the questions stand above their rows.
    """
    runs = runs_of(tables)
    width, height = (3.9, 1.6 + 0.95 * len(runs)) if narrow else (8.4, 1.4 + 0.75 * len(runs))
    with axes_to_draw(None, width=width, height=height) as ax:
        for number, agent in enumerate(SUMMARIZED):
            for place, name in enumerate(runs):
                (row,) = (row for row in tables[name]["rows"] if row["agent"] == agent)
                label = agent if place == 0 else None
                height = place + 0.2 * (number - (len(SUMMARIZED) - 1) / 2)
                _draw_reward(ax, row, height, label=label, dark=dark)
        rows = np.arange(len(runs))
        # In a narrow picture the line leaves room for the names of the questions.
        top, bottom = (rows - 0.34, rows + 0.36) if narrow else (rows - 0.6, rows + 0.5)
        ax.vlines(0 * rows, top, bottom, color="#8A939E", lw=1.2, ls="--", label="declining")
        ax.set_yticks(range(len(runs)), ["" if narrow else run.title for run in runs.values()])
        drawn = [row for name in runs for row in tables[name]["rows"] if row["agent"] in SUMMARIZED]
        left = min(row["reward_low"] for row in drawn) - 20.0
        ax.set(ylim=(len(runs) - 0.5, -0.6), xlim=(left, 640 if narrow else 580))
        if narrow:
            ax.tick_params(axis="y", length=0)
            for place, run in enumerate(runs.values()):
                ax.text(left + 5, place - 0.42, run.title, size=10, color=INK[dark])
        breaks = "\n" if narrow else " "
        reward = (
            f"mean reward of a trial, s{breaks}(+500 or +300 right, -1 a second), 95 % interval"
        )
        name_axes(ax, reward, "", grid="x")
        legend(ax, len(SUMMARIZED) + 1, above=True)
        ax.figure.suptitle(
            title_of(tables, narrow=narrow),
            x=0.01,
            ha="left",
            weight="bold",
            size=9 if narrow else 11,
            color=INK[dark],
        )
        _color_for_page(ax, dark=dark)
    return ax


PARTS = {"data": "more data", "plans": "better plans", "sensors": "better sensors"}
GRAYS = ("#4A4A4A", "#9A9A9A", "#D8D8D8")


def draw_losses(rows: Rows) -> Axes:
    """Draw what each kind of question lacks of the reward of perfect percepts, by its remedy."""
    gaps = np.array([[row[part] for part in PARTS] for row in rows])
    place = np.arange(len(rows))
    with axes_to_draw(None, width=6.4, height=1.0 + 0.3 * len(rows)) as ax:
        starts = np.zeros(len(rows))
        for name, color, part in zip(PARTS.values(), GRAYS, gaps.T, strict=True):
            ax.barh(place, part, 0.66, left=starts, color=color, label=name)
            for at, (start, width) in enumerate(zip(starts, part, strict=True)):
                if width > 0.06 * gaps.sum(axis=1).max():  # where a number fits into its bar
                    ink = "white" if color == GRAYS[0] else "black"
                    middle = start + width / 2
                    text = f"{width:.0f}"
                    ax.text(middle, at, text, ha="center", va="center", fontsize=8, color=ink)
            starts = starts + part
        ax.set_yticks(place, [question(row) for row in rows])
        ax.invert_yaxis()
        name_axes(ax, "reward missing to perfect percepts, s", "", grid="x")
        ax.tick_params(axis="y", length=0)
        legend(ax, len(PARTS), above=True)
    most = np.bincount(gaps.argmax(axis=1), minlength=len(PARTS))
    first = list(PARTS.values())[most.argmax()].capitalize()
    title = f"{first} would add most reward in {most.max()} of {len(rows)} kinds of question"
    ax.figure.suptitle(title, x=0.01, ha="left", weight="bold", size=10)
    return ax


def title_of(tables: Tables, *, narrow: bool) -> str:
    """Say in how many questions our agent earns more than all others, by 95 % intervals.

    Declining every question is one of the others.
    """
    more = less = 0
    runs = runs_of(tables)
    for name in runs:
        others = [row for row in tables[name]["rows"] if row["agent"] != OURS]
        more += all(row["ours_more_low"] > 0 for row in others)
        less += any(row["ours_more_high"] < 0 for row in others)
    title = f"{OURS} earns more than all others in {more} of {len(runs)} questions"
    if less:
        title += f", less in {less}"
    same = len(runs) - more - less
    return title if narrow or not same else f"{title}; {same} are too close to tell"


def _draw_reward(
    ax: Axes, row: Mapping[str, Any], height: float, *, label: str | None, dark: bool
) -> None:
    """Draw one agent's mean reward with its interval and, beside it, the number."""
    style = agent_style(row["agent"])
    color = lightened(style.color) if dark else style.color
    ax.errorbar(
        row["reward"],
        height,
        xerr=[[row["reward"] - row["reward_low"]], [row["reward_high"] - row["reward"]]],
        fmt=style.marker,
        color=color,
        ms=7,
        elinewidth=1.8,
        label=label,
    )
    # A number that would lie on the line at 0 stands on the other side of the interval.
    left = -NUMBER_WIDTH < row["reward_high"] < 0
    ax.annotate(
        f"{row['reward']:.0f}",
        (row["reward_low"] if left else row["reward_high"], height),
        # Clear of the mark, also where the interval is shorter than it.
        xytext=(-6 if left else 6, 0),
        textcoords="offset points",
        ha="right" if left else "left",
        va="center",
        size=9,
        color=readable(color, dark=dark),
    )


def _color_for_page(ax: Axes, *, dark: bool) -> None:
    """Let the page show through, and write in its ink."""
    ink = INK[dark]
    ax.grid(axis="x", color="#38414C" if dark else "#E6E6E6", lw=0.7)
    ax.patch.set_alpha(0)
    ax.figure.patch.set_alpha(0)
    ticks = (*ax.get_xticklabels(), *ax.get_yticklabels())
    for text in (*ticks, ax.xaxis.label, *ax.get_legend().get_texts()):
        text.set_color(ink)
        text.set_size(10)
    for side in ax.spines.values():
        side.set_color(ink)

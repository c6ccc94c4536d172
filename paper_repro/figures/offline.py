"""Figures of trials of trained agents: strategies, irrelevant attributes, budgets."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.ticker import LogLocator

from meal_bayes.domain import load_domain
from meal_bayes.evaluation.plots import error_lengths
from meal_bayes.evaluation.statistics import Interval
from meal_bayes.look import agent_style, axes_to_draw, name_axes
from paper_repro.figures.shapes import (
    AGENT_NAMES,
    Record,
    Row,
    confusion_matrices,
    dots,
    headline,
    interval_of,
    joined,
    leader,
    leaders,
    name_ends,
    rivals,
    rows_of,
    transition_diagram,
)

_MEASURES = {"reward": "reward", "cost": "cost, s", "success": "accuracy"}
_SUPER = {"reward": "reward", "cost": "cost, s", "success": "accuracy, relevant ones"}
_AXES = {
    "reward": "reward, s",
    "cost, s": "cost, s",
    "accuracy": "accuracy (share answered right)",
    "accuracy, relevant ones": "share answered right,\nrelevant attributes",
}
_SETTINGS = (("-", "o"), ("--", "s"), (":", "D"), ("-.", "^"))  # of one agent's lines
_DIAGRAMS = ("ispy32", "cy101", "roc36")
_ARROWS = "Arrows are behaviors, with their probability where it is below 1."
_MEANS = "Lines reach two standard errors of a mean, or 95 % of a fraction."


def fig4(record: Record) -> dict[str, Axes]:
    """Draw the confusion matrices of each source of classifiers."""
    table = record["tables"][0]
    # Two columns of the table are called "yes": cells of a matrix have letters here.
    columns = ("attribute", "source", *"abcd", "kappa")
    rows = [dict(zip(columns, row, strict=True)) for row in table["rows"]]
    figures = {}
    for source in dict.fromkeys(row["source"] for row in rows):
        chosen = [row for row in rows if row["source"] == source]
        names = [row["attribute"] for row in chosen]
        matrices = np.array([[row[cell] for cell in "abcd"] for row in chosen]).reshape(-1, 2, 2)
        ax = confusion_matrices(matrices, names)
        best, worst = (most(chosen, key=lambda row: row["kappa"]) for most in (max, min))
        headline(
            ax,
            f"Shake tells {best['attribute']} best, {worst['attribute']} worst "
            f"(kappa {best['kappa']:.2f}, {worst['kappa']:.2f})",
            f"ROC36, classifiers: {source}. Each row is Pr(percept | truth); kappa is Cohen's.",
        )
        end = source.removeprefix("published, ")
        figures[f"_{end}"] = ax
    return figures


def fig5(record: Record) -> dict[str, Axes]:
    """Draw the transition diagrams of the paper and of the published code."""
    del record  # diagrams are the domains'
    figures = {}
    for name in _DIAGRAMS:
        for end, whose in (("", "the paper"), ("_published", "the published code")):
            diagram = load_domain(name + end).diagram
            behaviors = {effect.behavior for effect in diagram.effects}
            size = f"{len(diagram.states) - 1} states and {len(behaviors)} behaviors"
            finding = f"{name.upper()} has {size} in {whose}"
            words = zip(diagram.states, diagram.labels, strict=False)
            states = ", ".join(f"{state} {label}" for state, label in words)
            caption = f"Circles are states ({states}); the black one is the start. " + _ARROWS
            figures[f"_{name}{end}"] = headline(transition_diagram(diagram), finding, caption)
    return figures


def fig8(record: Record) -> dict[str, Axes]:
    """Draw reward, cost and accuracy of each strategy over the number of attributes."""
    rows = rows_of(record["tables"][0])
    figures = {}
    for percepts in dict.fromkeys(row["percepts"] for row in rows):
        chosen = [row for row in rows if row["percepts"] == percepts]
        numbers = list(dict.fromkeys(row["attributes"] for row in chosen))
        places = ["1 attribute" if n == 1 else f"{n} attributes" for n in numbers]
        for measure, column in _MEASURES.items():
            groups = _by_agent(chosen, column)
            ax = dots(groups, places, y_label=_AXES[column], fraction=measure == "success")
            least = measure == "cost"
            by_number = {
                n: {
                    agent: spans[i]
                    for agent, spans in groups.items()
                    if not least or agent != "prior"  # which touches nothing
                }
                for i, n in enumerate(numbers)
            }
            word = "Least" if least else "Highest"
            told = leaders(by_number, least=least)
            near = {
                n: len(rivals(spans, leader(spans, least=least))) for n, spans in by_number.items()
            }
            size = record["size"].replace("*", "")
            counts = joined([f"{count} at {n}" for n, count in near.items()])
            headline(
                ax,
                f"{word} {column.split(',')[0]}: {told}",
                f"ISPY32, percepts {percepts}. Other agents not told apart from the "
                f"{word.lower()}, by number of attributes: {counts}. {size} {_MEANS}",
            )
            figures[f"_{measure}_{percepts}"] = ax
    return figures


def _by_agent(rows: Sequence[Row], column: str) -> dict[str, list[Interval]]:
    groups: dict[str, list[Interval]] = {}
    for row in rows:
        groups.setdefault(row["agent"], []).append(interval_of(row[column]))
    return groups


def fig9(record: Record) -> dict[str, Axes]:
    """Draw each measure of MORC over the number of irrelevant attributes."""
    rows = rows_of(record["tables"][0])
    kinds = list(dict.fromkeys(row["percepts"] for row in rows))
    figures = {}
    for measure, column in _SUPER.items():
        told = {}
        starts, ends = {}, {}
        with axes_to_draw(None, width=6.4, height=3.4) as ax:
            for kind, (dash, marker) in zip(kinds, _SETTINGS, strict=False):
                chosen = [row for row in rows if row["percepts"] == kind]
                x = [row["irrelevant"] for row in chosen]
                spans = [interval_of(row[column]) for row in chosen]
                _, _, low, high = np.transpose(spans)
                y = [span.estimate for span in spans]
                color = agent_style("morc").color
                ax.plot(x, y, dash, marker=marker, color=color, ms=4.5, lw=1.6)
                ax.fill_between(x, low, high, color=color, alpha=0.12, lw=0)
                starts[kind] = y[0]
                ends[kind] = (x[-1], y[-1])
                digits = 2 if measure == "success" else 0
                told[kind] = f"from {y[0]:.{digits}f} to {y[-1]:.{digits}f}"
            name_axes(ax, "irrelevant attributes, number", _AXES[column])
            name_ends(ax, ends)
        word = column.split(",")[0]
        unit = "" if measure == "success" else " s"
        first, *others = kinds
        goes = "falls" if starts[first] > ends[first][1] else "rises"
        rest = "; ".join(f"{kind}, {told[kind]}{unit}" for kind in others)
        headline(
            ax,
            f"{word.capitalize()} {goes} {told[first]}{unit} with {x[-1]} irrelevant attributes "
            f"({first})",
            f"MORC on ISPY32. The other lines: {rest}. {_MEANS.replace('Lines', 'Bands')}",
        )
        figures[f"_{measure}"] = ax
    return figures


def eq7(record: Record) -> dict[str, Axes]:
    """Draw right answers within a budget, one line a strategy, both axes logarithmic."""
    table = record["tables"][0]
    budgets = [column for column in table["columns"] if column.startswith("within ")]
    hours = [float(column.split()[1]) for column in budgets]
    rows = rows_of(table)
    figures = {}
    for title in dict.fromkeys(row[""] for row in rows):
        chosen = [row for row in rows if row[""] == title]
        last = {row["agent"]: interval_of(row[budgets[-1]]) for row in chosen}
        ends = {}
        with axes_to_draw(None, width=6.4, height=3.6) as ax:
            for row in chosen:
                spans = [interval_of(row[column]) for column in budgets]
                style = agent_style(row["agent"])
                y = [max(span.estimate, 0.5) for span in spans]  # none is below one
                ax.errorbar(
                    hours,
                    y,
                    error_lengths(spans),
                    fmt=style.marker + style.dash,
                    ms=5,
                    lw=1.5,
                    color=style.color,
                    capsize=2.5,
                    elinewidth=1.1,
                )
                ends[f"{AGENT_NAMES[row['agent']]} {spans[-1].estimate:.0f}"] = (hours[-1], y[-1])
            ax.set(xscale="log", yscale="log")
            ax.set_xticks(hours, [f"{60 * h:.0f}" for h in hours], minor=False)
            ax.minorticks_off()
            ax.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
            ax.yaxis.set_major_formatter("{x:g}")
            name_axes(ax, "exploration budget, min", "right answers, number")
            name_ends(ax, ends)
        # Random guesses at once and so answers most: it is told apart from those that look.
        seeing = {agent: span for agent, span in last.items() if agent != "random"}
        best = leader(seeing)
        finding = (
            f"{AGENT_NAMES[best]} answers right {seeing[best].estimate:.0f} times within "
            f"{hours[-1]:g} h"
        )
        if leader(last) == "random":
            finding += f"; Random, by guessing, {last['random'].estimate:.0f} times"
        else:
            finding += ", most of all agents"
        overlap = ""
        near = rivals(last, leader(last))
        if near:
            close = joined([AGENT_NAMES[agent] for agent in near])
            overlap = f"Not told apart from the highest: {close}. "
        errors = ""
        if any(isinstance(row[budgets[-1]], list) for row in chosen):
            errors = "Lines reach two standard errors (bootstrap). "
        headline(
            ax,
            finding,
            f"{title}. {overlap}{record['size']} {errors}Trials run one after another.",
        )
        place = title.split(",")[0].lower()
        protocol = title.rsplit(" ", 1)[1]
        figures[f"_{place}_{protocol}"] = ax
    return figures

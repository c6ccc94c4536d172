"""Figures of trials and of posteriors; each is drawn into a new figure, and its axes returned."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.canvas import Axes
from meal_bayes.evaluation.calibration import BINS, bins_of, checked_cases
from meal_bayes.evaluation.statistics import (
    HIGH_QUANTILE,
    LOW_QUANTILE,
    MASS_TEXT,
    Interval,
    wilson_interval,
)
from meal_bayes.look import (
    BLUE,
    LINE_GRAY,
    VERMILION,
    agent_style,
    axes_to_draw,
    legend,
    name_axes,
)
from meal_bayes.trials.picture import trial_picture

__all__ = [
    "Series", "accuracy_and_cost", "cost_distribution", "error_lengths", "forest", "learning_curve",
    "lines", "predictive", "reliability_diagram", "trial_picture",
]  # fmt: skip

_MANY = 25  # points on a line, beyond which they get no markers
_LINES_BESIDE_LEGEND = 3  # lines that leave room for a legend between them
_TRUTHS = (("false", "s", VERMILION), ("true", "o", BLUE))  # with markers and colors
_ROW = 0.19  # inches of a row of a forest, of which 40 fit a page
_BESIDE_0 = 0.03  # of the axis, so that what costs nothing is not drawn on its left edge
_WIDE = 4.0  # costs with a larger ratio of the largest to the median are drawn on a log scale


class Series(NamedTuple):
    """One line and, where it is known, the band of its error; (n,) each, NaN in y is a gap."""

    name: str
    x: NDArray[np.float64]
    y: NDArray[np.float64]
    low: NDArray[np.float64] | None = None
    high: NDArray[np.float64] | None = None


def lines(series: Sequence[Series], *, x_label: str, y_label: str, ax: Axes | None = None) -> Axes:
    """Draw lines with error bands over x (as Fig. 9)."""
    with axes_to_draw(ax) as to:
        for name, x, y, low, high in series:
            color, marker, dash = agent_style(name)
            symbol = marker if len(x) <= _MANY else None
            to.plot(x, y, color=color, marker=symbol, ls=dash, ms=4, lw=1.6, label=name)
            if low is not None and high is not None:
                to.fill_between(x, low, high, color=color, alpha=0.18, lw=0)
        name_axes(to, x_label, y_label)
        legend(to, len(series), above=len(series) > _LINES_BESIDE_LEGEND)
        return to


def learning_curve(series: Sequence[Series]) -> Axes:
    """Draw accuracy over the hours of exploration, a line for each agent (Figs. 10, 11)."""
    ax = lines(series, x_label="exploration, h", y_label="accuracy (fraction of trials)")
    ax.set_ylim(max(ax.get_ylim()[0], -0.02), min(ax.get_ylim()[1], 1.02))
    return ax


def reliability_diagram(
    positive: ArrayLike, truth: ArrayLike, *, small: bool = False, agent: str = "bayes"
) -> Axes:
    """Draw the fraction of true attributes over the belief, with Wilson's intervals.

    Points on the diagonal are calibrated; gray columns are the fraction of beliefs in each bin. A
    `small` one, of several side by side, has no legend. The color is the agent's.
    """
    b, true = checked_cases(positive, truth)
    index = bins_of(b)
    n = np.bincount(index, minlength=BINS)
    hits = np.bincount(index[true], minlength=BINS)
    filled = np.flatnonzero(n)
    width, height = (2.1, 2.1) if small else (3.4, 3.9)
    with axes_to_draw(None, width=width, height=height) as to:
        edges = np.arange(BINS) / BINS
        to.bar(edges, n / len(b), 1 / BINS, align="edge", color="#E3E3E3", label="beliefs")
        to.plot([0, 1], [0, 1], color=LINE_GRAY, lw=1, ls="--", label="calibrated")
        intervals = [wilson_interval(int(hits[i]), int(n[i])) for i in filled]
        mean = np.array([b[index == i].mean() for i in filled])
        to.errorbar(
            mean,
            hits[filled] / n[filled],
            error_lengths(intervals),
            fmt="o",
            ms=4.5,
            color=agent_style(agent).color,
            capsize=2,
            elinewidth=1,
            label="true",
        )
        name_axes(to, "belief (probability)", "fraction true")
        to.set(xlim=(-0.05, 1.05), ylim=(-0.05, 1.05), aspect="equal")
        legend(to, 0 if small else 3, above=True)
        return to


def cost_distribution(groups: Mapping[str, ArrayLike]) -> Axes:
    """Draw the fraction of trials over the cost they stay within, one step line an agent."""
    with axes_to_draw(None) as to:
        for group, costs in groups.items():
            color, _, dash = agent_style(group)
            values, counts = np.unique(np.asarray(costs, float), return_counts=True)
            to.ecdf(values, counts, color=color, ls=dash, lw=1.6, label=group)
        name_axes(to, "cost of a trial, s", "fraction of trials")
        to.set_ylim(0, 1.02)
        _scale_costs(to, [np.asarray(costs, float).mean() for costs in groups.values()])
        legend(to, len(groups), above=True)
        return to


def accuracy_and_cost(points: Mapping[str, tuple[Interval, Interval]]) -> Axes:
    """Draw accuracy over mean cost, s, with the intervals of both, a point an agent."""
    with axes_to_draw(None) as to:
        for agent, (accuracy, cost) in points.items():
            color, marker, _ = agent_style(agent)
            to.errorbar(
                cost.estimate,
                accuracy.estimate,
                xerr=error_lengths([cost]),
                yerr=error_lengths([accuracy]),
                fmt=marker,
                color=color,
                ms=5.5,
                elinewidth=1.1,
                capsize=2.5,
            )
            to.plot([], [], ls="", marker=marker, color=color, ms=5.5, label=agent)
        name_axes(to, "mean cost of a trial, s", "accuracy (fraction of trials)")
        to.set_ylim(-0.04, 1.04)
        _scale_costs(to, [cost.estimate for _, cost in points.values()])
        legend(to, len(points), above=True)
        return to


def forest(
    middle: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    attributes: Sequence[str],
    behaviors: Sequence[str],
    *,
    most: int = 40,
) -> Axes:
    """Draw Pr(yes | false) and Pr(yes | true), (P,E,2), each with the ends of its interval.

    One row a pair; attributes stay together, the behavior with the largest difference first. Of
    more than `most` pairs, those with the largest differences are drawn.
    """
    center = np.asarray(middle, float)
    ends = np.abs(np.stack([low, high]) - center)  # (2,P,E,2)
    gap = center[..., 1] - center[..., 0]
    pairs = sorted(np.ndindex(gap.shape), key=lambda pair: -gap[pair])[:most]
    pairs.sort(key=lambda pair: (pair[0], -gap[pair]))
    p, e = np.transpose(pairs)
    # Rows are 1 apart, and below the name of the next attribute 0.9 more.
    heads = np.unique(p, return_index=True)[1]
    height = np.arange(len(pairs)) + 0.9 * np.searchsorted(heads, np.arange(len(pairs)), "right")
    with axes_to_draw(None, height=1.1 + _ROW * (height[-1] + 1)) as to:
        for truth, (name, marker, color) in enumerate(_TRUTHS):
            to.errorbar(
                center[p, e, truth],
                height + (-0.14 if truth else 0.14),
                xerr=ends[:, p, e, truth],
                fmt=marker,
                ms=3.5,
                color=color,
                elinewidth=1.3,
                label=f"of {name} objects",
            )
        to.set_yticks(height, [behaviors[i] for i in e])
        for head in heads:
            to.text(
                -0.01,
                height[head] - 0.9,
                attributes[p[head]],
                weight="bold",
                ha="right",
                va="center",
                fontsize=8,
                transform=to.get_yaxis_transform(),
            )
        to.set(xlim=(-0.02, 1.02), ylim=(height[-1] + 0.7, height[0] - 1.3))
        label = f'probability of "yes", with {MASS_TEXT} interval'
        rest = gap.size - len(pairs)
        if rest:
            label += f"\n(the {len(pairs)} pairs that differ most; {rest} more are not shown)"
        name_axes(to, label, "", grid="x")
        to.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        return to


def predictive(observed: ArrayLike, predicted: ArrayLike) -> Axes:
    """Draw how many of an object's percepts say "yes", and what the model predicts of new objects.

    Columns are observed fractions, of cases (2,n+1) by truth (false, true) and number of "yes" of
    n; points the predicted ones, of S replicates (S,2,n+1), with their intervals. Objects that
    differ gather at both ends, which a model of independent percepts does not predict.
    """
    counts = np.asarray(observed, float)
    drawn = np.asarray(predicted, float)
    x = np.arange(counts.shape[1])
    with axes_to_draw(None) as to:
        for truth, (name, marker, color) in enumerate(_TRUTHS):
            shift = 0.2 if truth else -0.2
            # Replicates have as many cases as were observed, so one total scales both.
            total = max(counts[truth].sum(), 1.0)
            to.bar(
                x + shift,
                counts[truth] / total,
                0.36,
                color=color,
                alpha=0.35,
                label=f"{name}, observed",
            )
            low, middle, high = np.quantile(
                drawn[:, truth] / total, [LOW_QUANTILE, 0.5, HIGH_QUANTILE], axis=0
            )
            to.errorbar(
                x + shift,
                middle,
                yerr=[middle - low, high - middle],
                fmt=marker,
                ms=4,
                color=color,
                capsize=2.5,
                elinewidth=1.1,
                label=f"{name}, predicted",
            )
        to.set_xticks(x)
        name_axes(to, f'percepts of {x[-1]} that say "yes"', "fraction of cases", grid="y")
        legend(to, 4)
        return to


def _scale_costs(ax: Axes, means: Sequence[float]) -> None:
    """Set a log scale where one cost is far above the rest; it is linear below 1 s, to hold 0."""
    if max(means) > _WIDE * np.median(means):
        ax.set_xscale("symlog", linthresh=1.0, linscale=0.5)
        ax.xaxis.set_major_formatter("{x:g}")
        ax.set_xlim(left=-_BESIDE_0, right=1.5 * ax.get_xlim()[1])
    else:
        ax.set_xlim(left=-_BESIDE_0 * ax.get_xlim()[1])


def error_lengths(intervals: Sequence[Interval]) -> NDArray[np.float64]:
    """Return how far intervals go below and above their estimates, (2,n); 0 where unknown."""
    middle, _, low, high = np.transpose(intervals)
    # An interval of a fraction may leave its estimate out by rounding; lengths are never negative.
    return np.asarray(np.nan_to_num(np.clip([middle - low, high - middle], 0, None)))

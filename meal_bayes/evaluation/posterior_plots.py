"""Figures of a posterior: intervals of its rows, and whether it predicts the data."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.evaluation.canvas import COLORS, Axes, axes_to_draw, legend, name_axes

_TRUTHS = (("false", "s"), ("true", "o"))  # and their markers
_MOST = 40  # rows that fit a page
_ROW = 0.19  # inches


def forest(
    middle: ArrayLike,
    low: ArrayLike,
    high: ArrayLike,
    attributes: Sequence[str],
    behaviors: Sequence[str],
    *,
    most: int = _MOST,
    ax: Axes | None = None,
) -> Axes:
    """Draw Pr(yes) of true and of false objects, each with its interval.

    One row a pair; attributes stay together, the behavior with the largest difference first.
    Where there are more than `most` pairs, those with the largest differences are drawn.

    Parameters
    ----------
    middle, low, high : ArrayLike
        (P,E,2) Pr(yes | false), Pr(yes | true), and the ends of their intervals.
    """
    center, ends = np.asarray(middle, float), np.stack([np.asarray(low), np.asarray(high)], -1)
    gap = center[..., 1] - center[..., 0]
    pairs = sorted(np.ndindex(gap.shape), key=lambda pair: -gap[pair])[:most]
    pairs.sort(key=lambda pair: (pair[0], -gap[pair]))
    heads = [n for n, pair in enumerate(pairs) if n == 0 or pairs[n - 1][0] != pair[0]]
    place = np.arange(len(pairs)) + 0.9 * np.searchsorted(heads, np.arange(len(pairs)), "right")
    with axes_to_draw(ax, height=1.1 + _ROW * (place[-1] + 1)) as to:
        for truth, (name, marker) in enumerate(_TRUTHS):
            x = np.array([center[pair][truth] for pair in pairs])
            reach = np.array([np.abs(ends[pair][truth] - center[pair][truth]) for pair in pairs])
            shift = 0.14 if truth else -0.14
            to.errorbar(
                x, place - shift, xerr=reach.T, fmt=marker, ms=3.5, color=COLORS[1 - truth],
                elinewidth=1.3, label=f"of {name} objects",
            )  # fmt: skip
        to.set_yticks(place, [behaviors[e] for _, e in pairs])
        for head in heads:
            name = attributes[pairs[head][0]]
            to.text(-0.01, place[head] - 0.9, name, weight="bold", ha="right", va="center",
                    fontsize=8, transform=to.get_yaxis_transform())  # fmt: skip
        to.set(xlim=(-0.02, 1.02), ylim=(place[-1] + 0.7, place[0] - 1.3))
        label = 'probability of "yes", with 95 % interval'
        if rest := gap.size - len(pairs):
            label += f"\n(the {len(pairs)} pairs that differ most; {rest} more are not shown)"
        name_axes(to, label, "", grid="x")
        to.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=2)
        return to


def predictive(observed: ArrayLike, predicted: ArrayLike, *, ax: Axes | None = None) -> Axes:
    """Draw how many of an object's percepts say "yes", and what the model predicts of new objects.

    Columns are observed fractions; points the predicted ones with 95 % intervals. Objects that
    differ gather at both ends, which a model of independent percepts does not predict.

    Parameters
    ----------
    observed : ArrayLike
        (2,n+1) cases by truth (false, true) and number of "yes" of n.
    predicted : ArrayLike
        (S,2,n+1) replicates.
    """
    counts, drawn = np.asarray(observed, float), np.asarray(predicted, float)
    x = np.arange(counts.shape[1])
    with axes_to_draw(ax) as to:
        for truth, (name, marker) in enumerate(_TRUTHS):
            color, shift = COLORS[1 - truth], 0.2 if truth else -0.2
            total = max(counts[truth].sum(), 1.0)
            to.bar(x + shift, counts[truth] / total, 0.36, color=color, alpha=0.35,
                   label=f"{name}, observed")  # fmt: skip
            low, middle, high = np.quantile(drawn[:, truth] / total, [0.025, 0.5, 0.975], axis=0)
            to.errorbar(
                x + shift, middle, yerr=[middle - low, high - middle], fmt=marker, ms=4,
                color=color, capsize=2.5, elinewidth=1.1, label=f"{name}, predicted",
            )  # fmt: skip
        to.set_xticks(x)
        name_axes(to, f'percepts of {x[-1]} that say "yes"', "fraction of cases", grid="y")
        legend(to, 4)
        return to

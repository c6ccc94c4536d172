"""Figures: one function each, from arrays or trials to Axes; the only module that draws.

Every function draws into `ax`, or into a figure of its own, and returns the Axes; `save` writes it.
Colors are Okabe and Ito's, which color-blind readers tell apart. No pyplot, no settings left.
"""

import contextlib
import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.display import level_names
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.statistics import Interval, wilson_interval
from meal_bayes.files import write_whole

__all__ = [
    "COLORS", "Axes", "Series", "bars", "behavior_use", "belief_trace", "confusion_matrices",
    "cost_distribution", "heat_map", "learning_curve", "lines", "reliability_diagram", "save", "svg"
]  # fmt: skip
COLORS = (
    "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9", "#000000", "#B7A500"
)  # fmt: skip
_MARKERS = ("o", "s", "^", "D", "v", "P", "X", "*")
_GRAY = "#7A7A7A"
_MANY = 25  # points on a line, beyond which markers would only blot it
_FORMATS = (".png", ".pdf", ".svg")
_STYLE: Any = {  # names of matplotlib's settings
    "text.parse_math": False,  # names are data: a dollar sign in them is a dollar sign
    **dict.fromkeys(("axes.spines.top", "axes.spines.right", "legend.frameon"), False),
    **dict.fromkeys(("xtick.labelsize", "ytick.labelsize", "legend.fontsize"), 8),
    **dict.fromkeys(("axes.labelsize", "font.size"), 9),
    "axes.titlesize": 10,
    "axes.axisbelow": True,
    "font.family": "sans-serif",
    "svg.fonttype": "path",  # looks the same where the font is missing
    "svg.hashsalt": "meal_bayes",  # equal figures are equal files
    "pdf.fonttype": 42,
}


@dataclass(frozen=True, slots=True)
class Series:
    """One line and, where it is known, the band of its error."""

    name: str
    x: NDArray[np.float64]  # (n,)
    y: NDArray[np.float64]  # (n,) nan = a gap
    low: NDArray[np.float64] | None = None  # (n,)
    high: NDArray[np.float64] | None = None  # (n,)

    def __post_init__(self) -> None:
        shape = np.shape(self.x)
        for name in ("x", "y", "low", "high"):
            values = getattr(self, name)
            if values is None:
                continue
            if np.shape(values) != shape or len(shape) != 1:
                raise SettingsError(
                    f"Series {self.name!r}: {name} has shape {np.shape(values)}, x has {shape}; "
                    "give lists of one length."
                )
            set_frozen(self, **{name: freeze(values)})
        if (self.low is None) != (self.high is None):
            raise SettingsError(f"Series {self.name!r}: give both ends of its band, or none.")


def lines(
    series: Sequence[Series],
    *,
    x_label: str,
    y_label: str,
    share: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw lines with error bands over x (as Fig. 9); a `share` is drawn on 0 to 1.

    Labels are given with their units, as "cost, s".
    """
    with _axes(ax) as to:
        for number, one in enumerate(series):
            color = COLORS[number % len(COLORS)]
            marker = _MARKERS[number % len(_MARKERS)] if len(one.x) <= _MANY else None
            to.plot(one.x, one.y, color=color, marker=marker, ms=4, lw=1.6, label=one.name)
            if one.low is not None and one.high is not None:
                to.fill_between(one.x, one.low, one.high, color=color, alpha=0.18, lw=0)
        _finish(to, x_label, y_label)
        if share:
            to.set_ylim(-0.02, 1.02)
        _legend(to, len(series))
        return to


def learning_curve(
    series: Sequence[Series],
    *,
    x_label: str = "exploration, h",
    y_label: str = "accuracy",
    ax: Axes | None = None,
) -> Axes:
    """Draw accuracy over the hours of exploration behind it, one line an agent (Figs. 10, 11)."""
    ax = lines(series, x_label=x_label, y_label=y_label, ax=ax)
    ax.set_ylim(max(ax.get_ylim()[0], -0.02), min(ax.get_ylim()[1], 1.02))
    return ax


def bars(
    groups: Mapping[str, Sequence[Interval]],
    names: Sequence[str],
    *,
    y_label: str,
    reference: Sequence[float] | None = None,
    reference_name: str = "paper",
    share: bool = False,
    ax: Axes | None = None,
) -> Axes:
    """Draw estimates with their intervals as bars side by side (as Fig. 8).

    Parameters
    ----------
    groups : for each color an interval for each name; one group stands without a legend.
    names : under the bars.
    reference : for each name a figure to compare with, nan where there is none.
    """
    with _axes(ax) as to:
        width, single = 0.8 / max(len(groups), 1), len(groups) == 1
        place = np.arange(len(names))
        for number, (group, found) in enumerate(groups.items()):
            if len(found) != len(names):
                raise SettingsError(f"{group!r} has {len(found)} intervals for {len(names)} names.")
            at = place + (number - (len(groups) - 1) / 2) * width
            colors = [COLORS[i % len(COLORS)] for i in place] if single else COLORS[number % 8]
            heights = np.array([one.estimate for one in found])
            to.bar(at, heights, width * 0.9, color=colors, label=None if single else group)
            reach = np.array([[one.estimate - one.low, one.high - one.estimate] for one in found])
            to.errorbar(
                at, heights, np.nan_to_num(reach.clip(0)).T, fmt="none", ecolor="#222222",
                elinewidth=1.1, capsize=2.5,
            )  # fmt: skip
        if reference is not None:
            to.plot(place, reference, "D", mfc="white", mec="black", ms=5, label=reference_name)
        crowded = sum(map(len, names)) > 48  # letters that fit side by side
        turn: dict[str, Any] = (
            {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if crowded else {}
        )
        to.set_xticks(place, names, **turn)
        _finish(to, "", y_label, grid="y")
        if share:
            to.set_ylim(0, 1.04)
        _legend(to, (0 if single else len(groups)) + (reference is not None) + 1)
        return to


def reliability_diagram(
    positive: ArrayLike, truth: ArrayLike, *, bins: int = 10, ax: Axes | None = None
) -> Axes:
    """Draw how often attributes believed in with b are true, with Wilson's 95 % intervals.

    Points on the diagonal are calibrated; gray columns are the share of beliefs in each bin.
    `positive` is (n,) Pr(attribute is true), `truth` (n,) bool.
    """
    b, true = np.asarray(positive, float), np.asarray(truth, bool)
    if b.shape != true.shape or b.ndim != 1 or len(b) == 0:
        raise SettingsError(f"{b.shape} beliefs and {true.shape} truths; give one for each.")
    index = np.minimum((b * bins).astype(np.intp), bins - 1)
    n, hits = np.bincount(index, minlength=bins), np.bincount(index[true], minlength=bins)
    filled = np.flatnonzero(n)
    with _axes(ax, width=3.4, height=3.4) as to:
        edges = np.arange(bins) / bins
        to.bar(edges, n / len(b), 1 / bins, align="edge", color="#E3E3E3", label="share of beliefs")
        to.plot([0, 1], [0, 1], color=_GRAY, lw=1, ls="--", label="calibrated")
        found = [wilson_interval(int(hits[i]), int(n[i])) for i in filled]
        mean = np.array([b[index == i].mean() for i in filled])
        reach = np.array([[f.estimate - f.low, f.high - f.estimate] for f in found])
        to.errorbar(
            mean, [f.estimate for f in found], reach.T, fmt="o", ms=4.5, color=COLORS[0],
            capsize=2, elinewidth=1, label="share that is true",
        )  # fmt: skip
        _finish(to, "belief that the attribute is true", "share that is true")
        to.set(xlim=(0, 1), ylim=(0, 1.02), aspect="equal")
        _legend(to, 3)
        return to


def heat_map(
    values: ArrayLike,
    x: Sequence[object],
    y: Sequence[object],
    *,
    x_label: str,
    y_label: str,
    value_label: str,
    digits: int = 2,
    ax: Axes | None = None,
) -> Axes:
    """Draw a table (len(y), len(x)) as colors with its numbers in them (as Fig. 12)."""
    table = np.asarray(values, float)
    if table.shape != (len(y), len(x)):
        raise SettingsError(f"{table.shape} values; expected ({len(y)}, {len(x)}), as y and x.")
    with _axes(ax) as to:
        image = to.imshow(table, cmap="viridis", origin="lower", aspect="auto")
        _numbers(to, table, image, digits)
        to.set_xticks(range(len(x)), [str(one) for one in x])
        to.set_yticks(range(len(y)), [str(one) for one in y])
        to.set(xlabel=x_label, ylabel=y_label)
        to.figure.colorbar(image, ax=to, label=value_label)
        return to


def confusion_matrices(
    confusion: ArrayLike,
    attributes: Sequence[str],
    *,
    sd: ArrayLike | None = None,
    title: str = "",
    ax: Axes | None = None,
) -> Axes:
    """Draw one behavior's matrices (N,2,K), rows = truth; their sd is printed under the means."""
    table = np.asarray(confusion, float)
    n, _, k = table.shape
    rows, spread = table.reshape(2 * n, k), None if sd is None else np.reshape(sd, (2 * n, k))
    with _axes(ax, height=1.2 + 0.5 * len(rows)) as to:
        image = to.imshow(rows, cmap="viridis", vmin=0, vmax=1, aspect="auto")
        _numbers(to, rows, image, 2, spread)
        to.set_xticks(range(k), level_names(k))
        names = [f"{word}{name}" for name in attributes for word in ("not ", "")]
        to.set_yticks(range(len(rows)), names)
        to.set(xlabel="percept", ylabel="truth", title=title)
        to.hlines(np.arange(1, n) * 2 - 0.5, -0.5, k - 0.5, color="white", lw=3)
        to.figure.colorbar(image, ax=to, label="probability")
        return to


def belief_trace(trial: Trial, *, ax: Axes | None = None) -> Axes:
    """Draw a trial's beliefs after every step, over the behaviors in order; circles are truths."""
    beliefs = [trial.first_belief, *(step.belief for step in trial.steps)]
    positive = np.array([belief.positive for belief in beliefs])  # (T+1,N)
    e, names = trial.momdp.n_behaviors, trial.momdp.behavior_names
    actions = [step.decision.action for step in trial.steps]
    with _axes(ax) as to:
        for i, attribute in enumerate(trial.task.query.attributes):
            color, marker = COLORS[i % len(COLORS)], _MARKERS[i % len(_MARKERS)]
            to.plot(positive[:, i], color=color, marker=marker, ms=4, lw=1.6, label=attribute)
            at = (len(beliefs) - 0.88, trial.truth[i] if trial.truth[i] >= 0 else np.nan)
            to.plot(*at, "o", mfc="none", mec=color, ms=9, clip_on=False)
        to.axhline(0.5, color=_GRAY, lw=0.8, ls=":")
        labels = ["prior", *(names[a] if a < e else "report" for a in actions)]
        to.set_xticks(range(len(labels)), labels, rotation=35, ha="right", rotation_mode="anchor")
        _finish(to, "", "belief that it is true", grid="y")
        to.set(ylim=(-0.04, 1.04), xlim=(-0.2, len(labels) - 0.6))
        _legend(to, max(len(trial.truth), 2))
        return to


def behavior_use(
    groups: Mapping[str, Sequence[float]], behaviors: Sequence[str], *, ax: Axes | None = None
) -> Axes:
    """Draw how often a trial executes each behavior, in the mean, one color an agent."""
    with _axes(ax, height=0.9 + 0.22 * len(behaviors) * max(len(groups), 1) ** 0.6) as to:
        place, width = np.arange(len(behaviors)), 0.8 / max(len(groups), 1)
        for number, (group, used) in enumerate(groups.items()):
            at = place + (number - (len(groups) - 1) / 2) * width
            to.barh(at, used, width * 0.9, color=COLORS[number % len(COLORS)], label=group)
        to.set_yticks(place, behaviors)
        to.invert_yaxis()
        _finish(to, "executions a trial", "", grid="x")
        _legend(to, len(groups))
        return to


def cost_distribution(groups: Mapping[str, ArrayLike], *, ax: Axes | None = None) -> Axes:
    """Draw the share of trials that cost at most so much, one step line an agent."""
    with _axes(ax) as to:
        for number, (group, costs) in enumerate(groups.items()):
            color = COLORS[number % len(COLORS)]
            to.ecdf(np.asarray(costs, float), compress=True, color=color, lw=1.6, label=group)
        _finish(to, "cost of a trial, s", "share of trials")
        to.set_ylim(0, 1.02)
        _legend(to, len(groups))
        return to


def save(ax: Axes, path: str | Path) -> Path:
    """Write the figure of an Axes as PNG, PDF or SVG, as the name ends; equal ones equally."""
    path = Path(path)
    if path.suffix not in _FORMATS:
        raise SettingsError(f"A figure's name ends in .png, .pdf or .svg; found {path.name!r}.")
    write_whole(path, _drawn(ax, path.suffix[1:]))
    return path


def svg(ax: Axes) -> str:
    """Give the figure of an Axes as SVG text."""
    return _drawn(ax, "svg").decode()


def _drawn(ax: Axes, kind: str) -> bytes:
    dates = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
    buffer = io.BytesIO()
    figure = cast("Figure", ax.get_figure(root=True))
    with mpl.rc_context(_STYLE):
        figure.savefig(buffer, format=kind, dpi=160, metadata=dates[kind])
    return buffer.getvalue()


@contextlib.contextmanager
def _axes(ax: Axes | None, *, width: float = 4.8, height: float = 2.9) -> Iterator[Axes]:
    """Give the Axes to draw into, in our style while the block runs."""
    with mpl.rc_context(_STYLE):
        if ax is None:
            figure = Figure(figsize=(width, height))
            figure.set_layout_engine("constrained")
            FigureCanvasAgg(figure)
            ax = figure.subplots()
        yield ax


def _finish(ax: Axes, x_label: str, y_label: str, *, grid: str = "both") -> None:
    ax.set(xlabel=x_label, ylabel=y_label)
    ax.grid(axis=grid, color="#E6E6E6", lw=0.7)  # type: ignore[arg-type]
    ax.tick_params(length=2.5)


def _legend(ax: Axes, count: int) -> None:
    if count > 1:
        ax.legend(loc="best", ncols=1 if count < len(COLORS) else 2)


def _numbers(ax: Axes, table: NDArray[np.float64], image: Any, digits: int, sd: Any = None) -> None:
    """Write the numbers into an image, light on dark and dark on light."""
    low, high = image.get_clim()
    small = 8 if table.size <= 64 else 6  # cells
    for (row, column), value in np.ndenumerate(table):
        if not np.isfinite(value):
            continue
        light = value < low + 0.6 * (high - low)
        text = f"{value:.{digits}f}" + ("" if sd is None else f"\n± {sd[row, column]:.{digits}f}")
        color = "white" if light else "black"
        ax.text(column, row, text, ha="center", va="center", color=color, fontsize=small)

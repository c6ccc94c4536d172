"""Axes in one style, their legend, and files of them; what all figures are drawn on.

Colors are those of `palette.py`. No pyplot, no global state.
"""

import contextlib
import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any, cast

import matplotlib as mpl
from matplotlib import axes
from matplotlib.figure import Figure

from meal_bayes.errors import SettingsError
from meal_bayes.files import checked_path, write_whole

Axes = axes.Axes
_ONE_COLUMN = 8  # entries, from which on a legend in the axes has two
_WITHOUT_DATE = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
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


def drawn_in_style() -> contextlib.AbstractContextManager[None]:
    """Return a context in which figures have our style."""
    return mpl.rc_context(_STYLE)


@contextlib.contextmanager
def axes_to_draw(ax: Axes | None, *, width: float = 4.8, height: float = 2.9) -> Iterator[Axes]:
    """Yield `ax`, or the Axes of a new figure (inches), in our style while the block runs."""
    with drawn_in_style():
        if ax is None:
            ax = Figure(figsize=(width, height), layout="constrained").subplots()
        yield ax


def name_axes(ax: Axes, x_label: str, y_label: str, *, grid: str = "both") -> None:
    """Set the labels, with a grid along "x", "y" or "both"."""
    ax.set(xlabel=x_label, ylabel=y_label)
    ax.grid(axis=grid, color="#E6E6E6", lw=0.7)  # type: ignore[arg-type]
    ax.tick_params(length=2.5)


def legend(ax: Axes, count: int, *, above: bool = False) -> None:
    """Add the legend of more than one entry, `above` the axes or in them."""
    if count > 1 and above:
        rows = -(-count // 4)
        columns = -(-count // rows)  # so that rows are of like length
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, columnspacing=1.0)
    elif count > 1:
        ax.legend(loc="best", ncols=1 if count < _ONE_COLUMN else 2)


def save(ax: Axes, path: str | Path) -> Path:
    """Write the figure of an Axes as PNG, PDF or SVG, as the name ends; equal ones equally."""
    path = checked_path("The figure", path)
    check_figure_name(path)
    write_whole(path, render(ax, path.suffix[1:]))
    return path


def check_figure_name(path: Path) -> None:
    """Raise a `SettingsError` unless a name ends in .png, .pdf or .svg."""
    if path.suffix[1:] not in _WITHOUT_DATE:
        raise SettingsError(f"A figure's name ends in .png, .pdf or .svg; found {path.name!r}.")


def render(ax: Axes, kind: str, *, transparent: bool = False) -> bytes:
    """Return the figure of an Axes as a file of a kind: "png", "pdf" or "svg"."""
    buffer = io.BytesIO()
    figure = cast("Figure", ax.get_figure(root=True))
    with drawn_in_style():
        figure.savefig(
            buffer, format=kind, dpi=160, metadata=_WITHOUT_DATE[kind], transparent=transparent
        )
    return buffer.getvalue()

"""How everything looks: texts, tables in HTML, colors of names, and the style of figures.

A color belongs to a name, never to a place in a list, so that one agent looks the same wherever it
is drawn. Colors of agents and of attributes are Okabe and Ito's, which color-blind readers can
distinguish, and never share a picture; levels of percepts have colors that nothing else has.
Figures are drawn without pyplot and under matplotlib's defaults, whatever a user has set.
"""

import contextlib
import dataclasses
import io
import math
import sys
import warnings
import zlib
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextvars import ContextVar
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.files import checked_path, write_whole

if TYPE_CHECKING:
    from meal_bayes.canvas import Axes, Figure

# Texts

_PACKAGE = str(Path(__file__).parent)
_LONGEST = 60  # characters of one value
_NAMED = 6  # items of a sequence that are written out
_BAR = "display:inline-block;height:.7em;width:{:.0f}px;background:{}"
_WIDTH = 80  # pixels of a whole bar
_COLOR = "#4878a8"
_CELL = "text-align:left;padding-right:1em;white-space:nowrap"
_ROUNDED = 0.0005  # probabilities nearer to 0 or 1 would print as certain
AMOUNT = ".1f"  # format of seconds and rewards, everywhere
FRACTION = ".3f"  # format of accuracies, in tables
ERROR_TEXT = "± one standard error"  # what `error_text` shows, in legends
_HELD_WARNINGS: ContextVar[list[str] | None] = ContextVar("held warnings", default=None)
_LEVELS = {2: ("no", "yes"), 4: ("surely no", "no", "yes", "surely yes")}


def short_repr(instance: Any) -> str:
    """Return a dataclass with its arrays as dtype and shape; written as ``__repr__ = short_repr``.

    >>> from meal_bayes.domain import Query
    >>> short_repr(Query(("red", "empty")))
    "Query(attributes=('red', 'empty'))"
    """
    fields = (field for field in dataclasses.fields(instance) if field.repr)
    values = (f"{field.name}={short(getattr(instance, field.name))}" for field in fields)
    return f"{type(instance).__name__}({', '.join(values)})"


def short(value: object) -> str:
    """Return a value in at most 60 characters or so.

    >>> short(np.zeros((3, 2))), short(tuple("abcdefgh"))
    ('float64[3, 2]', "('a', 'b', 'c', ... 8 in all)")
    """
    if isinstance(value, np.ndarray):
        return f"{value.dtype}{list(value.shape)}"
    if isinstance(value, Mapping):
        return f"{{{len(value)} entries}}"
    if isinstance(value, tuple | list) and len(value) > _NAMED:
        first = ", ".join(map(short, value[: _NAMED // 2]))
        return f"({_cut(first)}, ... {len(value)} in all)"
    if dataclasses.is_dataclass(value):
        name = getattr(value, "name", None)
        return f"{type(value).__name__}({_cut(repr(name)) if isinstance(name, str) else '...'})"
    return _cut(repr(value))


def _cut(text: str) -> str:
    return text if len(text) <= _LONGEST else f"{text[: _LONGEST - 3]}..."


def listed(names: Sequence[str], most: int = _NAMED) -> str:
    """Return names as a comma list, the first of them where there are many.

    >>> listed(["look", "lift", "push"], most=2)
    'look, lift, ... (3 in all)'
    """
    more = f", ... ({len(names)} in all)" if len(names) > most else ""
    return ", ".join(names[:most]) + more


def facts_repr(instance: Any) -> str:
    """Return an object's `_facts`, title and facts, as text; written as `__repr__ = facts_repr`."""
    return card(*instance._facts())


def card(title: str, facts: Mapping[str, str]) -> str:
    """Return a title and its facts, a line each, in two columns."""
    width = max(map(len, facts), default=0)
    return "\n".join([title, *(f"  {name:<{width}}  {text}" for name, text in facts.items())])


def table_html(title: str, header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return an HTML table; cells are HTML already, title and header are text."""
    head = "".join(f"<th style='{_CELL}'>{escape(name)}</th>" for name in header)
    body = "".join(
        "<tr>" + "".join(f"<td style='{_CELL}'>{cell}</td>" for cell in row) + "</tr>"
        for row in rows
    )
    return (
        f"<table><caption style='text-align:left;caption-side:top'><b>{escape(title)}</b></caption>"
        f"{f'<thead><tr>{head}</tr></thead>' if head else ''}<tbody>{body}</tbody></table>"
    )


def json_value(value: Any) -> Any:
    """Return a value for JSON, with None for each number in it that is NaN or infinite.

    >>> json_value({"reward": float("nan"), "trials": (3, 4.5)})
    {'reward': None, 'trials': [3, 4.5]}
    """
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {name: json_value(part) for name, part in value.items()}
    return list(map(json_value, value)) if isinstance(value, list | tuple) else value


def percent(probability: float) -> str:
    """Return a probability as a percentage, but never as certain.

    >>> percent(0.5), percent(1 - 1e-9)
    ('50.0 %', '>99.9 %')
    """
    # A belief is never certain, and "100.0 %" would say so.
    if 0 < probability < _ROUNDED or 1 - _ROUNDED < probability < 1:
        return "<0.1 %" if probability < _ROUNDED else ">99.9 %"
    return f"{100 * probability:.1f} %"


def error_text(error: float, form: str = AMOUNT) -> str:
    """Return the standard error of a value, to stand behind it.

    It is empty where it would print as 0, and where it is not known.

    >>> error_text(0.42), error_text(0.04), error_text(0.04, ".2f"), error_text(np.nan)
    ('±0.4', '', '±0.04', '')
    """
    digits = f"{error:{form}}"
    return f"±{digits}" if math.isfinite(error) and float(digits) > 0 else ""


def estimate_text(estimate: float, error: float) -> str:
    """Return an amount with its standard error.

    >>> estimate_text(483.2, 1.84), estimate_text(483.2, 0.0)
    ('483.2 ±1.8', '483.2')
    """
    return f"{estimate:{AMOUNT}} {error_text(error)}".rstrip()


def bar_html(probability: float) -> str:
    """Return a bar of a probability, with its number, as HTML."""
    full = _BAR.format(_WIDTH * probability, _COLOR)
    rest = _BAR.format(_WIDTH * (1 - probability), "#dde3ea")
    number = percent(probability).replace(" ", "&nbsp;")
    return f"<span style='{full}'></span><span style='{rest}'></span>&nbsp;{number}"


def level_names(levels: int) -> tuple[str, ...]:
    """Return the names of the K levels of a percept, the surest "no" first.

    >>> level_names(4)
    ('surely no', 'no', 'yes', 'surely yes')
    """
    return _LEVELS.get(levels) or tuple(f"level {k}" for k in range(levels))


def best_options(values: NDArray[np.float64], chosen: int, most: int) -> list[int]:
    """Return the positions of the most valuable actions, best first, of values (E+1,).

    Those are of each behavior, then of the best report; nan where an action has none. The report
    and the chosen action are always among them.

    >>> best_options(np.array([1.0, 4.0, np.nan, 3.0, 2.0]), chosen=0, most=3)
    [1, 4, 0]
    """
    # The report is the last of the values, and always shown: what others are compared with.
    end = len(values) - 1
    valued = np.flatnonzero(~np.isnan(values[:end])).tolist()
    best = sorted(valued, key=lambda e: -values[e])[: most - 1]
    if chosen in valued and chosen not in best:
        best[-1] = chosen
    if not np.isnan(values[end]):
        best.append(end)
    return sorted(best, key=lambda e: -values[e])


def warn_user(text: str) -> None:
    """Warn of something that a user can change.

    From Python 3.12 on the warning names the user's own line, before that the line that called
    the function which warns.
    """
    held = _HELD_WARNINGS.get()
    if held is not None:
        held.append(text)
    elif sys.version_info >= (3, 12):
        warnings.warn(text, skip_file_prefixes=(_PACKAGE,))
    else:
        warnings.warn(text, stacklevel=3)


@contextlib.contextmanager
def holding_warnings() -> Iterator[list[str]]:
    """Yield the texts of which `warn_user` would warn in the block, in this thread.

    Filters of warnings are those of the thread that a user sees, so it is to warn of them there.

    >>> with holding_warnings() as texts:
    ...     warn_user("A person reads this later.")
    >>> texts
    ['A person reads this later.']
    """
    texts = list[str]()
    token = _HELD_WARNINGS.set(texts)
    try:
        yield texts
    finally:
        _HELD_WARNINGS.reset(token)


# Colors

BLUE = "#0072B2"
SKY = "#56B4E9"
VERMILION = "#D55E00"
ORANGE = "#E69F00"
GREEN = "#009E73"
PINK = "#CC79A7"
VIOLET = "#8866CC"
GRAY = "#999999"
LINE_GRAY = "#7A7A7A"  # of axes through zero and of intervals beside those that are judged
INK = "#444444"
BLACK = "#000000"
WHITE = "#ffffff"
# Of the viewer, to be seen on dark and on light grounds: boxes, and what stands behind them; texts.
MID_GRAY = "#808080"
DIM_GRAY = "#606060"
TEXT_GRAY = "#969696"
ATTRIBUTES = (BLUE, VERMILION, GREEN, PINK, ORANGE, SKY, VIOLET, "#B7A500")
LEVELS = ("#5E3C99", "#B2ABD2", "#FDB863", "#E66101")  # from the surest "no" to the surest "yes"
READABLE = 4.5  # contrast of text with its ground, at least
GROUNDS = ("#f5f6f8", "#1e2430")  # of light and of dark pages: the one nearest to the text's colors


class Style(NamedTuple):
    """How an agent is drawn: color, marker and line, by the names that matplotlib has for them."""

    color: str
    marker: str
    dash: str = "-"


# In the order in which tables and legends name them: the paper's first, then ours. No two agents
# have the same marker and color, nor the same line and color.
_AGENTS = {
    "morc": Style(VERMILION, "^"),
    "iterative_morc": Style(VERMILION, "<", "--"),
    "morc_itrs": Style(ORANGE, "v"),
    "iterative_random_legal": Style(INK, "+"),
    "random": Style(GRAY, "x"),
    "random_legal": Style(INK, "1", "-."),
    "predefined": Style(GREEN, "D", "--"),
    "predefined_plus": Style(GREEN, "P"),
    "greedy": Style(PINK, ">"),
    "olfc": Style(PINK, "X", "--"),
    "bayes": Style(BLUE, "o"),
    "bayes_itrs": Style(BLUE, "8", ":"),
    "bayes_no_bonus": Style(BLUE, "p", "--"),
    "bayes_memory": Style(SKY, "s"),
    "prior": Style(MID_GRAY, "h", ":"),
}
_FAMILIES = {  # of variants, whose names begin like these
    "iterative_morc": Style(VERMILION, "4", "-."),
    "morc_itrs": Style(ORANGE, "d", "--"),
    "morc": Style(VERMILION, "3", ":"),
    "bayes_memory": Style(SKY, "d", "--"),
    "bayes": Style(BLUE, "H", "-."),
    "iterative_random": Style(INK, "2", "--"),
    "random": Style(GRAY, "2", "--"),
    "predefined": Style(GREEN, "d", ":"),
    "greedy": Style(PINK, "4", ":"),
    "olfc": Style(PINK, "d", "-."),
}
_OWN = (VIOLET, BLACK)  # of people's own agents
_OWN_DASHES = ("-", "--", "-.", ":")
_OWN_MARKERS = ("*", "p", "h", "8")
REFERENCES = ("morc", "iterative_morc")  # the paper's, which others are compared with


def agent_style(name: str) -> Style:
    """Return how an agent is drawn, whatever else is drawn beside it.

    >>> agent_style("bayes").color, agent_style("bayes_no_bonus").dash
    ('#0072B2', '--')
    """
    if name in _AGENTS:
        return _AGENTS[name]
    for family, style in _FAMILIES.items():
        if name.startswith(f"{family}_"):
            return style
    number = zlib.crc32(name.encode())  # of the name alone, the same in every process
    dash = _OWN_DASHES[number // 2 % len(_OWN_DASHES)]
    return Style(_OWN[number % 2], _OWN_MARKERS[number // 8 % len(_OWN_MARKERS)], dash)


def ordered_agents(names: Iterable[str]) -> list[str]:
    """Return agents in the order of tables: the paper's, baselines, ours, people's own by name.

    >>> ordered_agents(["mine", "bayes", "morc"])
    ['morc', 'bayes', 'mine']
    """
    order = list(_AGENTS)

    def place(name: str) -> tuple[int, str]:
        family = next((prefix for prefix in _FAMILIES if name.startswith(f"{prefix}_")), "")
        near = name if name in _AGENTS else family
        return (order.index(near) if near in _AGENTS else len(order), name)

    return sorted(dict.fromkeys(names), key=place)


def reference_agent(names: Iterable[str]) -> str:
    """Return the agent that others are compared with: the paper's, else the first that is named.

    >>> reference_agent(["bayes", "random", "morc"]), reference_agent(["mine", "greedy"])
    ('morc', 'mine')
    """
    present = list(names)
    return next((name for name in REFERENCES if name in present), present[0])


def attribute_color(place: int) -> str:
    """Return the color of the attribute at a place of a question."""
    return ATTRIBUTES[place % len(ATTRIBUTES)]


def lightened(color: str, part: float = 0.4) -> str:
    """Return a color mixed with white, for a dark ground.

    >>> lightened("#0072B2")
    '#66aad1'
    """
    channels = (int(color[at : at + 2], 16) for at in (1, 3, 5))
    return "#" + "".join(f"{round(c + part * (255 - c)):02x}" for c in channels)


def contrast(first: str, second: str) -> float:
    """Return the contrast ratio of two colors as WCAG 2 has it, 1 to 21.

    >>> contrast("#000000", "#ffffff"), round(contrast("#D55E00", "#ffffff"), 1)
    (21.0, 3.9)
    """
    low, high = sorted((_luminance(first), _luminance(second)))
    return (high + 0.05) / (low + 0.05)


def _luminance(color: str) -> float:
    parts = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    linear = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return sum(weight * c for weight, c in zip((0.2126, 0.7152, 0.0722), linear, strict=True))


def readable(color: str, *, dark: bool = False) -> str:
    """Return a color in which text is read on any page, mixed with black, or white on a dark one.

    The contrast with the page is at least 4.5 to 1, as WCAG 2 asks of text (AA).

    >>> readable("#000000"), readable("#D55E00")
    ('#000000', '#b55000')
    """
    ground = GROUNDS[dark]
    for part in range(0, 100, 5):
        if dark:
            mixed = lightened(color, part / 100)
        else:
            channels = (int(color[at : at + 2], 16) for at in (1, 3, 5))
            mixed = "#" + "".join(f"{round(c * (1 - part / 100)):02x}" for c in channels)
        if contrast(mixed, ground) >= READABLE:
            return mixed
    return WHITE if dark else BLACK


def level_color(level: int, levels: int) -> str:
    """Return the color of one of K levels of a percept, from "surely no" to "surely yes".

    >>> level_color(0, 2), level_color(1, 2)
    ('#5E3C99', '#E66101')
    """
    return LEVELS[round(level * (len(LEVELS) - 1) / max(levels - 1, 1))]


def rgba(color: str) -> tuple[int, int, int, int]:
    """Return a color as red, green, blue and opacity, from 0 to 255, as rerun takes it.

    >>> rgba("#0072B2")
    (0, 114, 178, 255)
    """
    red, green, blue = (int(color[start : start + 2], 16) for start in (1, 3, 5))
    return red, green, blue, 255


# Figures

_ONE_COLUMN = 8  # entries, from which on a legend in the axes has two
_WITHOUT_DATE = {"png": {"Software": None}, "pdf": {"CreationDate": None}, "svg": {"Date": None}}
# Settings that say how matplotlib runs, not how a figure looks.
_NOT_LOOKS = {"backend", "backend_fallback", "interactive", "timezone", "toolbar"}
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


@contextlib.contextmanager
def drawn_in_style() -> Iterator[None]:
    """Draw figures in our style while the block runs, whatever a user's matplotlibrc says."""
    from meal_bayes.canvas import mpl  # noqa: PLC0415  takes half a second

    defaults = {name: mpl.rcParamsDefault[name] for name in mpl.rcParamsDefault}
    ours = {name: value for name, value in defaults.items() if name not in _NOT_LOOKS}
    with mpl.rc_context({**ours, **_STYLE}):
        yield


@contextlib.contextmanager
def axes_to_draw(ax: "Axes | None", *, width: float = 4.8, height: float = 2.9) -> "Iterator[Axes]":
    """Yield `ax`, or the Axes of a new figure (inches), in our style while the block runs."""
    from meal_bayes.canvas import Figure  # noqa: PLC0415  as above

    with drawn_in_style():
        if ax is None:
            ax = Figure(figsize=(width, height), layout="constrained").subplots()
        yield ax


def name_axes(ax: "Axes", x_label: str, y_label: str, *, grid: str = "both") -> None:
    """Set the labels, with a grid along "x", "y" or "both"."""
    ax.set(xlabel=x_label, ylabel=y_label)
    ax.grid(axis=grid, color="#E6E6E6", lw=0.7)  # type: ignore[arg-type]
    ax.tick_params(length=2.5)


def legend(ax: "Axes", count: int, *, above: bool = False) -> None:
    """Add the legend of more than one entry, `above` the axes or in them."""
    if count > 1 and above:
        rows = -(-count // 4)
        columns = -(-count // rows)  # so that rows are of like length
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=columns, columnspacing=1.0)
    elif count > 1:
        ax.legend(loc="best", ncols=1 if count < _ONE_COLUMN else 2)


def save(ax: "Axes", path: str | Path) -> Path:
    """Write the figure of an Axes as PNG, PDF or SVG, as the name ends; equal ones equally."""
    path = checked_path("The figure", path)
    check_figure_name(path)
    write_whole(path, render(ax, path.suffix[1:]))
    return path


def check_figure_name(path: Path) -> None:
    """Raise a `SettingsError` unless a name ends in .png, .pdf or .svg."""
    if path.suffix[1:] not in _WITHOUT_DATE:
        raise SettingsError(f"A figure's name ends in .png, .pdf or .svg; found {path.name!r}.")


def render(ax: "Axes", kind: str, *, transparent: bool = False) -> bytes:
    """Return the figure of an Axes as a file of a kind: "png", "pdf" or "svg"."""
    buffer = io.BytesIO()
    figure = cast("Figure", ax.get_figure(root=True))
    with drawn_in_style():
        figure.savefig(
            buffer, format=kind, dpi=160, metadata=_WITHOUT_DATE[kind], transparent=transparent
        )
    return buffer.getvalue()

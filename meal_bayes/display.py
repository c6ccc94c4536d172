"""Short texts and small HTML tables of our objects, for a terminal and for a notebook."""

import dataclasses
import inspect
import math
import warnings
from collections.abc import Iterable, Mapping, Sequence
from html import escape
from typing import Any

import numpy as np
from numpy.typing import NDArray

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


def facts_html(instance: Any) -> str:
    """Return an object's `_facts` as an HTML table; written as `_repr_html_ = facts_html`."""
    title, facts = instance._facts()
    return table_html(title, (), [(escape(name), escape(text)) for name, text in facts.items()])


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


def best_html(
    title: str, header: Sequence[str], names: Iterable[Sequence[str]], values: NDArray[np.float64]
) -> str:
    """Return a table of names and values (P,E), -inf of none; the largest of each row is bold."""
    rows = []
    for labels, row in zip(names, values, strict=True):
        cells = ["" if np.isinf(value) else f"{value:.2f}" for value in row]
        cells[row.argmax()] = f"<b>{cells[row.argmax()]}</b>"
        rows.append((*map(escape, labels), *cells))
    return table_html(title, header, rows)


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


def estimate_text(estimate: float, error: float, form: str = AMOUNT) -> str:
    """Return an estimate with its standard error.

    >>> estimate_text(483.2, 1.84), estimate_text(483.2, 0.0)
    ('483.2 ±1.8', '483.2')
    """
    return f"{estimate:{form}} {error_text(error, form)}".rstrip()


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


def warn_caller(text: str) -> None:
    """Warn at the line outside of the package that called it: what a user can change is there."""
    package = __name__.partition(".")[0]
    frame = inspect.currentframe()
    level = 0
    while frame is not None and frame.f_globals.get("__name__", "").partition(".")[0] == package:
        frame = frame.f_back
        level += 1
    warnings.warn(text, stacklevel=level + 1)

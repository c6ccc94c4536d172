"""Numbers of a record's tables, as figures need them."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from scipy.special import stdtrit

from meal_bayes.evaluation.statistics import Interval

Record = Mapping[str, Any]
Row = Mapping[str, Any]
UNKNOWN = Interval(np.nan, np.nan, np.nan, np.nan)
TWO_ERRORS = 2.0  # standard errors, where nobody says how many units a mean rests on


def rows_of(table: Mapping[str, Any]) -> list[Row]:
    """Return the rows of a table by the names of its columns."""
    return [dict(zip(table["columns"], row, strict=True)) for row in table["rows"]]


def interval_of(cell: Any, units: int | None = None) -> Interval:
    """Return the estimate and the ends of a cell.

    Parameters
    ----------
    cell : None, a number, [estimate, standard error], or [estimate, low, high] of a fraction.
    units : independent units of a mean, for a 95 % interval by Student's t; without them it
        reaches two standard errors.
    """
    if cell is None or (isinstance(cell, list) and cell[0] is None):
        return UNKNOWN
    if not isinstance(cell, list):
        return Interval(float(cell), 0.0, float(cell), float(cell))
    estimate, *errors = cell
    if len(errors) > 1:
        return Interval(estimate, np.nan, errors[0], errors[1])
    error = errors[0] if errors[0] is not None else np.nan
    reach = error * (TWO_ERRORS if units is None else float(stdtrit(units - 1, 0.975)))
    return Interval(estimate, error, estimate - reach, estimate + reach)


def apart(first: Interval, second: Interval) -> bool:
    """Return whether two intervals have no value in common."""
    return first.low > second.high or second.low > first.high


def joined(words: Sequence[object]) -> str:
    """Join words as in a sentence.

    >>> joined([1, 2, 3])
    '1, 2 and 3'
    """
    *first, last = map(str, words)
    return f"{', '.join(first)} and {last}" if first else last


def leaders(groups: Mapping[object, Mapping[str, Interval]], *, least: bool = False) -> str:
    """Say who has the largest estimate in each group, or the least, and how many come near it.

    Near are those whose interval is not apart from its own.

    >>> one, two = Interval(1.0, 0.1, 0.8, 1.2), Interval(1.1, 0.1, 0.9, 1.3)
    >>> leaders({1: {"morc": one, "random": UNKNOWN}, 2: {"morc": one, "bayes": two}})
    'morc at 1; bayes at 2 (1 not told apart)'
    """
    told: dict[str, list[str]] = {}
    for place, intervals in groups.items():
        measured = {name: span for name, span in intervals.items() if np.isfinite(span.estimate)}
        sign = -1 if least else 1
        best = max(measured, key=lambda name: sign * measured[name].estimate)
        near = sum(
            name != best and not apart(measured[best], span) for name, span in measured.items()
        )
        others = f" ({near} not told apart)" if near else ""
        told.setdefault(best, []).append(f"at {place}{others}")
    return "; ".join(f"{best} {', '.join(places)}" for best, places in told.items())

"""What a page holds: sections of text, tables and figures, as `templates/report.html` shows them.

The page is self-contained: no script, nothing fetched, every text escaped.
"""

from collections.abc import Sequence
from typing import TypedDict

from matplotlib.axes import Axes


class MarkedCell(TypedDict, total=False):
    """A cell that is more than text."""

    text: str
    best: bool  # in bold
    bar: float  # from 0 to 1, beside the text;
    low: float  # its interval, where there is one,
    high: float
    few: bool  # and whether it is of few trials


Cell = str | MarkedCell


class Table(TypedDict, total=False):
    """A table, under its note."""

    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    texts: Sequence[int]  # columns that are aligned as text
    note: str


class Section(TypedDict, total=False):
    """A section of a page, or a part of one; every entry but the title may be left out."""

    title: str
    lead: str  # which trials it counts
    says: str  # what it shows, on every page
    measures: bool  # agents, which trials of a search alone do not
    kind: str  # "warning", or "small" where the figures are
    text: str
    problems: Sequence[str]
    command: str
    code: str
    figures: Sequence[tuple[Axes, str]]  # with captions, which are the alternative texts as well
    wide: bool  # figures as wide as the page, before the tables
    tables: Sequence[Table]
    parts: Sequence["Section"]  # shown folded,
    opened: bool  # but for a part that is opened
    verdict: str  # of a part, before its title,
    right: bool  # whose color shows whether it is "right"

"""Blocks of a self-contained HTML page, rendered by the template `templates/report.html`."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jinja2 import Environment, PackageLoader, StrictUndefined

from meal_bayes.evaluation.canvas import Axes, svg


@dataclass(frozen=True, slots=True)
class Cell:
    """A number of a table: in bold where it is the best, or over a bar of length 0 to 1."""

    text: str
    best: bool = False
    bar: float | None = None


@dataclass(frozen=True, slots=True)
class Table:
    """A table that scrolls sideways where it is wider than the window.

    Attributes
    ----------
    head : Sequence[str]
        Names of the columns.
    rows : Sequence[Sequence[str | Cell]]
        Their cells.
    texts : Sequence[int]
        Indices of columns that hold text; the others are aligned as numbers.
    note : str
        Stands above the table.
    """

    head: Sequence[str]
    rows: Sequence[Sequence[str | Cell]]
    texts: Sequence[int] = ()
    note: str = ""


@dataclass(frozen=True, slots=True)
class Figure:
    """A drawing; the caption is its alternative text as well."""

    ax: Axes
    caption: str


@dataclass(frozen=True, slots=True, kw_only=True)
class Block:
    """A section of the page, or a part of one that can be folded.

    Attributes
    ----------
    kind : str
        "warning", or "small" where the figures are.
    parts : Sequence[Block]
        Shown folded, unless `opened`.
    verdict : str
        "right", "wrong" or "abstained", before the title of a part.
    """

    title: str
    text: str = ""
    items: Sequence[str] = ()
    command: str = ""
    code: str = ""
    tables: Sequence[Table] = ()
    figures: Sequence[Figure] = ()
    parts: "Sequence[Block]" = ()
    kind: str = ""
    verdict: str = ""
    opened: bool = False


def render_page(title: str, source: str, facts: Mapping[str, str], blocks: Sequence[Block]) -> str:
    """Render the page as HTML.

    Parameters
    ----------
    source : str
        Stands under the title.
    facts : Mapping[str, str]
        A few large numbers by name.
    """
    environment = Environment(
        loader=PackageLoader("meal_bayes.evaluation"), autoescape=True, undefined=StrictUndefined
    )
    environment.filters["data_uri"] = _data_uri
    template = environment.get_template("report.html")
    return template.render(title=title, source=source, facts=facts, blocks=blocks) + "\n"


def _data_uri(ax: Axes) -> str:
    return "data:image/svg+xml;base64," + base64.b64encode(svg(ax).encode()).decode()

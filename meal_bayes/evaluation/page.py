"""Pieces of a self-contained page: no script, nothing fetched, every name of the log escaped."""

import base64
from collections.abc import Iterable, Mapping, Sequence
from html import escape

_STYLE = """
:root { --ink: #1c2430; --soft: #5d6876; --line: #dfe4ea; --back: #f5f6f8; --blue: #0072b2; }
* { box-sizing: border-box; }
body { margin: 0; background: var(--back); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 1rem; }
header h1 { font-size: 1.7rem; line-height: 1.2; margin: 1rem 0 .2rem; overflow-wrap: anywhere; }
header p { color: var(--soft); margin: 0 0 1rem; }
section { background: #fff; border: 1px solid var(--line); border-radius: 10px;
  padding: 1rem 1.2rem 1.2rem; margin: 0 0 1rem; }
h2 { font-size: 1.15rem; margin: 0 0 .3rem; }
section > p, figcaption, .note { color: var(--soft); font-size: .9rem; margin: 0 0 .8rem;
  max-width: 75ch; }
.tiles { display: grid; gap: .7rem; grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr));
  margin: 0 0 1rem; }
.tiles div { background: #fff; border: 1px solid var(--line); border-radius: 10px;
  padding: .6rem .9rem; }
.tiles b { display: block; font-size: 1.35rem; font-variant-numeric: tabular-nums; }
.tiles span { color: var(--soft); font-size: .85rem; }
.wide { overflow-x: auto; }
table { border-collapse: collapse; font-size: .9rem; font-variant-numeric: tabular-nums; }
th, td { padding: .3rem .7rem; text-align: right; border-bottom: 1px solid var(--line);
  white-space: nowrap; }
th { color: var(--soft); font-weight: 600; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
tr:last-child td { border-bottom: 0; }
td.best { font-weight: 700; }
.figures { display: grid; gap: 1rem;
  grid-template-columns: repeat(auto-fit, minmax(min(100%, 21rem), 1fr)); }
figure { margin: 0; min-width: 0; }
figure img { width: 100%; max-width: 34rem; height: auto; display: block; }
figure.square img { max-width: 24rem; }
figcaption { margin: .3rem 0 0; }
.bar { display: inline-block; width: 7rem; height: .6rem; background: #e8ecf0; margin-right: .5rem;
  border-radius: 2px; vertical-align: middle; overflow: hidden; }
.bar i { display: block; height: 100%; background: var(--blue); }
details { border-top: 1px solid var(--line); padding: .5rem 0; }
summary { cursor: pointer; overflow-wrap: anywhere; }
summary b { margin-right: .4rem; }
.wrong { color: #b03a00; font-weight: 700; } .right { color: #00704f; font-weight: 700; }
.warning { border-color: #d55e00; background: #fff6ef; }
pre { overflow-x: auto; font-size: .8rem; background: var(--back); padding: .7rem; }
@media (max-width: 30rem) { main { padding: .6rem; } section { padding: .8rem; }
  th, td { padding: .25rem .45rem; } }
"""
_POLICY = "default-src 'none'; img-src data:; style-src 'unsafe-inline'"


def page(title: str, subtitle: str, parts: Iterable[str]) -> str:
    """Put the page together."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f'<link rel="icon" href="data:,">\n<title>{escape(title)}</title>\n'
        f"<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
        f"<header><h1>{escape(title)}</h1><p>{escape(subtitle)}</p></header>\n"
        + "\n".join(parts)
        + "\n</main>\n</body>\n</html>\n"
    )


def section(heading: str, text: str, *parts: str, kind: str = "") -> str:
    """Make a part of the page with a heading and a line of explanation."""
    opening = f'<section class="{kind}">' if kind else "<section>"
    explained = f"<p>{escape(text)}</p>" if text else ""
    return f"{opening}<h2>{escape(heading)}</h2>{explained}{''.join(parts)}</section>"


def tiles(facts: Mapping[str, str]) -> str:
    """Show a few large figures."""
    boxes = (
        f"<div><b>{escape(value)}</b><span>{escape(name)}</span></div>"
        for name, value in facts.items()
    )
    return f'<div class="tiles">{"".join(boxes)}</div>'


def table(
    head: Sequence[str],
    rows: Sequence[Sequence[str]],
    *,
    best: Mapping[int, int] | None = None,
    texts: Sequence[int] = (),
) -> str:
    """Make a table that scrolls sideways where it is wider than the screen.

    Parameters
    ----------
    rows : cells; one that begins with "<" is HTML of ours, all else is escaped.
    best : by column, the row whose figure is the best.
    texts : columns that hold words.
    """

    def kind(row: int, column: int) -> str:
        names = ["best"] * ((best or {}).get(column) == row) + ["text"] * (column in texts)
        return f' class="{" ".join(names)}"' if names else ""

    top = "".join(f"<th{kind(-1, i)}>{escape(name)}</th>" for i, name in enumerate(head))
    body = "".join(
        "<tr>"
        + "".join(f"<td{kind(i, j)}>{cell_text(cell)}</td>" for j, cell in enumerate(row))
        + "</tr>"
        for i, row in enumerate(rows)
    )
    return f'<div class="wide"><table><tr>{top}</tr>{body}</table></div>'


class Html(str):
    """Text that is HTML already, made here."""

    __slots__ = ()


def cell_text(cell: str) -> str:
    """Escape a cell, unless it is HTML of ours."""
    return cell if isinstance(cell, Html) else escape(cell)


def share_bar(share: float, text: str) -> Html:
    """Draw a share as a bar with its figure."""
    return Html(f'<span class="bar"><i style="width:{100 * share:.1f}%"></i></span>{escape(text)}')


def verdict(*, right: bool, text: str) -> Html:
    """Write a word in the color of right or wrong."""
    return Html(f'<span class="{"right" if right else "wrong"}">{escape(text)}</span>')


def figure(svg: str, words: str, *, square: bool = False) -> str:
    """Put a drawing into the page; `words` are its caption, and what a screen reader says."""
    data = base64.b64encode(svg.encode()).decode()
    source = f"data:image/svg+xml;base64,{data}"
    told = escape(words, quote=True)
    kind = ' class="square"' if square else ""
    image = f'<img src="{source}" alt="{told}">'
    return f"<figure{kind}>{image}<figcaption>{told}</figcaption></figure>"


def figures(*drawn: str) -> str:
    """Put drawings side by side, or below each other on a phone."""
    return f'<div class="figures">{"".join(drawn)}</div>'


def fold(summary: str, *parts: str, opened: bool = False) -> str:
    """Make a part that opens when it is clicked; `summary` is HTML of ours."""
    return f"<details{' open' * opened}><summary>{summary}</summary>{''.join(parts)}</details>"

"""Results as Markdown: a page an item, the index of all, the errata of the published code."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from meal_bayes.files import write_whole
from paper_repro import claims, frame

_DASH = "\N{EN DASH}"  # nothing measured, or nothing printed


def write_pages() -> list[str]:
    """Write figures, the index, a page an item, ERRATA.md from results; returns pages' paths."""
    for item in frame.items():
        record = frame.read_result(item)
        if record is not None:
            frame.write_record(frame.RESULTS, record)
    frame.mark_older()
    pages = {"README.md": readme(frame.items()), "ERRATA.md": errata(frame.items())}
    for item in frame.items():
        result = frame.read_result(item)
        if result is not None:
            pages[f"results/{item}.md"] = result_page(result, committed=True) + "\n"
    for name, text in pages.items():
        write_whole(frame.HERE / name, text, expected=True)
    return [str(frame.HERE / name) for name in pages]


def readme(items: Iterable[str]) -> str:
    """Build the index from the results that are there: claims, rules, and a row an item."""
    rules = frame.read_table("rules.toml")
    rows = claims.claims()
    lines = [rules["head"], f"**{claims.sentence(rows)}**", "", rules["claims"]]
    header = ["the paper claims", "where", "outcome", "effect", "column, and why", "item"]
    lines += [_row(header), _row(["---"] * len(header)), *map(_claim, rows), ""]
    if any(map(frame.is_marked_older, frame.items())):
        lines.append(rules["older"])
    lines.append(rules["rules"])
    lines += [_row(["item", "verdict", "in one sentence", "minutes"]), _row(["---"] * 4)]
    for item in items:
        result = frame.read_result(item)
        if result is None:
            lines.append(_row([item, "not run in full yet", _DASH, _DASH]))
            continue
        mark = " †" if frame.is_marked_older(item) else ""
        link = f"[{item}](results/{item}.md){mark}"
        minutes = frame.minutes_of(item)
        told = "< 1" if minutes < 1 else f"{minutes:.0f}"
        lines.append(_row([link, result["verdict"], result["sentence"], told]))
    return "\n".join(lines) + "\n"


def _claim(row: claims.Claim) -> str:
    """Show a claim as a row."""
    outcome = f"**{row.outcome}**"
    if row.counts:
        outcome += f" ({row.counts})"
    link = f"[{row.item}](results/{row.item}.md)"
    if row.older:
        link += " †"
    effect = "; ".join(row.effects) or _DASH
    why = f"*{row.column}*: {row.because}"
    if row.elsewhere:
        why += f" ({row.elsewhere})"
    return _row([row.says, row.where, outcome, effect, why, link])


def result_page(result: Mapping[str, Any], *, committed: bool = False) -> str:
    """Show one result: its sentence, statements, tables, and figures.

    Parameters
    ----------
    result : its facts.
    committed : they are those of results/, which an earlier version may have made.
    """
    lines = [f"# {result['item']}: {result['title']}", "", result["sentence"], ""]
    size = f"{result['size']} " if result["size"] else ""
    lines += [f"**{result['verdict']}**. {size}`{result['command']}`", ""]
    if committed and frame.is_marked_older(result["item"]):
        again = f"meal-bayes reproduce {result['item']}"
        lines += [f"An earlier version of the code ran it; this runs it again: `{again}`.", ""]
    judged = [row for row in result["statements"] if row["outcome"] is not None]
    unrun = len(result["statements"]) - len(judged)
    if unrun:
        lines += [f"{unrun} statements are not run.", ""]
    if judged:
        header = ["statement", "column", "outcome", "estimate", "interval", "rule", "needed"]
        lines += [_row(header), _row(["---"] * len(header))]
        lines += [*map(_statement, judged), "", "Central statements are bold.", ""]
    for table in result["tables"]:
        lines += [f"**{table['title']}**", "", _row(table["columns"])]
        lines.append(_row(["---", *["--:"] * (len(table["columns"]) - 1)]))
        lines += [*(_row([_text(cell) for cell in row]) for row in table["rows"]), ""]
    if result["figures"]:
        if result["shows"]:
            lines += [result["shows"], ""]
        for name in result["figures"]:
            lines.append(f"![{name.removesuffix('.png').replace('_', ', ')}]({name})")
        lines.append("")
    return "\n".join([*lines, *(f"{note}\n" for note in result["notes"])]).rstrip()


def _statement(row: Mapping[str, Any]) -> str:
    """Show a statement as a row."""
    text = f"**{row['text']}**" if row["central"] else row["text"]
    interval = row["interval"] and f"[{_text(row['interval'][0])}, {_text(row['interval'][1])}]"
    cells = [row["outcome"], _text(row["estimate"]), interval or _DASH, row["rule"]]
    return _row([text, row["protocol"], *cells, row["needed"] or _DASH])


def errata(items: Iterable[str]) -> str:
    """Build the page of the published code's departures, with the effects that were measured."""
    table = frame.read_table("errata.toml")
    effects: dict[str, list[str]] = {}
    for item in items:
        result = frame.read_result(item)
        if result is None:
            continue
        for number, effect in result["effects"].items():
            effects.setdefault(number, []).append(f"{effect} ([{item}](results/{item}.md))")
    lines = [table["head"].strip(), "", _row(["", "departure", "where", "effect"])]
    lines.append(_row(["--:", "---", "---", "---"]))
    for number, entry in table["departure"].items():
        measured = effects.get(number, [])
        if "effect" in entry:  # measured once, outside of the items
            measured = [*measured, entry["effect"]]
        effect = "; ".join(measured) or f"not measured: {entry['unmeasured']}"
        lines.append(_row([number, entry["text"], entry["where"], effect]))
    return "\n".join(lines) + "\n"


def _text(cell: Any) -> str:
    if cell is None:
        return _DASH
    if isinstance(cell, str | int):
        return str(cell)
    if isinstance(cell, list):
        return _estimate(*cell)
    return f"{cell:.3f}" if abs(cell) < claims.ACCURACIES else f"{cell:.2f}"


def _estimate(mean: float | None, *errors: float | None) -> str:
    """Show a mean with its error, or a fraction with both ends of its interval."""
    if mean is None:
        return _DASH
    if errors[0] is None:
        return _text(mean)
    if len(errors) == 2:
        return f"{mean:.3f} [{errors[0]:.3f}, {errors[1]:.3f}]"
    digits = 3 if abs(mean) < claims.ACCURACIES else 1
    return f"{mean:.{digits}f} ± {errors[0]:.{digits}f}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"

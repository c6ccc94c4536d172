"""Results as Markdown: one item, the README of all, the errata of the published code."""

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from frame import HERE, RESULTS

_DASH = "\N{EN DASH}"  # nothing measured, or nothing printed
_ACCURACIES = 2.0  # numbers below are shown with three decimals, others with one
_HEAD = """# The paper's tables and figures, run again

Zhang, Amiri, Sinapov, Thomason, Stone, Zhang: Multimodal embodied attribute learning by robots for
object-centric action policies. Autonomous Robots 47, 2023. doi:10.1007/s10514-023-10098-5

    meal-bayes reproduce all            # everything in full; a run that was stopped goes on
    meal-bayes reproduce all --quick    # the same on a few trials, in two minutes
    meal-bayes reproduce table3 --as-published
    meal-bayes reproduce readme         # this page and ERRATA.md from results/

Numbers stand in up to three columns. **paper**: what it prints. **published**: the published code's
protocol: percepts are drawn from the learned confusion matrices themselves, so that accuracy is the
model's opinion of itself; with its transition diagrams and, on ROC36, the paper's classifiers
(their percepts are computed from the recordings once, in a minute or two). **recorded**: percepts
are outputs of classifiers on real recordings of an object that none has seen, none used twice in a
trial; `morc` is the paper's algorithm, `bayes` is ours. ± is one standard error, objects drawn as
wholes; agents answer the same queries with the same luck.

A verdict is computed from statements that the paper makes, each of which stands or does not: a
number stands if it is within two standard errors of the difference from ours. *reproduced*: all
stand on recordings. *reproduced only in the published protocol*: those that fall there stand in the
published code's. *reproduced where the paper agrees with itself*: those that fall are against other
numbers of its own. *not reproduced*: the rest, with the statements that fell.

This page is made by `meal-bayes reproduce readme`; constants are in `settings.toml`, what the paper
prints in `paper_values.toml`, departures of the published code in `ERRATA.md`. Figures 1, 2, 3, 6
and 13 are drawings and photographs, and are not made again.
"""


def readme(items: Iterable[str]) -> str:
    """Make the README from the results that are there."""
    path = RESULTS / "timing.json"
    timing = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    lines = [_HEAD, _row(["item", "command", "minutes", "paper", "ours", "verdict"])]
    lines.append(_row(["---"] * 6))
    sections = []
    for item in items:
        path = RESULTS / f"{item}.json"
        if not path.is_file():
            shown = f"`meal-bayes reproduce {item}`"
            lines.append(_row([item, shown, _DASH, _DASH, _DASH, "not run in full yet"]))
            continue
        told = json.loads(path.read_text(encoding="utf-8"))
        cells = [f"[{item}](#{item})", f"`{told['command']}`", _minutes(timing[item]["seconds"])]
        lines.append(_row([*cells, told["paper"], told["ours"], told["verdict"]]))
        sections.append(result_page(told, timing[item]["told"], figures="results/"))
    return "\n".join(lines) + "\n\n" + "\n".join(sections)


def result_page(told: Mapping[str, Any], timing: str = "", *, figures: str = "") -> str:
    """Show one result, what its timing tells, and the figures of a folder."""
    lines = [f"## {told['item']}", "", f"{told['title']}. `{told['command']}`", ""]
    for table in told["tables"]:
        lines += [f"**{table['title']}**", "", _row(table["columns"])]
        lines.append(_row(["---", *["--:"] * (len(table["columns"]) - 1)]))
        lines += [*(_row([_text(cell) for cell in row]) for row in table["rows"]), ""]
    if figures:
        lines += [f"![{name}]({figures}{name})" for name in told["figures"]]
        lines += [""] if told["figures"] else []
    lines += [f"- {claim['text']} ({_stands(claim)})" for claim in told["claims"]]
    notes = (note for note in (*told["notes"], timing) if note)
    lines += ["", *(f"{note}\n" for note in notes), f"**{told['verdict']}**", ""]
    return "\n".join(lines)


def errata(items: Iterable[str]) -> str:
    """Make the page of the published code's departures, with the effects that were measured."""
    table = tomllib.loads((HERE / "errata.toml").read_text(encoding="utf-8"))
    effects: dict[str, list[str]] = {}
    for item in items:
        path = RESULTS / f"{item}.json"
        if path.is_file():
            told = json.loads(path.read_text(encoding="utf-8"))
            for number, effect in told["effects"].items():
                effects.setdefault(number, []).append(f"{effect} ([{item}](README.md#{item}))")
    lines = [table["head"].strip(), "", _row(["", "departure", "where", "effect"])]
    lines.append(_row(["--:", "---", "---", "---"]))
    for number, entry in table["departure"].items():
        effect = "; ".join(effects.get(number, [])) or "not measured: " + entry["unmeasured"]
        lines.append(_row([number, entry["text"], entry["where"], effect]))
    return "\n".join(lines) + "\n"


def _stands(claim: Mapping[str, Any]) -> str:
    words = {True: "stands", False: "does not stand"}
    own, code = (words.get(claim[column]) for column in ("recorded", "published"))
    if code is None:
        return own or "not run"
    return f"published: {code}" + (f", recorded: {own}" if own else "")


def _minutes(seconds: float) -> str:
    return "< 1" if seconds < 60 else f"{seconds / 60:.0f}"  # noqa: PLR2004  a minute


def _text(cell: Any) -> str:
    if cell is None:
        return _DASH
    if isinstance(cell, str | int):
        return str(cell)
    if isinstance(cell, list):
        mean, se = cell
        digits = 3 if abs(mean) < _ACCURACIES else 1
        return f"{mean:.{digits}f}" + ("" if se is None else f" ± {se:.{digits}f}")
    return f"{cell:.3f}" if abs(cell) < _ACCURACIES else f"{cell:.2f}"


def _row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"

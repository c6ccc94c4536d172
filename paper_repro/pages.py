"""Results as Markdown: one item, the README of all, the errata of the published code."""

import json
import tomllib
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from meal_bayes.files import write_whole
from paper_repro import frame
from paper_repro.statements import OUTCOMES, counts

_DASH = "\N{EN DASH}"  # nothing measured, or nothing printed
_ACCURACIES = 2.0  # numbers below are shown with three decimals, others with one
_HEAD = """# The paper's tables and figures, run again

Zhang, Amiri, Sinapov, Thomason, Stone, Zhang: Multimodal embodied attribute learning by robots for
object-centric action policies. Autonomous Robots 47, 2023. doi:10.1007/s10514-023-10098-5

    meal-bayes reproduce all            # everything in full; a run that was stopped goes on
    meal-bayes reproduce all --quick    # the same on a few trials
    meal-bayes reproduce table3 --as-published
    meal-bayes reproduce readme         # this page and ERRATA.md from results/

Numbers stand in up to three columns. **paper**: what it prints. **published**: the published code's
protocol: percepts are drawn from the learned confusion matrices themselves, so that accuracy is the
model's opinion of itself; with its transition diagrams, its baselines and, on ROC36, the paper's
classifiers (their percepts are computed from the recordings once, in a minute or two).
**recorded**: percepts are outputs of classifiers on real recordings of an object that none has
seen, none used twice in a trial; `morc` is the paper's algorithm, `bayes` is ours. ± is one
standard error; agents answer the same queries with the same failures and recordings.

## The rules

Every statement of the paper is judged by the 95 % interval of what it speaks of: a paired
difference on the same tasks wherever agents are compared, with objects (offline) or repeats
(online) as clusters. Its row under *what the statements rest on* gives the rule, the mean with its
sign, and the interval.

- *stands*: the whole interval is on the side that the statement says. A printed number stands where
  the whole interval is within the margin that `paper_values.toml` gave before the run. *Best* means
  ahead of every other one.
- *falls*: the whole interval is on the other side.
- *undecided*: the interval reaches both sides; `needed` is the number of trials or repeats that
  would decide it if mean and spread stayed as they are (a dash: no number would, as the measured
  difference is nothing, or too few repeats are there to tell).
- *by construction*: what was fitted to the paper's numbers, or is read back from settings. It is no
  evidence, and no verdict rests on it.

A run goes on in steps until every statement of its item is decided, or not even the last step would
decide it. A verdict counts the outcomes on recordings, beside them those of the published protocol.
*reproduced*: all that are judged stand. *not reproduced*: at least one falls. *reproduced only in
the published protocol*: those that fall stand there, and none falls there. *undecided*: none falls,
and at least one is undecided. *not run on recordings*: there are outcomes of the published
protocol alone. *not run*: there is no outcome yet. *nothing to judge*: the paper states nothing.

Minutes are of computing the trials, those of all processes together, or of the whole run where that
is longer; trials that several items rest on count at each of them. This page is made by
`meal-bayes reproduce readme`; what the paper prints and the margins are in `paper_values.toml`,
departures of the published code in `ERRATA.md`. Figures 1, 2, 3, 6 and 13 are drawings and
photographs, and are not made again.

## The items
"""


def write_pages() -> list[str]:
    """Write README.md and ERRATA.md from the results that are there; returns their paths."""
    pages = {"README.md": readme(frame.items()), "ERRATA.md": errata(frame.items())}
    for name, text in pages.items():
        write_whole(frame.HERE / name, text)
    return [str(frame.HERE / name) for name in pages]


def readme(items: Iterable[str]) -> str:
    """Build the README from the results that are there."""
    path = frame.RESULTS / "timing.json"
    timing = json.loads(path.read_text(encoding="utf-8")) if path.is_file() else {}
    header = ["item", "command", "minutes", "paper", "published protocol", "recorded", "verdict"]
    lines = [_HEAD, _row(header), _row(["---"] * len(header))]
    sections, every = [], []
    for item in items:
        found = _read(item)
        if found is None:
            shown = f"`meal-bayes reproduce {item}`"
            lines.append(_row([item, shown, *[_DASH] * 4, "not run in full yet"]))
            continue
        cells = [f"[{item}](#{item})", f"`{found['command']}`", _minutes(timing.get(item, 0.0))]
        cells += [found[side] or _DASH for side in ("paper", "published", "ours")]
        lines.append(_row([*cells, found["verdict"]]))
        sections.append(result_page(found, figures="results/"))
        every += found["statements"]
    for side in ("recorded", "published"):
        number = counts(one[side] for one in every)
        told = ", ".join(f"{number[outcome]} {outcome}" for outcome in OUTCOMES)
        lines += ["", f"All statements, {side}: {told}."]
    return "\n".join(lines) + "\n\n" + "\n".join(sections)


def result_page(found: Mapping[str, Any], *, figures: str = "") -> str:
    """Show one result, with the figures of a folder beside what the paper describes."""
    lines = [f"## {found['item']}", "", f"{found['title']}. `{found['command']}`", ""]
    for table in found["tables"]:
        lines += [f"**{table['title']}**", "", _row(table["columns"])]
        lines.append(_row(["---", *["--:"] * (len(table["columns"]) - 1)]))
        lines += [*(_row([_text(cell) for cell in row]) for row in table["rows"]), ""]
    if figures and found["figures"]:
        lines += [" ".join(found["shows"].split()), ""] if found["shows"] else []
        lines += [*(f"![{name}]({figures}{name})" for name in found["figures"]), ""]
    lines += [f"- {one['text']}: {_outcomes(one)}" for one in found["statements"]]
    lines += ["", *(f"{note}\n" for note in found["notes"]), f"**{found['verdict']}**", ""]
    return "\n".join(lines)


def errata(items: Iterable[str]) -> str:
    """Build the page of the published code's departures, with the effects that were measured."""
    table = tomllib.loads((frame.HERE / "errata.toml").read_text(encoding="utf-8"))
    effects: dict[str, list[str]] = {}
    for item in items:
        found = _read(item)
        for number, effect in (found["effects"] if found else {}).items():
            effects.setdefault(number, []).append(f"{effect} ([{item}](README.md#{item}))")
    lines = [table["head"].strip(), "", _row(["", "departure", "where", "effect"])]
    lines.append(_row(["--:", "---", "---", "---"]))
    for number, entry in table["departure"].items():
        effect = "; ".join(effects.get(number, [])) or "not measured: " + entry["unmeasured"]
        lines.append(_row([number, entry["text"], entry["where"], effect]))
    return "\n".join(lines) + "\n"


def _read(item: str) -> dict[str, Any] | None:
    path = frame.RESULTS / f"{item}.json"
    if not path.is_file():
        return None
    found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return found


def _outcomes(statement: Mapping[str, Any]) -> str:
    """Return the outcomes of a statement in words, and how many repeats would decide it."""
    sides = [f"{side} {statement[side]}" for side in ("published", "recorded") if statement[side]]
    words = ", ".join(sides) if statement["published"] else statement["recorded"] or "not run"
    if statement["needed"] is not None:
        words += f" ({statement['repeats']} repeats, about {statement['needed']} would decide)"
    return words


def _minutes(seconds: float) -> str:
    return "< 1" if seconds < 60 else f"{seconds / 60:.0f}"  # a minute


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

"""Regenerate what README.md and the site show of real runs: the demo's text and measured tables.

`python benchmarks/readme.py` runs the commands and writes their results between HTML comments of
the pages (`PAGES`); a run that is there already under logs/ is not computed again. `--only` writes
one of the blocks. Two are written only when they are named: `paper-classifiers`, which needs the
recordings and, once, some minutes for the support vector machines, and `online`, a quarter of an
hour of two cores. The block `summary` shows the rows that are kept from `results`. `--check` writes
nothing: it compares the demo's text with what the command prints now, and exits with 1 if they
differ.
"""

import argparse
import difflib
import json
import math
import os
import re
import shlex
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scipy.special import stdtrit

from meal_bayes.canvas import Axes, axes_to_draw, legend, name_axes, save
from meal_bayes.palette import agent_style, lightened, readable

ROOT = Path(__file__).resolve().parents[1]
README = ROOT / "README.md"
MEASURED = ROOT / "benchmarks" / "readme.json"  # rows behind the tables, by command
DEMO = "meal-bayes demo"
PLAIN = {"COLUMNS": "90", "NO_COLOR": "1", "TERM": "dumb", "PYTHONIOENCODING": "utf-8"}


@dataclass(frozen=True, slots=True)
class Run:
    """A table of the README: the command behind it, and what the paper prints."""

    title: str
    command: str
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)  # agent: accuracy, cost


_OFFLINE = "meal-bayes run offline --jobs 2 --json"
_CY101 = f"{_OFFLINE} --dataset cy101 --attributes 1 --trials 1000"
RUNS = (
    Run(
        "ROC36, two attributes",
        f"{_OFFLINE} --dataset roc36 --attributes 2 --trials 100",
        {"random": (0.245, 17.56), "predefined_plus": (0.583, 37.10), "morc": (0.860, 29.85)},
    ),
    Run(
        "ROC36, three attributes",
        f"{_OFFLINE} --dataset roc36 --attributes 3 --trials 100",
        {"random": (0.130, 10.12), "predefined_plus": (0.373, 37.10), "morc": (0.903, 33.87)},
    ),
    Run("CY101, one of ten attributes", _CY101),
    Run(
        "ISPY32, one of 37 attributes", f"{_OFFLINE} --dataset ispy32 --attributes 1 --trials 1184"
    ),
)
PAPER_RUN = Run(
    "CY101, the paper's agent with the paper's classifiers",
    f"{_CY101} --agent morc --perception paper",
)
BELIEFS = "python benchmarks/calibration.py --json"
ONLINE = (
    "meal-bayes run online --jobs 2 --json --dataset cy101 --attributes 1 --repeats 20 --seed 101 "
    "--agent iterative_morc,morc_itrs,bayes,bayes_memory"
)
EVIDENCE = {
    "k=1": "1 recording of a behavior",
    **{f"k={k}": f"{k} recordings of a behavior" for k in (2, 5, 10)},
    "all_once": "one recording of each behavior",
    "all": "all recordings of all behaviors",
}
BELIEVED = {"counts": "Eq. 8", "shared trait": "`bayes`"}  # observation models
PAGES = {  # where each block stands
    "demo": README,
    "summary": README,
    "finding": ROOT / "docs" / "results" / "index.md",
    "results": ROOT / "docs" / "results" / "index.md",
    "paper-classifiers": ROOT / "docs" / "results" / "index.md",
    "beliefs": ROOT / "docs" / "results" / "beliefs.md",
    "online": ROOT / "docs" / "results" / "online.md",
}
MEASURED_BLOCKS = (
    "demo",
    "results",
    "summary",
    "finding",
    "beliefs",
)  # written by default, in this order
SUMMARIZED = ("predefined_plus", "morc", "bayes")
OURS = "bayes"
OBJECTS = {"ROC36": 36, "CY101": 101, "ISPY32": 32}  # clusters of standard errors
RESULTS = {ROOT / "docs" / "assets" / "results.svg": False,
           ROOT / "docs" / "assets" / "results-dark.svg": True}  # fmt: skip
PICTURE = """<picture><source media="(prefers-color-scheme: dark)" \
srcset="docs/assets/results-dark.svg">
<img src="docs/assets/results.svg" width="840" alt="Mean reward of a trial with its 95 % interval, \
by question and agent"></picture>"""


def main() -> int:
    """Write the blocks, or check the demo's."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--check", action="store_true", help="compare the demo's text only")
    parser.add_argument("--only", choices=PAGES, help="write one of the blocks")
    options = parser.parse_args()
    if options.check:
        return check_demo()
    for name in [options.only] if options.only else MEASURED_BLOCKS:
        new = content(name)
        page = PAGES[name]
        text = page.read_text(encoding="utf-8")
        page.write_text(replaced(text, name, new), encoding="utf-8")
    return 0


def content(name: str) -> str:
    """Make what belongs into a block."""
    if name == "demo":
        return demo_block()
    if name == "summary":
        for path, dark in RESULTS.items():
            save(draw_results(measured(), dark=dark), path)
        return summary_block(measured())
    if name == "finding":
        return finding(measured())
    if name == "online":
        rows = json.loads(run(ONLINE))["summary"]
        keep({ONLINE: rows})
        return online_block(rows)
    if name == "beliefs":
        rows = json.loads(run(BELIEFS))["rows"]
        rows = [row for row in rows if row["observation_model"] in BELIEVED]
        keep({BELIEFS: rows})
        return beliefs_table(rows)
    runs = RUNS if name == "results" else (PAPER_RUN,)
    tables = {entry.command: json.loads(run(entry.command))["rows"] for entry in runs}
    keep(tables)
    return "\n\n".join(table_of(entry, tables[entry.command]) for entry in runs)


def keep(tables: Mapping[str, list[dict[str, Any]]]) -> None:
    """Write down the rows of some tables, beside those of the others that the README shows."""
    shown = {*(entry.command for entry in (*RUNS, PAPER_RUN)), BELIEFS, ONLINE}
    others = {command: rows for command, rows in measured().items() if command in shown}
    MEASURED.write_text(json.dumps({**others, **tables}, indent=1) + "\n", encoding="utf-8")


def measured() -> dict[str, list[dict[str, Any]]]:
    """Read the rows behind the tables, which a test compares with the README."""
    if not MEASURED.is_file():
        return {}
    return dict(json.loads(MEASURED.read_text(encoding="utf-8")))


def check_demo() -> int:
    """Compare the README's cast with what the demo prints now."""
    shown = block(README.read_text(encoding="utf-8"), "demo").splitlines()
    now = demo_block().splitlines()
    for line in difflib.unified_diff(shown, now, "README.md", DEMO, lineterm=""):
        print(line)
    if shown != now:
        print("README.md shows another demo; mend it with: python benchmarks/readme.py --only demo")
        return 1
    print("README.md shows the demo as it is")
    return 0


def block(text: str, name: str) -> str:
    """Find what stands between `<!-- name -->` and `<!-- /name -->`."""
    blocks = re.findall(rf"<!-- {name} -->\n(.*?)<!-- /{name} -->", text, re.DOTALL)
    if len(blocks) != 1:
        raise SystemExit(f"The page has {len(blocks)} blocks <!-- {name} -->; expected one.")
    return str(blocks[0])


def replaced(text: str, name: str, new: str) -> str:
    """Put new content between the two comments."""
    old = f"<!-- {name} -->\n{block(text, name)}<!-- /{name} -->"
    return text.replace(old, f"<!-- {name} -->\n{new.rstrip()}\n<!-- /{name} -->")


def run(command: str) -> str:
    """Run a command of this package, or a script, in the project's folder; what it prints."""
    name, *arguments = shlex.split(command)
    if name not in ("meal-bayes", "python"):
        raise ValueError(f"not a command of this package: {command}")
    print(f"$ {command}", file=sys.stderr, flush=True)
    # -P: the installed package, not the one in the working directory; scripts import their siblings
    program = ["-P", "-m", "meal_bayes"] if name == "meal-bayes" else []
    done = subprocess.run(
        [sys.executable, *program, *arguments],
        cwd=ROOT,
        env={**os.environ, **PLAIN},
        stdout=subprocess.PIPE,
        encoding="utf-8",
        check=True,
    )
    return done.stdout


def demo_block() -> str:
    """Make a code block of the demo's question, a decision to go on, one to stop, and its end."""
    parts = [part.rstrip() for part in run(DEMO).split("\n\n")]
    question = next(part for part in parts if part.startswith("  question"))
    going_on = next(part for part in parts if part.startswith("2  "))
    end = next(place for place, part in enumerate(parts) if part.startswith("  answer"))
    excerpt = (question, going_on, "\n\n".join(parts[end - 1 : end + 1]))
    return "\n".join(("```text", "\n...\n".join(excerpt), "```\n"))


def online_block(summary: list[dict[str, Any]]) -> str:
    """Build the table of agents that learn from the summary of their run."""
    head = [
        "agent", "accuracy", "reward", "ECE", "area: reward less the first's",
        "reward less the first's",
    ]  # fmt: skip
    lines = [f"Of `{ONLINE}`:", "", _row(head), _row(["---", *["--:"] * (len(head) - 1)])]
    for row in summary:
        area = _number(row["area_reward_difference"], 1)
        cells = [row["agent"], _number(row["accuracy_after"], 3), _number(row["reward_after"], 1)]
        cells += [_number(row["ece_after"], 3), area, _number(row["reward_after_difference"], 1)]
        lines.append(_row(cells))
    return "\n".join(lines)


def summary_block(tables: Mapping[str, list[dict[str, Any]]]) -> str:
    """Return what the README says of its picture of results, made of the same rows."""
    return f"{PICTURE}\n\n{finding(tables)}"


def finding(tables: Mapping[str, list[dict[str, Any]]]) -> str:
    """Say where our agent earns more than both of the paper's, by more than two standard errors."""
    ahead = []
    behind = []
    near = []
    for entry in RUNS:
        rows = {row["agent"]: row for row in tables[entry.command]}
        ours, best = rows[OURS], max(
            (rows[name] for name in SUMMARIZED if name != OURS), key=lambda row: row["reward"]
        )  # fmt: skip
        gain = ours["reward"] - best["reward"]
        error = math.hypot(ours["reward_se"], best["reward_se"])
        text = f"{entry.title} ({gain:+.0f} ± {error:.0f} against `{best['agent']}`"
        wrong = round((1 - ours["accuracy"]) * ours["trials"])
        if abs(gain) > 2 * error:
            (ahead if gain > 0 else behind).append(f"{text})")
        else:
            near.append(f"{text}; it answered {wrong} of {ours['trials']} wrongly)")
    parts = []
    for places, words in ((ahead, "earns more than both of the paper's agents on"),
                          (behind, "earns less than the better of them on"),
                          (near, "is not told apart from the better of them on")):  # fmt: skip
        if places:
            parts.append(f"{words} {' and on '.join(places)}")
    return f"`{OURS}` {'; it '.join(parts)}."


def draw_results(tables: Mapping[str, list[dict[str, Any]]], *, dark: bool) -> Axes:
    """Draw the reward of three agents with 95 % intervals, a row a question."""
    ink = "#E8EBEF" if dark else "#1C2430"
    with axes_to_draw(None, width=8.4, height=2.9) as ax:
        for number, name in enumerate(SUMMARIZED):
            style = agent_style(name)
            color = lightened(style.color) if dark else style.color
            for place, entry in enumerate(RUNS):
                (row,) = (row for row in tables[entry.command] if row["agent"] == name)
                half = row["reward_se"] * float(
                    stdtrit(OBJECTS[entry.title.split(",")[0]] - 1, 0.975)
                )
                y = place + 0.22 * (number - 1)
                ax.errorbar(
                    row["reward"],
                    y,
                    xerr=half,
                    fmt=style.marker,
                    color=color,
                    ms=7,
                    elinewidth=1.8,
                    label=name if place == 0 else None,
                )
                ax.text(
                    row["reward"] + half + 5,
                    y,
                    f"{row['reward']:.0f}",
                    va="center",
                    size=9,
                    color=readable(color, dark=dark),
                )
        ax.set_yticks(range(len(RUNS)), [entry.title for entry in RUNS])
        ax.set(ylim=(len(RUNS) - 0.5, -0.5), xlim=(0, 545))
        name_axes(
            ax,
            "mean reward of a trial (+500 or +300 right, -1 a second), 95 % interval",
            "",
            grid="x",
        )
        ax.grid(axis="x", color="#38414C" if dark else "#E6E6E6", lw=0.7)
        legend(ax, len(SUMMARIZED), above=True)
        ax.patch.set_alpha(0)
        ax.figure.patch.set_alpha(0)
        for text in (*ax.get_xticklabels(), *ax.get_yticklabels(), ax.xaxis.label,
                     *ax.get_legend().get_texts()):  # fmt: skip
            text.set_color(ink)
            text.set_size(10)
        for side in ax.spines.values():
            side.set_color(ink)
    return ax


def beliefs_table(rows: list[dict[str, Any]]) -> str:
    """Make the table of beliefs by the paper's observation model and by ours."""
    beliefs = {(row["evidence"], row["dataset"], row["observation_model"]): row for row in rows}
    columns = [(name, model) for name in ("roc36", "ispy32", "cy101") for model in BELIEVED]
    head = ["belief after", *(f"{name.upper()}, {BELIEVED[model]}" for name, model in columns)]
    lines = [f"Of `{BELIEFS}`, NLL and (ECE):", "", _row(head)]
    lines.append(_row(["---", *["--:"] * len(columns)]))
    for evidence, words in EVIDENCE.items():
        cells = [words]
        for column in columns:
            row = beliefs.get((evidence, *column))
            cells.append(f"{row['nll']:.3f} ({row['ece']:.3f})" if row else _number(None, 3))
        lines.append(_row(cells))
    return "\n".join(lines)


def table_of(of: Run, rows: list[dict[str, Any]]) -> str:
    """Make the table of one run from its rows."""
    head = ["agent", "accuracy", "cost, s (sd)", "reward", "NLL", "ECE", "abstained"]
    printed = [*head, "paper: accuracy", "paper: cost, s"] if of.paper else head
    lines = [f"**{of.title}**", "", _row(printed)]
    lines.append(_row(["---", *["--:"] * (len(printed) - 1)]))
    for row in rows:
        cells = _cells(row)
        if of.paper:
            accuracy, cost = of.paper.get(row["agent"], (None, None))
            cells += [_number(accuracy, 3), _number(cost, 2)]
        lines.append(_row(cells))
    lines += ["", f"{rows[0]['trials']} trials an agent, by `{of.command}`."]
    return "\n".join(lines)


def _cells(row: Mapping[str, Any]) -> list[str]:
    """Return the measures of one agent as text."""
    return [
        row["agent"],
        "{accuracy:.3f} [{accuracy_low:.3f}, {accuracy_high:.3f}]".format_map(row),
        f"{_number(row['cost_s'], 1)} ({_number(row['cost_sd'], 1)})",
        f"{_number(row['reward'], 1)} ± {_number(row['reward_se'], 1)}",
        _number(row["nll"], 3),
        _number(row["ece"], 3),
        f"{row['abstained']:.1%}",
    ]


def _number(value: float | None, digits: int) -> str:
    return "–" if value is None else f"{value:.{digits}f}"  # noqa: RUF001  a dash for "nothing"


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"


if __name__ == "__main__":
    raise SystemExit(main())

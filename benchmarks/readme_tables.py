"""The tables of results and what is said of them, made of the rows that the commands print.

Here stand the commands, too: `readme.py` runs them, keeps their rows and writes the blocks.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, slots=True)
class Run:
    """A table of offline results and the command behind it.

    Attributes
    ----------
    title : what is asked, after the data set's name and a comma.
    command : prints the rows.
    paper : accuracy and cost in seconds that the paper prints, by agent.
    """

    title: str
    command: str
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)


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
SUMMARIZED = ("predefined_plus", "morc", "bayes")
OURS = "bayes"
PICTURE = """<picture><source media="(max-width: 600px) and (prefers-color-scheme: dark)" \
srcset="docs/assets/results-narrow-dark.svg">\
<source media="(max-width: 600px)" srcset="docs/assets/results-narrow.svg">\
<source media="(prefers-color-scheme: dark)" \
srcset="docs/assets/results-dark.svg">
<img src="docs/assets/results.svg" width="840" alt="Mean reward of a trial with its 95 % interval, \
by question and agent"></picture>"""


def online_block(summary: list[dict[str, Any]]) -> str:
    """Build the table of agents that learn from the summary of their run."""
    head = [
        "agent",
        "accuracy",
        "reward",
        "ECE",
        "area: reward less the first's",
        "reward less the first's",
    ]
    lines = [f"Of `{ONLINE}`:", "", *_head(head)]
    for row in summary:
        cells = [
            row["agent"],
            _number(row["accuracy_after"], 3),
            _number(row["reward_after"], 1),
            _number(row["ece_after"], 3),
            _number(row["area_reward_difference"], 1),
            _number(row["reward_after_difference"], 1),
        ]
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
        ours = rows[OURS]
        theirs = [rows[name] for name in SUMMARIZED if name != OURS]
        best = max(theirs, key=lambda row: row["reward"])
        gain = ours["reward"] - best["reward"]
        # As if the agents' trials were independent. They meet the same objects, which mostly makes
        # the error of a paired difference smaller than this one.
        error = math.hypot(ours["reward_se"], best["reward_se"])
        text = f"{entry.title} ({gain:+.0f} ± {error:.0f} against `{best['agent']}`"
        wrong = round((1 - ours["accuracy"]) * ours["trials"])
        if gain > 2 * error:
            ahead.append(f"{text})")
        elif gain < -2 * error:
            behind.append(f"{text})")
        else:
            near.append(f"{text}; it answered {wrong} of {ours['trials']} wrongly)")
    outcomes = {
        "earns more than both of the paper's agents on": ahead,
        "earns less than the better of them on": behind,
        "is not told apart from the better of them on": near,
    }
    parts = [f"{words} {' and on '.join(places)}" for words, places in outcomes.items() if places]
    return f"`{OURS}` {'; it '.join(parts)}."


def beliefs_table(rows: list[dict[str, Any]]) -> str:
    """Make the table of beliefs by the paper's observation model and by ours."""
    beliefs = {(row["evidence"], row["dataset"], row["observation_model"]): row for row in rows}
    columns = [(name, model) for name in ("roc36", "ispy32", "cy101") for model in BELIEVED]
    head = ["belief after", *(f"{name.upper()}, {BELIEVED[model]}" for name, model in columns)]
    lines = [f"Of `{BELIEFS}`, NLL and (ECE):", "", *_head(head)]
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
    lines = [f"**{of.title}**", "", *_head(printed)]
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
    if value is None:
        return "–"  # noqa: RUF001  a dash for "nothing"
    return f"{value:.{digits}f}"


def _head(columns: list[str]) -> list[str]:
    """Return a table's first two lines: names on the left, numbers on the right."""
    return [_row(columns), _row(["---", *["--:"] * (len(columns) - 1)])]


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"

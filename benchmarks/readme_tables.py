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
        f"{_OFFLINE} --dataset roc36 --attributes 2 --trials 1000",
        {"random": (0.245, 17.56), "predefined_plus": (0.583, 37.10), "morc": (0.860, 29.85)},
    ),
    Run(
        "ROC36, three attributes",
        f"{_OFFLINE} --dataset roc36 --attributes 3 --trials 300",
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
ANSWERS = "python benchmarks/calibration.py --part answers --trials 300 --json"
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
SUMMARIZED = ("prior", "predefined_plus", "morc", "bayes")
OURS = "bayes"
_DECLINING = {"agent": "declining every question"}
_DECLINED = [_DECLINING["agent"], "0.000", "0.0 (0.0)", "0.0", "–", "–", "–", "100.0%"]  # noqa: RUF001
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
    """Say what our agent earns, and how much more than the best of all others, by question.

    Declining every question, which earns 0, is one of the others.
    """
    lines = []
    for entry in RUNS:
        rows = {row["agent"]: row for row in tables[entry.command]}
        ours = rows[OURS]
        best = max((row for row in rows.values() if row is not ours), key=lambda row: row["reward"])
        text = f"- {entry.title}: `{OURS}` earns {ours['reward']:.0f} s a question, {_work(ours)}. "
        if best["reward"] < 0:
            lines.append(f"{text}All others earn less than declining, which earns 0.")
            continue
        text += f"That is {_compared(ours, best)}, the best of the others"
        text += f" ({_work(best)})"
        morc = rows["morc"]
        if best is not morc:
            text += f", and {_compared(ours, morc)} ({_work(morc)})"
        lines.append(f"{text}.")
    note = (
        "Brackets are 95 % intervals of paired differences; ± is one standard error of unpaired "
        "ones. Declining every question earns 0, and a question that was declined is not counted "
        "as answered wrongly."
    )
    return "\n".join([*lines, "", note])


def _compared(ours: Mapping[str, Any], row: Mapping[str, Any]) -> str:
    """Say by how much our agent earns more, or less, than another."""
    more = row.get("ours_more", ours["reward"] - row["reward"])
    sign = -1 if more < 0 else 1
    words = "less" if more < 0 else "more"
    return f"{_gain(ours, row, sign)} s {words} than `{row['agent']}`"


def _gain(ours: Mapping[str, Any], row: Mapping[str, Any], sign: int = 1) -> str:
    """Return by how much our agent earns more than another: paired, where the run's logs were read.

    Else with a standard error as if the questions of the two were not the same. Of sign -1: less.
    """
    if "ours_more" in row:
        low, high = sorted((sign * row["ours_more_low"], sign * row["ours_more_high"]))
        return f"{sign * row['ours_more']:.1f} [{low:.1f}, {high:.1f}]"
    error = math.hypot(ours["reward_se"], row["reward_se"])
    return f"{sign * (ours['reward'] - row['reward']):.1f} ± {error:.1f}"


def _work(row: Mapping[str, Any]) -> str:
    """Return an agent's seconds, and the share of its answers that are wrong."""
    wrong = 1 - row["answered_accuracy"]
    return f"after {row['cost_s']:.1f} s of work, with {wrong:.1%} of its answers wrong"


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


def answers_table(rows: list[dict[str, Any]]) -> str:
    """Make the table of what our agent says of its answers, and how often they are right."""
    head = ["question", "answers of questions", "says", "is right", "says too much"]
    head += ["reward of a question", "cost, s"]
    lines = [f"Of `{ANSWERS}`:", "", *_head(head)]
    for row in rows:
        cells = [
            f"{row['dataset'].upper()}, {row['attributes']} asked",
            f"{row['answered']} of {row['trials']}",
            _number(row["says"], 3),
            _number(row["right"], 3),
            "{gap:+.3f} [{gap_low:+.3f}, {gap_high:+.3f}]".format_map(row),
            _number(row["reward"], 1),
            _number(row["cost_s"], 1),
        ]
        lines.append(_row(cells))
    return "\n".join(lines)


def table_of(of: Run, rows: list[dict[str, Any]]) -> str:
    """Make the table of one run from its rows."""
    head = ["agent", "accuracy", "cost, s (sd)", "reward", "NLL", "ECE", "abstained"]
    compared = any("ours_more" in row for row in rows)
    if compared:
        head.insert(4, f"`{OURS}` earns more")
    printed = [*head, "paper: accuracy", "paper: cost, s"] if of.paper else head
    lines = [f"**{of.title}**", "", *_head(printed)]
    for row in [_DECLINING, *rows] if compared else rows:
        cells = list(_DECLINED) if row is _DECLINING else _cells(row)
        if compared and row is not _DECLINING:
            cells.insert(4, _gain(row, row) if "ours_more" in row else _number(None, 1))
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

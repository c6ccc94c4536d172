"""The measurements behind the results, and the tables and sentences made of their rows.

Each number of the README and of the pages of results has one source: the rows of one of these
measurements, which `readme.py` keeps in `readme.json`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

Rows = list[dict[str, Any]]
Kept = Mapping[str, Any]  # of a measurement: its `command` and `rows`
Tables = Mapping[str, Kept]  # by the name of the measurement


@dataclass(frozen=True, slots=True)
class Measurement:
    """A command that prints rows.

    Attributes
    ----------
    command : prints JSON.
    title : of its table.
    minutes : of CPU, as long as the command was not run.
    paper : accuracy and cost in seconds that the paper prints, by agent.
    """

    command: str
    title: str = ""
    minutes: float = 5.0
    paper: Mapping[str, tuple[float, float]] = field(default_factory=dict)


_OFFLINE = "meal-bayes run offline --jobs 2 --json"
_CY101 = f"{_OFFLINE} --dataset cy101 --attributes 1 --trials 1000"
_ISPY32 = f"{_OFFLINE} --dataset ispy32"
_ROC36 = f"{_OFFLINE} --dataset roc36"
RUNS = {  # offline, with all agents
    "roc36-2": Measurement(
        f"{_ROC36} --attributes 2 --trials 2000",
        "ROC36, two attributes",
        6,
        {"random": (0.245, 17.56), "predefined_plus": (0.583, 37.10), "morc": (0.860, 29.85)},
    ),
    "roc36-3": Measurement(
        f"{_ROC36} --attributes 3 --trials 2000",
        "ROC36, three attributes",
        6,
        {"random": (0.130, 10.12), "predefined_plus": (0.373, 37.10), "morc": (0.903, 33.87)},
    ),
    "cy101-1": Measurement(_CY101, "CY101, one of ten attributes", 2),
    "ispy32-1": Measurement(
        f"{_ISPY32} --attributes 1 --trials 1184", "ISPY32, one of 37 attributes", 2
    ),
    "ispy32-2": Measurement(f"{_ISPY32} --attributes 2 --trials 1000", "ISPY32, two attributes"),
    "ispy32-3": Measurement(f"{_ISPY32} --attributes 3 --trials 1000", "ISPY32, three attributes"),
}
BELIEFS = "beliefs"
ANSWERS = "answers"
PAPER_RUN = "paper-classifiers"
ONLINE = "online"
LOSSES = "losses"
MEASUREMENTS = {
    **RUNS,
    BELIEFS: Measurement("python benchmarks/calibration.py --json", minutes=3),
    ANSWERS: Measurement(
        "python benchmarks/calibration.py --part answers --trials 1000 --json", minutes=30
    ),
    PAPER_RUN: Measurement(
        f"{_CY101} --agent morc --perception paper",
        "CY101, the paper's agent with the paper's classifiers",
        5,
    ),
    ONLINE: Measurement(
        "meal-bayes run online --jobs 2 --json --dataset cy101 --attributes 1 --repeats 20 "
        "--seed 101 --agent iterative_morc,morc_itrs,bayes,bayes_memory",
        minutes=30,
    ),
    LOSSES: Measurement("python benchmarks/losses.py --json", minutes=9),
}
EVIDENCE = {
    "k=1": "1 recording of a behavior",
    **{f"k={k}": f"{k} recordings of a behavior" for k in (2, 5, 10)},
    "all_once": "one recording of each behavior",
    "all": "all recordings of all behaviors",
}
BELIEVED = {"counts": "Eq. 8", "shared trait": "`bayes`"}  # observation models
SUMMARIZED = ("prior", "predefined_plus", "morc", "bayes")
OURS = "bayes"
COMPARED = "morc"  # the paper's agent
DECLINING = "declining every question"
_NOTHING = "–"  # noqa: RUF001  a dash for "nothing"
_DECLINED = [DECLINING, "0.000", "0.0 (0.0)", "0.0", _NOTHING, _NOTHING, "100.0%"]
PICTURE = """<picture><source media="(max-width: 600px) and (prefers-color-scheme: dark)" \
srcset="docs/assets/results-narrow-dark.svg">\
<source media="(max-width: 600px)" srcset="docs/assets/results-narrow.svg">\
<source media="(prefers-color-scheme: dark)" \
srcset="docs/assets/results-dark.svg">
<img src="docs/assets/results.svg" width="840" alt="Mean reward of a trial with its 95 % interval, \
by question and agent"></picture>"""


def online_table(kept: Kept) -> str:
    """Make the table of agents that learn while they work."""
    head = ["agent", "accuracy", "reward", "ECE"]
    head += ["reward minus the first row's, over H hours", "the same, after the last batch"]
    lines = [f"Results of `{kept['command']}`:", "", *_head(head)]
    first, *_ = kept["rows"]  # with which the others are compared
    for row in kept["rows"]:
        cells = [row["agent"], _number(row["accuracy_after"], 3), _number(row["reward_after"], 1)]
        cells.append(_number(row["ece_after"], 3))
        if row is first:
            cells += [_NOTHING, _NOTHING]
        else:
            area = (row["area_reward_difference"], row["area_low"], row["area_high"])
            cells += [_interval(*area), _number(row["reward_after_difference"], 1)]
        lines.append(_row(cells))
    return "\n".join(lines)


def runs_of(tables: Tables) -> dict[str, Measurement]:
    """Return the offline runs of which there are rows."""
    return {name: run for name, run in RUNS.items() if name in tables}


def summary(tables: Tables) -> str:
    """Return what the README says of its picture of results, made of the same rows."""
    return f"{PICTURE}\n\n{finding(tables)}"


def finding(tables: Tables) -> str:
    """Say where our agent leads, and tabulate its reward beside those of three others.

    Declining every question earns 0, so that our lead over it is the reward itself.
    """
    leads, behind, lines = [], [], []
    for name, run in runs_of(tables).items():
        rows = {row["agent"]: row for row in tables[name]["rows"]}
        ours = rows.pop(OURS)
        morc = rows[COMPARED]
        if all(row["ours_more_low"] > 0 for row in rows.values()):
            leads.append((run.title, ours, morc))
        behind += [row["agent"] for row in rows.values() if row["ours_more_high"] < 0]
        cells = [run.title, *(_lead(rows[agent]) for agent in (DECLINING, COMPARED, "prior"))]
        for row in (ours, morc):
            cells += [f"{row['cost_s']:.1f}", f"{1 - row['answered_accuracy']:.1%}"]
        lines.append(_row(cells))
    head = [
        "question", f"reward of `{OURS}`", f"more than `{COMPARED}`", "more than `prior`",
        f"`{OURS}`: cost", "wrong", f"`{COMPARED}`: cost", "wrong",
    ]  # fmt: skip
    note = (
        "Rewards and costs are seconds, and the reward is net of the cost; *wrong* is the share of "
        "wrong answers among the questions that were answered. Brackets are 95 % intervals, those "
        "of differences on the same questions. `prior` answers by base rates, without executing "
        "any behavior. Declining every question earns 0."
    )
    others = "By the same intervals, no other agent earns more in any kind of question."
    if behind:
        others = f"By the same intervals, another agent earns more in {len(behind)} comparisons."
    return "\n".join([f"{_where_it_leads(leads)} {others}", "", *_head(head), *lines, "", note])


def _where_it_leads(leads: list[tuple[str, Mapping[str, Any], Mapping[str, Any]]]) -> str:
    """Say in which questions our agent leads by its intervals, and how long it works there."""
    if not leads:
        return (
            f"By 95 % intervals, `{OURS}` earns more than all other agents in no kind of question."
        )
    titles = "; ".join(title for title, _, _ in leads)
    ours, theirs = (", ".join(f"{pair[k]['cost_s']:.0f}" for pair in leads) for k in (1, 2))
    return (
        f"By 95 % intervals, `{OURS}` earns more than every other agent, and than declining every "
        f"question, in {len(leads)} of {len(RUNS)} kinds of question ({titles}). In these, the "
        f"behaviors of `{OURS}` take {ours} s on average, and those of `{COMPARED}`, the paper's "
        f"algorithm, {theirs} s."
    )


def _lead(row: Mapping[str, Any]) -> str:
    """Return by how much our agent earns more than another, with its interval."""
    return f"{row['ours_more']:.0f} [{row['ours_more_low']:.0f}, {row['ours_more_high']:.0f}]"


def beliefs_table(kept: Kept) -> str:
    """Make the table of beliefs by the paper's observation model and by ours."""
    beliefs = {
        (row["evidence"], row["dataset"], row["observation_model"]): row for row in kept["rows"]
    }
    columns = [(name, model) for name in ("roc36", "ispy32", "cy101") for model in BELIEVED]
    head = ["belief after", *(f"{name.upper()}, {BELIEVED[model]}" for name, model in columns)]
    lines = [f"NLL, and in parentheses ECE, by `{kept['command']}`:", "", *_head(head)]
    for evidence, words in EVIDENCE.items():
        cells = [words]
        for column in columns:
            row = beliefs.get((evidence, *column))
            cells.append(f"{row['nll']:.3f} ({row['ece']:.3f})" if row else _NOTHING)
        lines.append(_row(cells))
    return "\n".join(lines)


def answers_table(kept: Kept) -> str:
    """Make the table of what our agent says of its answers, and how often they are right."""
    head = ["question", "answered", "mean Pr(right)", "fraction right", "difference"]
    lines = [f"Results of `{kept['command']}`:", "", *_head(head)]
    for row in kept["rows"]:
        cells = [
            question({"answer": "values", **row}),
            f"{row['answered']} of {row['trials']}",
            _number(row["says"], 3),
            _number(row["right"], 3),
            "{gap:+.3f} [{gap_low:+.3f}, {gap_high:+.3f}]".format_map(row),
        ]
        lines.append(_row(cells))
    return "\n".join(lines)


LOSSES_PICTURE = (
    "![What our agent lacks of the reward of perfect percepts, a row a data set and number of "
    "attributes: for more data, for better plans, for better sensors](docs/assets/losses.png)"
)


def losses_block(kept: Kept) -> str:
    """Return the picture of what the reward lacks, and what the README says of it."""
    rows = kept["rows"]
    data, plans, sensors = (
        max(rows, key=lambda row, part=part: row[part]) for part in ("data", "plans", "sensors")
    )
    return (
        f"{LOSSES_PICTURE}\n\nThe figure shows where the reward of 500 is lost, by "
        f"`{kept['command']}`. Unlimited training objects would increase the mean "
        f"reward by at most {data['data']:.0f} ± {data['data_se']:.0f} s ({question(data)}), "
        "extrapolated from the gain of the second half of the objects. Better plans would "
        "increase it by at most "
        f"{plans['plans']:.0f} ± {plans['plans_se']:.0f} s ({question(plans)}). Better sensors "
        f"would bring the rest, at most {sensors['sensors']:.0f} ± {sensors['sensors_se']:.0f} s "
        f"({question(sensors)})."
    )


def question(row: Mapping[str, Any]) -> str:
    """Name a kind of question, of a row of what the reward lacks."""
    number = row["attributes"]
    noun = "attribute" if number == 1 else "attributes"
    kind = "" if row["answer"] == "values" else f", {row['answer']}"
    return f"{row['dataset'].upper()}, {number} {noun}{kind}"


def results_tables(tables: Tables) -> str:
    """Make the tables of all offline runs."""
    return "\n\n".join(run_table(run, tables[name]) for name, run in runs_of(tables).items())


def run_table(run: Measurement, kept: Kept) -> str:
    """Make the table of one offline run."""
    rows = kept["rows"]
    head = ["agent", "accuracy", "cost, s (sd)", "reward", "NLL", "ECE", "abstained"]
    compared = any("ours_more" in row for row in rows)
    if compared:
        head.insert(4, f"`{OURS}` earns more")
    if run.paper:
        head += ["paper: accuracy", "paper: cost, s"]
    lines = [f"**{run.title}**", "", *_head(head)]
    for row in rows:
        cells = list(_DECLINED) if row["agent"] == DECLINING else _cells(row)
        if compared:
            ends = ("ours_more", "ours_more_low", "ours_more_high")
            cells.insert(4, _interval(*map(row.get, ends)) if "ours_more" in row else _NOTHING)
        if run.paper:
            accuracy, cost = run.paper.get(row["agent"], (None, None))
            cells += [_number(accuracy, 3), _number(cost, 2)]
        lines.append(_row(cells))
    lines += ["", f"{rows[-1]['trials']} trials an agent, by `{kept['command']}`."]
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


def _interval(value: float, low: float, high: float) -> str:
    return f"{value:.1f} [{low:.1f}, {high:.1f}]"


def _number(value: float | None, digits: int) -> str:
    return _NOTHING if value is None else f"{value:.{digits}f}"


def _head(columns: list[str]) -> list[str]:
    """Return a table's first two lines: names on the left, numbers on the right."""
    return [_row(columns), _row(["---", *["--:"] * (len(columns) - 1)])]


def _row(cells: list[str]) -> str:
    return f"| {' | '.join(cells)} |"

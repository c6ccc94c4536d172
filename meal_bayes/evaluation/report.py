"""One page of a run: accuracy, cost, calibration, and the trials with the lowest reward."""

import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.collect import Collected
from meal_bayes.evaluation.page import Block, Cell, Figure, Table, render_page
from meal_bayes.evaluation.statistics import Interval, wilson_interval
from meal_bayes.evaluation.summary import SummaryRow, compare, mean, summarize
from meal_bayes.evaluation.worst import worst_trials
from meal_bayes.files import check_output, write_whole
from meal_bayes.trial_log import Logs
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.text import UNKNOWN

_HOUR = 3600.0  # s
_SHORT = 0.1  # h, below which a time is shown in s


@dataclass(frozen=True, slots=True)
class ReportInfo:
    """What a report was made of; its size in bytes."""

    path: Path
    size: int
    trials: int
    agents: tuple[str, ...]


def write_report(
    logs: Logs, path: str | Path, *, on_progress: Callable[[int, int], None] | None = None
) -> ReportInfo:
    """Read logs as far as they can be read and write one self-contained HTML page.

    Parameters
    ----------
    logs : Logs
        Of one data set, as object indices name the clusters of standard errors.
    on_progress : Callable[[int, int], None] | None
        Called with (files done, files in all).

    Raises
    ------
    LogError
        There is not one trial that can be read.
    OutputError
        The page cannot be written, or would replace a log.
    """
    path, data, read = Path(path), Collected(), set[Path]()
    check_output(path, inputs=logs.files)
    for group in logs.groups():
        if on_progress is not None and group.file not in read:
            on_progress(len(read), len(logs.files))
        read.add(group.file)
        data.add(group)
    if not data.trials:
        logs.complain_of_nothing()
    outcomes = data.outcomes()
    write_whole(path, report_page(data, outcomes, logs), inputs=logs.files)
    return ReportInfo(path, path.stat().st_size, data.trials, outcomes.agents)


def report_page(data: Collected, outcomes: TrialOutcomes, logs: Logs) -> str:
    """Return the page as HTML; of a single trial, the trial without statistics."""
    agents = {name or "agent": outcomes.of_agent(name) for name in outcomes.agents}
    statistics: list[Block] = []
    if len(outcomes) > 1:
        rows = summarize(outcomes)
        statistics = [
            _agents(rows, agents, outcomes),
            *_learning(data, outcomes),
            _calibration(rows, outcomes),
            _attributes(agents),
            _behaviors(agents),
        ]
    config = logs.header.get("config")
    name = config.get("dataset") if isinstance(config, dict) else None
    title = f"Trials on {name}" if isinstance(name, str) else "Trials"
    blocks = [*_warnings(logs), *statistics, worst_trials(data), _run(logs)]
    return render_page(title, _source(logs.files), _facts(outcomes), blocks)


def _source(files: Sequence[Path]) -> str:
    """Return a short name of the logs: the file, or the folder that they share."""
    if len(files) == 1:
        return files[0].name
    folder = Path(os.path.commonpath([file.resolve() for file in files])).name
    return f"{len(files)} logs in {folder}"


def _facts(outcomes: TrialOutcomes) -> dict[str, str]:
    numbers = {
        "trial": len(outcomes),
        "step": int(outcomes.steps.sum()),
        "agent": len(outcomes.agents),
        "object": len(set(outcomes.object_name.tolist())),
    }
    spent = float(outcomes.cost.sum())
    hours = spent / _HOUR
    unit, amount = ("hours", f"{hours:.1f}") if hours > _SHORT else ("seconds", f"{spent:.1f}")
    counted = {name + "s" * (n != 1): f"{n:,}" for name, n in numbers.items()}
    return {**counted, f"{unit} of robot time": amount}


def _warnings(logs: Logs) -> Iterator[Block]:
    if logs.problems:
        text = "Some of the logs are damaged or unfinished; this page shows their whole trials."
        yield Block(title="Warning", text=text, items=logs.problems, kind="warning")


def _count(row: SummaryRow) -> str:
    missing = row.trials - row.judged
    return f"{row.trials:,}" + f", {missing:,} {UNKNOWN}" * (missing > 0)


def _with_error(value: float, se: float, digits: int) -> str:
    if math.isnan(value):
        return UNKNOWN
    return f"{value:.{digits}f}" + ("" if math.isnan(se) else f" ± {se:.{digits}f}")


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"


class _Column(NamedTuple):
    """A column of the table of agents; the one with the largest `merit` stands in bold."""

    text: Callable[[SummaryRow], str]
    merit: Callable[[SummaryRow], float] | None = None


# Neither cost nor ECE has a best: both are low where an agent does nothing.
_COLUMNS = {
    "agent": _Column(lambda row: row.agent or "agent"),
    "trials": _Column(_count),
    "accuracy": _Column(
        lambda row: _with_error(row.accuracy, row.accuracy_se, 3),
        lambda row: round(row.accuracy, 3),
    ),
    "cost, s (sd)": _Column(lambda row: f"{row.cost_s:.1f} ({_number(row.cost_sd, 1)})"),
    "reward": _Column(
        lambda row: _with_error(row.reward, row.reward_se, 1), lambda row: round(row.reward, 1)
    ),
    "NLL": _Column(lambda row: _number(row.nll, 3), lambda row: -round(row.nll, 3)),
    "ECE": _Column(lambda row: _number(row.ece, 3)),
    "abstained": _Column(lambda row: f"{_number(100 * row.abstained, 1)} %"),
}


def _agents(
    rows: list[SummaryRow], agents: Mapping[str, TrialOutcomes], outcomes: TrialOutcomes
) -> Block:
    best = {name: _best([column.merit(row) for row in rows]) for name, column in _COLUMNS.items()
            if column.merit is not None}  # fmt: skip
    cells = [
        [
            Cell(column.text(row), best=place in best.get(name, ()))
            for name, column in _COLUMNS.items()
        ]
        for place, row in enumerate(rows)
    ]
    text = (
        "A trial counts as right when all its attributes are; one that abstained does not. "
        "± is one standard error, objects drawn as wholes. NLL (nats) and ECE are of the final "
        "belief. Bold: best accuracy, reward and NLL."
    )
    figures = []
    if max(map(len, agents.values())) > 1:
        points = {name: (mean(own, "success"), mean(own, "cost")) for name, own in agents.items()}
        costs = {name: own.cost[own.ended == ""] for name, own in agents.items()}
        known = {name: both for name, both in points.items() if not math.isnan(both[0].estimate)}
        if known:
            caption = "Accuracy over mean cost with 95 % intervals; objects are clusters."
            figures.append(Figure(plots.accuracy_and_cost(known), caption))
        caption = "Fraction of trials that cost at most so many seconds."
        figures.append(Figure(plots.cost_distribution(costs), caption))
    tables = [Table(list(_COLUMNS), cells), *_differences(rows, outcomes)]
    return Block(title="Agents", text=text, tables=tables, figures=figures)


def _best(merits: Sequence[float]) -> set[int]:
    """Return the positions of the largest merit; none where all are equal or unknown."""
    known = {merit for merit in merits if not math.isnan(merit)}
    if len(known) < 2:
        return set()
    return {place for place, merit in enumerate(merits) if merit == max(known)}


def _differences(rows: list[SummaryRow], outcomes: TrialOutcomes) -> Iterator[Table]:
    """Compare every agent with the one that has the highest reward, on the tasks they share."""
    best = max(rows, key=lambda row: -math.inf if math.isnan(row.reward) else row.reward).agent
    cells = []
    for row in rows:
        if row.agent == best:
            continue
        try:
            found = [compare(outcomes, best, row.agent, measure=m) for m in ("reward", "cost")]
        except SettingsError:  # no task in common
            continue
        cells.append([f"{best} - {row.agent}", *map(_with_interval, found)])
    if cells:
        note = "Differences on the same tasks, with 95 % intervals:"
        yield Table(["difference", "reward", "cost, s"], cells, note=note)


def _learning(data: Collected, outcomes: TrialOutcomes) -> Iterator[Block]:
    """Yield the learning curves, where an agent has tests of two batches."""
    batch, test = data.batches()
    curves = []
    for name in outcomes.agents:
        own = outcomes.agent == name
        judged = own & test & outcomes.judged
        numbers = np.unique(batch[judged])
        if len(numbers) < 2:
            continue
        trained = own & ~test & (batch >= 0)
        spent = [float(outcomes.cost[trained & (batch < n)].sum()) / _HOUR for n in numbers]
        success = [outcomes.success[judged & (batch == n)] for n in numbers]
        found = np.array([wilson_interval(int(one.sum()), len(one)) for one in success])
        curves.append(
            plots.Series(name or "agent", np.array(spent), found[:, 0], found[:, 2], found[:, 3])
        )
    if curves:
        caption = (
            "Accuracy of each batch's tests over the hours of exploration before it, 95 % band."
        )
        yield Block(title="Learning", figures=[Figure(plots.learning_curve(curves), caption)])


def _calibration(rows: list[SummaryRow], outcomes: TrialOutcomes) -> Block:
    figures = []
    for row in rows:
        positive, truth = outcomes.of_agent(row.agent).beliefs()
        if len(truth):
            drawn = plots.reliability_diagram(positive, truth, small=True)
            caption = f"{row.agent}: ECE {row.ece:.3f}, if calibrated {row.ece_calibrated:.3f}"
            figures.append(Figure(drawn, caption))
    text = (
        "Of all attributes with a final belief of 80 %, 80 % should be true: points on the "
        "diagonal. Bars are 95 % intervals, gray columns the fraction of beliefs in each bin. "
        "The second number of a caption is the expected calibration error (ECE) that calibrated "
        "beliefs of the same values would show."
    )
    return Block(title="Calibration", text=text, figures=figures, kind="small")


def _attributes(agents: Mapping[str, TrialOutcomes]) -> Block:
    asked, right = {}, {}
    for name, own in agents.items():
        known = (own.truth >= 0) & (own.ended == "")[:, None]
        asked[name] = Counter(own.attribute[known].tolist())
        right[name] = Counter(own.attribute[known & (own.report == own.truth)].tolist())
    total = sum(asked.values(), start=Counter[str]())
    cells = []
    for attribute in sorted(total, key=lambda one: (-total[one], one)):
        row: list[str | Cell] = [attribute, f"{total[attribute]:,}"]
        for name in agents:
            n = asked[name][attribute]
            fraction = right[name][attribute] / n if n else 0.0
            row.append(Cell(f"{fraction:.3f}", bar=fraction) if n else "-")
        cells.append(row)
    text = "Fraction of right answers in each attribute; an agent that abstained was not right."
    return Block(
        title="Attributes", text=text, tables=[Table(["attribute", "asked", *agents], cells)]
    )


def _behaviors(agents: Mapping[str, TrialOutcomes]) -> Block:
    executed = {name: own.executed.sum(axis=0) for name, own in agents.items()}
    failed = {name: own.failed.sum(axis=0) for name, own in agents.items()}
    cells = []
    for column, behavior in enumerate(next(iter(agents.values())).behaviors):
        row: list[str | Cell] = [behavior]
        for name in agents:
            done, empty = executed[name][column], failed[name][column]
            bar = done / max(executed[name].sum(), 1)
            row.append(Cell(f"{done:,} ({empty / done:.0%})", bar=bar) if done else "-")
        cells.append(row)
    text = (
        "Executions, and in brackets how many of them were without a percept. A bar is the "
        "behavior's fraction of all that the agent executed."
    )
    return Block(title="Behaviors", text=text, tables=[Table(["behavior", *agents], cells)])


def _run(logs: Logs) -> Block:
    text = json.dumps(logs.header, indent=2, sort_keys=True, ensure_ascii=False)
    files = [[str(file), f"{file.stat().st_size:,}"] for file in logs.files]
    parts = [
        Block(title="Configuration and versions", code=text),
        Block(title="Logs", tables=[Table(["file", "bytes"], files)]),
    ]
    return Block(title="The run", parts=parts)


def _with_interval(found: Interval) -> str:
    if math.isnan(found.se):
        return f"{found.estimate:+.1f}"
    return f"{found.estimate:+.1f} [{found.low:.1f}, {found.high:.1f}]"

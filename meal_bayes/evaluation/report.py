"""One page of a run: how good, how costly, how well calibrated, and where it went wrong."""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np

from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.page import (
    figure,
    figures,
    fold,
    page,
    section,
    share_bar,
    table,
    tiles,
)
from meal_bayes.evaluation.statistics import Interval, wilson_interval
from meal_bayes.evaluation.summary import SummaryRow, compare, summarize
from meal_bayes.evaluation.tally import Tally
from meal_bayes.evaluation.worst import worst_trials
from meal_bayes.files import check_output, write_whole
from meal_bayes.trial_log import Logs, TrialOutcomes
from meal_bayes.trial_log.words import NOT_TOLD

_HOUR = 3600.0  # s
_POINTS = 200  # of a curve
_Z = 1.96  # of a 95 % interval


@dataclass(frozen=True, slots=True)
class ReportInfo:
    """What a report was made of."""

    path: Path
    size: int  # bytes
    trials: int
    agents: tuple[str, ...]


def write_report(
    logs: Logs, path: str | Path, *, on_progress: Callable[[int, int], None] | None = None
) -> ReportInfo:
    """Read logs as far as they can be read and write one self-contained HTML page.

    Parameters
    ----------
    logs : of one data set, as object indices name the clusters of standard errors.
    on_progress : called with (files done, files in all).

    Raises
    ------
    LogError : there is not one trial that can be read.
    OutputError : the page cannot be written, or would replace a log.
    """
    path, tally, read = Path(path), Tally(), set[Path]()
    check_output(path, inputs=logs.files)
    for group in logs.groups():
        if on_progress is not None and group.file not in read:
            on_progress(len(read), len(logs.files))
        read.add(group.file)
        tally.add(group)
    if not tally.trials:
        logs.complain_of_nothing()
    outcomes = tally.outcomes()
    write_whole(path, report_page(tally, outcomes, logs), inputs=logs.files)
    return ReportInfo(path, path.stat().st_size, tally.trials, outcomes.agents)


def report_page(tally: Tally, outcomes: TrialOutcomes, logs: Logs) -> str:
    """Write the page (HTML)."""
    agents = {name or "agent": outcomes.of_agent(name) for name in outcomes.agents}
    rows = summarize(outcomes)
    parts = [
        *_warnings(logs),
        tiles(_facts(outcomes)),
        _agents(rows, outcomes),
        _learning(tally, outcomes) or _so_far(agents),
        _calibration(rows, outcomes),
        _attributes(agents),
        _behaviors(agents),
        worst_trials(tally),
        _run(logs),
    ]
    config = logs.header.get("config")
    name = config.get("dataset") if isinstance(config, dict) else None
    title = f"Trials on {name}" if isinstance(name, str) else "Trials"
    return page(title, ", ".join(str(file) for file in logs.files[:3]) + _more(logs), parts)


def _more(logs: Logs) -> str:
    return f" and {len(logs.files) - 3} more logs" if len(logs.files) > 3 else ""


def _facts(outcomes: TrialOutcomes) -> dict[str, str]:
    agents = len(outcomes.agents)
    return {
        "trials": f"{len(outcomes):,}",
        "steps": f"{outcomes.steps.sum():,}",
        "agents" if agents > 1 else "agent": f"{agents}",
        "objects": f"{len(set(outcomes.object_name.tolist()))}",
        "hours of robot time": f"{outcomes.cost.sum() / _HOUR:.1f}",
    }


def _warnings(logs: Logs) -> Iterator[str]:
    if logs.problems:
        text = "Some of the logs are damaged or unfinished; this page tells of their whole trials."
        items = "".join(f"<li>{escape(problem)}</li>" for problem in logs.problems)
        yield section("Warning", text, f"<ul>{items}</ul>", kind="warning")


def _agents(rows: list[SummaryRow], outcomes: TrialOutcomes) -> str:
    head = ["agent", "trials", "accuracy", "cost, s (sd)", "reward", "NLL", "ECE", "no answer"]
    cells = [
        [
            row.agent, _count(row), _with_error(row.accuracy, row.accuracy_se, 3),
            f"{row.cost_s:.1f} ({_number(row.cost_sd, 1)})",
            _with_error(row.reward, row.reward_se, 1), _number(row.nll, 3), _number(row.ece, 3),
            f"{_number(100 * row.abstained, 1)} %",
        ]
        for row in rows
    ]  # fmt: skip
    best = {}
    if len(rows) > 1:
        for column, key in ((2, "accuracy"), (4, "reward")):
            best[column] = max(range(len(rows)), key=lambda i: getattr(rows[i], key))
        for column, key in ((3, "cost_s"), (5, "nll"), (6, "ece")):
            best[column] = min(range(len(rows)), key=lambda i: getattr(rows[i], key))
    names = [row.agent for row in rows]
    accuracy = [_interval(row.accuracy, row.accuracy_se, 0.0, 1.0) for row in rows]
    cost = [
        _interval(row.cost_s, row.cost_sd / math.sqrt(row.trials), 0.0, math.inf) for row in rows
    ]
    drawn = figures(
        figure(
            plots.svg(plots.bars({"": accuracy}, names, y_label="accuracy", share=True)),
            "Share of trials whose answer was right in every attribute, with 95 % intervals.",
        ),
        figure(
            plots.svg(plots.bars({"": cost}, names, y_label="cost of a trial, s")),
            "Mean seconds of behaviors in a trial, with 95 % intervals.",
        ),
    )
    text = (
        "A trial counts as right when all its attributes are; one without an answer does not. "
        "± is one standard error, objects drawn as wholes. NLL (nats) and ECE are of the final "
        "belief."
    )
    differences = _differences(rows, outcomes)
    return section("Agents", text, table(head, cells, best=best), *differences, drawn)


def _differences(rows: list[SummaryRow], outcomes: TrialOutcomes) -> Iterator[str]:
    """Compare every agent with the one that has the highest reward, on the tasks they share."""
    if len(rows) < 2:
        return
    best = max(rows, key=lambda row: row.reward).agent
    cells = []
    for row in rows:
        if row.agent == best:
            continue
        try:
            found = [compare(outcomes, best, row.agent, measure=m) for m in ("reward", "cost")]
        except SettingsError:  # no task in common
            continue
        cells.append([f"{best} - {row.agent}", *(_with_interval(one) for one in found)])
    if cells:
        yield '<p class="note" style="margin-top:.8rem">On the same tasks, 95 % intervals:</p>'
        yield table(["difference", "reward", "cost, s"], cells)


def _learning(tally: Tally, outcomes: TrialOutcomes) -> str:
    """Write the learning curves; nothing where no agent has tests of two batches."""
    batch, test = tally.batches()
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
        found = [wilson_interval(int(values.sum()), len(values)) for values in success]
        curves.append(_series(name or "agent", spent, found))
    if not curves:
        return ""
    words = "Accuracy of each batch's tests over the hours of exploration before it, 95 % band."
    return section("Learning", "", figures(figure(plots.svg(plots.learning_curve(curves)), words)))


def _so_far(agents: dict[str, TrialOutcomes]) -> str:
    curves = []
    for name, own in agents.items():
        hours = np.cumsum(own.cost)[own.judged] / _HOUR
        right = np.cumsum(own.success[own.judged], dtype=int)
        at = np.unique(np.linspace(0, len(right) - 1, min(_POINTS, len(right))).astype(int))
        found = [wilson_interval(int(right[i]), int(i) + 1) for i in at]
        curves.append(_series(name, hours[at].tolist(), found))
    drawn = plots.lines(curves, x_label="robot time, h", y_label="accuracy so far")
    words = "Accuracy of all trials so far over the hours that their behaviors took, 95 % band."
    cost = plots.cost_distribution({name: own.cost for name, own in agents.items()})
    return section(
        "Accuracy and cost",
        "",
        figures(
            figure(plots.svg(drawn), words),
            figure(plots.svg(cost), "Share of trials that cost at most so many seconds."),
        ),
    )


def _series(name: str, x: list[float], found: list[Interval]) -> plots.Series:
    estimate, low, high = ([getattr(f, end) for f in found] for end in ("estimate", "low", "high"))
    return plots.Series(name, np.array(x), np.array(estimate), np.array(low), np.array(high))


def _calibration(rows: list[SummaryRow], outcomes: TrialOutcomes) -> str:
    drawn = []
    for row in rows:
        positive, truth = outcomes.of_agent(row.agent).beliefs()
        if not len(truth):
            continue
        words = (
            f"{row.agent}: expected calibration error {row.ece:.3f}; "
            f"a calibrated belief of these values would show {row.ece_calibrated:.3f}."
        )
        drawn.append(
            figure(plots.svg(plots.reliability_diagram(positive, truth)), words, square=True)
        )
    text = (
        "Of all attributes that the robot believed in with 80 %, 80 % should be true: points on "
        "the diagonal. Final beliefs, 95 % intervals."
    )
    return section("Calibration", text, figures(*drawn))


def _attributes(agents: dict[str, TrialOutcomes]) -> str:
    asked, right = {}, {}
    for name, own in agents.items():
        known = (own.truth >= 0) & (own.ended == "")[:, None]
        asked[name] = Counter(own.attribute[known].tolist())
        right[name] = Counter(own.attribute[known & (own.report == own.truth)].tolist())
    total = sum(asked.values(), start=Counter[str]())
    cells = []
    for attribute in sorted(total, key=lambda one: (-total[one], one)):
        row: list[str] = [attribute, f"{total[attribute]:,}"]
        for name in agents:
            n = asked[name][attribute]
            fraction = right[name][attribute] / n if n else math.nan
            row.append(share_bar(fraction, f"{fraction:.3f}") if n else "-")
        cells.append(row)
    text = "How often an answer was right in this attribute; no answer counts as not right."
    return section("Attributes", text, table(["attribute", "asked", *agents], cells))


def _behaviors(agents: dict[str, TrialOutcomes]) -> str:
    names = next(iter(agents.values())).behaviors
    executed = {name: own.executed.sum(axis=0) for name, own in agents.items()}
    failed = {name: own.failed.sum(axis=0) for name, own in agents.items()}
    use = {name: (executed[name] / len(own)).tolist() for name, own in agents.items()}
    cells = []
    for column, behavior in enumerate(names):
        row = [behavior]
        for name in agents:
            done, empty = executed[name][column], failed[name][column]
            row.append(f"{done:,} ({empty / done:.0%})" if done else "-")
        cells.append(row)
    words = "Executions of each behavior in a trial, in the mean."
    drawn = figures(
        figure(plots.svg(plots.behavior_use(use, names)), words),
        "<div><p class='note'>Executions in all, and the share without a percept.</p>"
        + table(["behavior", *agents], cells)
        + "</div>",
    )
    return section("Behaviors", "", drawn)


def _run(logs: Logs) -> str:
    files = [[str(file), f"{file.stat().st_size:,}"] for file in logs.files]
    text = json.dumps(logs.header, indent=2, sort_keys=True, ensure_ascii=False)
    told = fold("Configuration and versions", f"<pre>{escape(text)}</pre>")
    return section("The run", "", told, fold("Logs", table(["file", "bytes"], files)))


def _interval(estimate: float, se: float, low: float, high: float) -> Interval:
    reach = 0.0 if math.isnan(se) else _Z * se
    return Interval(estimate, se, max(estimate - reach, low), min(estimate + reach, high))


def _count(row: SummaryRow) -> str:
    missing = row.trials - row.judged
    return f"{row.trials:,}" + f", {missing:,} {NOT_TOLD}" * (missing > 0)


def _with_error(value: float, se: float, digits: int) -> str:
    if math.isnan(value):
        return NOT_TOLD
    return f"{value:.{digits}f}" + ("" if math.isnan(se) else f" ± {se:.{digits}f}")


def _with_interval(found: Interval) -> str:
    if math.isnan(found.se):
        return f"{found.estimate:+.1f}"
    return f"{found.estimate:+.1f} [{found.low:.1f}, {found.high:.1f}]"


def _number(value: float, digits: int) -> str:
    return "-" if math.isnan(value) else f"{value:.{digits}f}"

"""One page of a run: accuracy, cost, calibration, and the trials with the lowest reward.

Sections are dictionaries, whose entries stand at the head of `templates/report.html`.
"""

import base64
import contextlib
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jinja2 import Environment, PackageLoader

from meal_bayes.arrays import Ints
from meal_bayes.display import percent
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.canvas import render
from meal_bayes.evaluation.statistics import wilson_interval
from meal_bayes.evaluation.summary import SummaryRow, compare, mean_effect, summarize
from meal_bayes.files import check_output, write_whole
from meal_bayes.trial_log import Group, Logs
from meal_bayes.trials import Trial, TrialOutcomes, percept_labels
from meal_bayes.trials.text import UNKNOWN, outcome_facts

_HOUR = 3600.0  # s
_SHORT = 0.1  # h, below which a time is shown in s
WORST = 10  # trials that are kept whole
_OPENED = 3  # of these, that are not folded

Section = dict[str, Any]


class Worst(NamedTuple):
    """A trial with one of the lowest rewards, its number in its file, its outcome as one row.

    `trial` is None of a compact log; `badness` is the belief in the report less the reward.
    """

    file: Path
    number: int
    outcome: TrialOutcomes
    trial: Trial | None
    badness: float


def write_report(
    logs: Logs, path: str | Path, *, on_progress: Callable[[int, int], None] | None = None
) -> TrialOutcomes:
    """Read logs as far as they can be read, write one self-contained HTML page, return outcomes.

    They are of one data set, as objects are the clusters of standard errors; a `LogError` where not
    one trial can be read. `on_progress` is called with (files done, files in all).
    """
    path, read = Path(path), set[Path]()
    parts, batches, worst = list[TrialOutcomes](), list[Ints](), list[Worst]()
    check_output(path, inputs=logs.files)
    for group in logs.groups():
        read.add(group.file)
        if on_progress is not None:
            on_progress(len(read) - 1, len(logs.files))
        # An online run names the batch of a log, and its part, in the header.
        number, part = group.header.get("batch"), group.header.get("part")
        known = part in ("train", "test") and isinstance(number, int)
        batch: Any = (number if known else -1, part == "test")
        batches.append(np.full((len(group.outcomes), 2), batch))
        parts.append(group.outcomes)
        worst = worst_of(worst, group)
    outcomes = TrialOutcomes.join(parts)
    write_whole(path, _page(outcomes, np.concatenate(batches), worst, logs), inputs=logs.files)
    return outcomes


def worst_of(worst: Sequence[Worst], group: Group) -> list[Worst]:
    """Return the worst of some trials and of a group: those with the lowest reward.

    Of equals, those that were surest come first, then the earliest.
    """
    outcomes, judged = group.outcomes, np.flatnonzero(group.outcomes.judged)
    badness = outcomes.certainty - outcomes.reward
    entries = [
        Worst(group.file, group.places[row], outcomes.rows([row]),
              group.trials[row] if group.trials else None, badness[row])
        for row in judged[np.argsort(-badness[judged], kind="stable")[:WORST]].tolist()
    ]  # fmt: skip
    return sorted([*worst, *entries], key=lambda entry: -entry.badness)[:WORST]


def _page(outcomes: TrialOutcomes, batches: Ints, worst: Sequence[Worst], logs: Logs) -> str:
    """Return the page as HTML; of a single trial, the trial without statistics.

    Batches (n,2) are the number of each trial's, -1 without one, and whether it is a test.
    """
    agents = {name or "agent": outcomes.of_agent(name) for name in outcomes.agents}
    sections = list[Section]()
    if logs.problems:
        sections.append({"title": "Warning", "problems": logs.problems, "kind": "warning"})
    if len(outcomes) > 1:
        rows = summarize(outcomes)
        sections += [
            _agents(rows, agents, outcomes),
            *_learning(batches, outcomes),
            _calibration(rows, agents),
            _attributes(agents),
            _behaviors(agents),
        ]
    title = "The worst trials" if len(outcomes) > 1 else "The trial"
    parts = [_trial(bad) | {"opened": i < _OPENED} for i, bad in enumerate(worst)]
    header = json.dumps(logs.header, indent=2, sort_keys=True, ensure_ascii=False)
    files = [[str(file), f"{file.stat().st_size:,}"] for file in logs.files]
    run = [
        {"title": "Configuration and versions", "code": header},
        {"title": "Logs", "tables": [{"head": ["file", "bytes"], "rows": files}]},
    ]
    sections += [{"title": title, "parts": parts}, {"title": "The run", "parts": run}]
    config = logs.header.get("config")
    name = config.get("dataset") if isinstance(config, dict) else None
    source = logs.files[0].name
    if len(logs.files) > 1:
        folder = os.path.commonpath([file.resolve() for file in logs.files])
        source = f"{len(logs.files)} logs in {Path(folder).name}"
    numbers = {
        "trial": len(outcomes),
        "step": int(outcomes.steps.sum()),
        "agent": len(outcomes.agents),
        "object": len(set(outcomes.object_name.tolist())),
    }
    facts = {name + "s" * (n != 1): f"{n:,}" for name, n in numbers.items()}
    hours = float(outcomes.cost.sum()) / _HOUR
    unit, amount = ("hours", hours) if hours > _SHORT else ("seconds", _HOUR * hours)
    facts[f"{unit} of robot time"] = f"{amount:.1f}"
    environment = Environment(loader=PackageLoader("meal_bayes.evaluation"), autoescape=True)
    environment.filters["base64"] = lambda ax: base64.b64encode(render(ax, "svg")).decode()
    page = environment.get_template("report.html").render(
        title=f"Trials on {name}" if isinstance(name, str) else "Trials",
        source=source,
        facts=facts,
        blocks=sections,
    )
    return page + "\n"


def _number(value: float, digits: int, se: float = math.nan, unknown: str = "-") -> str:
    error = "" if math.isnan(se) else f" ± {se:.{digits}f}"
    return unknown if math.isnan(value) else f"{value:.{digits}f}{error}"


def _counted(row: SummaryRow, broken: int) -> str:
    """Return how many trials there are, and how many of them are not judged, and why."""
    facts = {UNKNOWN: row.trials - row.judged - broken, "broken off": broken}
    return f"{row.trials:,}" + "".join(f", {n:,} {why}" for why, n in facts.items() if n)


def _agents(
    rows: list[SummaryRow], agents: Mapping[str, TrialOutcomes], outcomes: TrialOutcomes
) -> Section:
    head = ["agent", "trials", "accuracy", "cost, s (sd)", "reward", "NLL", "ECE", "abstained"]
    cells: list[list[str | Section]] = [
        [name, _counted(row, int((part.ended != "").sum())),
         UNKNOWN if math.isnan(row.accuracy) else
         f"{row.accuracy:.3f} [{_number(row.accuracy_low, 3)}, {_number(row.accuracy_high, 3)}]",
         f"{row.cost_s:.1f} ({_number(row.cost_sd, 1)})",
         _number(row.reward, 1, row.reward_se, UNKNOWN),
         _number(row.nll, 3), _number(row.ece, 3), f"{_number(100 * row.abstained, 1)} %"]
        for row, (name, part) in zip(rows, agents.items(), strict=True)
    ]  # fmt: skip
    # Neither cost nor ECE has a best: both are low where an agent does nothing.
    best = {
        2: best_of([round(row.accuracy, 3) for row in rows]),
        4: best_of([round(row.reward, 1) for row in rows]),
        5: best_of([-round(row.nll, 3) for row in rows]),
    }
    for column, places in best.items():
        for place in places:
            cells[place][column] = {"text": cells[place][column], "best": True}
    figures = []
    if max(map(len, agents.values())) > 1:
        points = {
            name: (mean_effect(part, "success").interval(), mean_effect(part, "cost").interval())
            for name, part in agents.items()
            if part.judged.any()
        }
        if points:
            caption = "Accuracy over mean cost with 95 % intervals; objects are clusters."
            figures.append((plots.accuracy_and_cost(points), caption))
        costs = {name: part.cost[part.ended == ""] for name, part in agents.items()}
        caption = "Fraction of trials that cost at most so many seconds."
        figures.append((plots.cost_distribution(costs), caption))
    return {
        "title": "Agents",
        "tables": [{"head": head, "rows": cells}, *_differences(rows, outcomes)],
        "figures": figures,
    }


def best_of(merits: Sequence[float]) -> set[int]:
    """Return the positions of the largest merit; none where all are equal or unknown."""
    known = {merit for merit in merits if not math.isnan(merit)}
    return {n for n, merit in enumerate(merits) if len(known) > 1 and merit == max(known)}


def _differences(rows: list[SummaryRow], outcomes: TrialOutcomes) -> Iterator[Section]:
    """Compare every agent with the one that has the highest reward, on the tasks they share."""
    best = max(rows, key=lambda row: -math.inf if math.isnan(row.reward) else row.reward).agent
    cells = []
    for other in (row.agent for row in rows if row.agent != best):
        texts = [f"{best} - {other}"]
        with contextlib.suppress(SettingsError):  # no task in common
            for measure in ("reward", "cost"):
                estimate, se, low, high = compare(outcomes, best, other, measure=measure)
                interval = "" if math.isnan(se) else f" [{low:.1f}, {high:.1f}]"
                texts.append(f"{estimate:+.1f}{interval}")
            cells.append(texts)
    if cells:
        note = "Differences on the same tasks, with 95 % intervals:"
        yield {"head": ["difference", "reward", "cost, s"], "rows": cells, "note": note}


def _learning(batches: Ints, outcomes: TrialOutcomes) -> Iterator[Section]:
    """Yield the learning curves, where an agent has tests of two batches."""
    batch, test = batches.T
    curves = []
    for name in outcomes.agents:
        rows = outcomes.agent == name
        judged = rows & (test == 1) & outcomes.judged
        numbers = np.unique(batch[judged])
        if len(numbers) < 2:
            continue
        trained = rows & (test == 0) & (batch >= 0)
        hours = [float(outcomes.cost[trained & (batch < n)].sum()) / _HOUR for n in numbers]
        success = [outcomes.success[judged & (batch == n)] for n in numbers]
        accuracy = np.array([wilson_interval(int(each.sum()), len(each)) for each in success])
        curves.append(plots.Series(name or "agent", np.array(hours), *accuracy[:, [0, 2, 3]].T))
    if curves:
        text = "Accuracy of each batch's tests over the hours of exploration before it, 95 % band."
        yield {"title": "Learning", "figures": [(plots.learning_curve(curves), text)]}


def _calibration(rows: list[SummaryRow], agents: Mapping[str, TrialOutcomes]) -> Section:
    figures = []
    for row, outcomes in zip(rows, agents.values(), strict=True):
        if not math.isnan(row.ece):
            drawn = plots.reliability_diagram(*outcomes.beliefs(), small=True)
            caption = f"{row.agent}: ECE {row.ece:.3f}, if calibrated {row.ece_calibrated:.3f}"
            figures.append((drawn, caption))
    return {"title": "Calibration", "figures": figures, "kind": "small"}


def _attributes(agents: Mapping[str, TrialOutcomes]) -> Section:
    counts, total = [], Counter[str]()
    for outcomes in agents.values():
        known = (outcomes.truth >= 0) & (outcomes.ended == "")[:, None]
        right = known & (outcomes.report == outcomes.truth)
        counts.append([Counter(outcomes.attribute[mask].tolist()) for mask in (known, right)])
        total += counts[-1][0]
    cells = []
    for attribute in sorted(total, key=lambda name: (-total[name], name)):
        row: list[str | Section] = [attribute, f"{total[attribute]:,}"]
        for asked, answered in counts:
            fraction = answered[attribute] / max(asked[attribute], 1)
            row.append({"text": f"{fraction:.3f}", "bar": fraction} if asked[attribute] else "-")
        cells.append(row)
    table = {"head": ["attribute", "asked", *agents], "rows": cells}
    return {"title": "Attributes", "tables": [table]}


def _behaviors(agents: Mapping[str, TrialOutcomes]) -> Section:
    counts = [(part.executed.sum(axis=0), part.failed.sum(axis=0)) for part in agents.values()]
    cells = []
    for column, behavior in enumerate(next(iter(agents.values())).behaviors):
        row: list[str | Section] = [behavior]
        for executed, failed in counts:
            done, bar = executed[column], executed[column] / max(executed.sum(), 1)
            text = f"{done:,} ({failed[column] / max(done, 1):.0%})"
            row.append({"text": text, "bar": bar} if done else "-")
        cells.append(row)
    return {"title": "Behaviors", "tables": [{"head": ["behavior", *agents], "rows": cells}]}


def _trial(worst: Worst) -> Section:
    file, number, outcome, trial, _ = worst
    facts, verdict = outcome_facts(outcome, 0), "abstained"
    if outcome.answered[0]:
        verdict = "right" if outcome.success[0] else "wrong"
    title = "trial {}: {question} {object}, {agent}: {answer}; {cost}".format(number, **facts)
    text = f"truth: {facts['truth']}"
    if trial is None:
        return {"title": title, "verdict": verdict, "text": f"{text}; {file} holds no steps"}
    caption = (
        "Belief after each step; the circles at the end are the truth. A gap is the reward that \
the best action may be worth more, at most, where a bound is known."
    )
    head = ["", "behavior", "s", "percept", "belief", "gap"]
    return {
        "title": title,
        "verdict": verdict,
        "text": text,
        "command": f"meal-bayes view {file} --trial {number}",
        "tables": [{"head": head, "rows": list(_steps(trial)), "texts": (1, 3, 4)}],
        "figures": [(plots.belief_trace(trial), caption)] if len(trial.steps) > 1 else [],
    }


def _steps(trial: Trial) -> Iterator[list[str]]:
    momdp = trial.momdp
    for number, step in enumerate(trial.steps, start=1):
        action, percept = step.decision.action, step.warning or "-"
        if action >= momdp.n_behaviors:
            percept = step.warning
        elif step.observation is not None:
            percept = ", ".join(percept_labels(momdp, action, step.observation))
        belief = ", ".join(map(percent, step.belief.positive.tolist()))
        gap = "" if step.decision.gap is None else f"{step.decision.gap:.1f}"
        label = momdp.action_label(action)
        yield [str(number), label, f"{step.cost:g}", percept, belief, gap]

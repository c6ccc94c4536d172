"""Sections of a page about many trials: agents, learning, calibration, attributes, behaviors."""

import dataclasses
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from statistics import fmean

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools
from meal_bayes.display import AMOUNT, ERROR_TEXT, FRACTION
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.learning import POOLED
from meal_bayes.evaluation.logged import LoggedOutcomes
from meal_bayes.evaluation.page import Cell, Section, Table
from meal_bayes.evaluation.statistics import MASS_TEXT, clustered
from meal_bayes.evaluation.summary import (
    SummaryRow,
    accuracy_text,
    compare,
    estimate_mean,
    no_better_than_prior,
    reward_text,
    summarize,
)
from meal_bayes.palette import ordered_agents
from meal_bayes.trials import BatchOutcomes, TrialOutcomes
from meal_bayes.trials.text import UNKNOWN

_FEW = 10  # trials, below which a bar is gray


def sections_of(logged: LoggedOutcomes, reference: str) -> list[Section]:
    """Return the sections about all trials; others are compared with the reference."""
    measured = logged.measured().outcomes
    rows = _summaries(logged)
    agents = {row.agent or "agent": measured.of_agent(row.agent) for row in rows}
    sections = [
        _agents(rows, agents, measured, reference),
        _calibration(rows, logged),
        _attributes(agents),
        _behaviors(agents),
    ]
    for section in sections:
        if logged.heading:
            section["lead"] = logged.heading
    sections[1:1] = _learning(logged.batches())
    return sections


def finding_of(logged: LoggedOutcomes) -> str:
    """Say which agent earns most, and from which others that is not told apart."""
    measured = logged.measured().outcomes
    rows = [row for row in _summaries(logged) if not math.isnan(row.reward)]
    if not rows:
        return ""
    best = max(rows, key=lambda row: row.reward)
    earned = f"{best.agent or 'The agent'} earns {best.reward:{AMOUNT}} a trial"
    if len(rows) == 1:
        return f"{earned}, and is right in {best.accuracy:.1%} of {best.judged:,} trials."
    near = list[str]()
    behind = list[str]()
    for row in rows:
        if row.agent == best.agent:
            continue
        try:
            less = compare(measured, row.agent, best.agent)
        except SettingsError:  # no task in common
            continue
        text = f"{row.agent} ({less.text(signed=True)})"
        (behind if less.high < 0 else near).append(text)
    parts = [f"{earned}, the most"]
    if behind:
        parts.append(f"ahead of {', '.join(behind)}")
    if near:
        parts.append(f"not told apart from {', '.join(near)}")
    text = "; ".join(parts) + f". Differences are of the same tasks, with {MASS_TEXT} intervals."
    return f"{text} {no_better_than_prior(measured)}".rstrip()


def _number(value: float, form: str = FRACTION) -> str:
    return "-" if math.isnan(value) else f"{value:{form}}"


def _counted(row: SummaryRow, broken: int) -> str:
    """Return how many trials there are, and how many of them are not judged, and why."""
    facts = {UNKNOWN: row.trials - row.judged - broken, "broken off": broken}
    return f"{row.trials:,}" + "".join(f", {n:,} {why}" for why, n in facts.items() if n)


def _agents(
    rows: Sequence[SummaryRow],
    agents: Mapping[str, TrialOutcomes],
    outcomes: TrialOutcomes,
    reference: str,
) -> Section:
    head = ["agent", "trials", "accuracy", "cost, s (sd)", "reward", "NLL", "ECE", "abstained"]
    texts = [
        [
            name,
            _counted(row, int((part.ended != "").sum())),
            accuracy_text(row),
            f"{row.cost_s:{AMOUNT}} ({_number(row.cost_sd, AMOUNT)})",
            reward_text(row),
            _number(row.nll),
            _number(row.ece),
            f"{_number(100 * row.abstained, '.1f')} %",
        ]
        for row, (name, part) in zip(rows, agents.items(), strict=True)
    ]
    # Neither cost nor ECE has a best: both are low where an agent does nothing.
    best = {
        "accuracy": best_of([float(f"{row.accuracy:{FRACTION}}") for row in rows]),
        "reward": best_of([float(f"{row.reward:{AMOUNT}}") for row in rows]),
        "NLL": best_of([-round(row.nll, 3) for row in rows]),
    }
    cells: list[list[Cell]] = [list(row_texts) for row_texts in texts]
    for measure, best_rows in best.items():
        column = head.index(measure)
        for index in best_rows:
            cells[index][column] = {"text": texts[index][column], "best": True}
    figures = []
    if max(map(len, agents.values())) > 1:
        points = {
            name: (
                estimate_mean(part, "success").interval(),
                estimate_mean(part, "cost").interval(),
            )
            for name, part in agents.items()
            if part.judged.any()
        }
        if points:
            caption = f"Accuracy over mean cost with {MASS_TEXT} intervals; objects are clusters."
            figures.append((plots.accuracy_and_cost(points), caption))
        whole = {name: part.cost[part.ended == ""] for name, part in agents.items()}
        costs = {name: of_agent for name, of_agent in whole.items() if len(of_agent)}
        if costs:
            caption = "Fraction of trials that cost at most so many seconds."
            figures.append((plots.cost_distribution(costs), caption))
    return {
        "title": "Agents",
        "says": "A trial counts as right when all its attributes are; one that abstained does not. "
        f"[{MASS_TEXT} interval], {ERROR_TEXT}, objects drawn as wholes. NLL (nats) and ECE are of "
        "the final belief. Bold: best accuracy, reward and NLL.",
        "measures": True,
        "tables": [{"head": head, "rows": cells}, *_differences(rows, outcomes, reference)],
        "figures": figures,
    }


def best_of(merits: Sequence[float]) -> set[int]:
    """Return the positions of the largest merit; none where all are equal or unknown."""
    values = {merit for merit in merits if not math.isnan(merit)}
    return {n for n, merit in enumerate(merits) if len(values) > 1 and merit == max(values)}


def _differences(
    rows: Sequence[SummaryRow], outcomes: TrialOutcomes, reference: str
) -> Iterator[Table]:
    """Compare every agent with the reference, on the tasks they share."""
    cells = []
    notes = [f"Differences on the same tasks, with {MASS_TEXT} intervals:"]
    for other in (row.agent for row in rows if row.agent != reference):
        texts = [other]
        try:
            for measure in ("reward", "cost"):
                gain = compare(outcomes, other, reference, measure=measure)
                texts.append(gain.text(signed=True))
        except SettingsError as fault:
            notes.append(str(fault))
        else:
            cells.append(texts)
    if cells or len(notes) > 1:
        head = [f"less {reference}", "reward", "cost, s"]
        yield {"head": head, "rows": cells, "note": " ".join(notes if cells else notes[1:])}


def _summaries(logged: LoggedOutcomes) -> list[SummaryRow]:
    """Summarize the trials that measure each agent; ECE pools the tests after some batches."""
    measured = logged.measured()
    # ECE of few beliefs is biased up: it pools the tests after some batches, as the terminal does.
    pooled = logged.measured(POOLED).outcomes
    rows = {row.agent: row for row in summarize(measured.outcomes)}
    for row in summarize(pooled):
        rows[row.agent] = dataclasses.replace(
            rows[row.agent], ece=row.ece, ece_calibrated=row.ece_calibrated
        )
    return [rows[name] for name in ordered_agents(rows)]


def _learning(results: Sequence[BatchOutcomes]) -> Iterator[Section]:
    """Yield the learning curves, where an agent has tests after two batches."""
    curves = []
    for name in ordered_agents(result.agent for result in results):
        of_agent = [result for result in results if result.agent == name]
        points = []
        for batch in sorted({result.batch for result in of_agent}):
            tests = [result for result in of_agent if result.batch == batch]
            joined = TrialOutcomes.join([result.outcomes for result in tests])
            if joined.judged.any():
                accuracy = estimate_mean(joined, "success").interval()
                hours = fmean(result.hours for result in tests)
                points.append((hours, accuracy.estimate, accuracy.low, accuracy.high))
        if len(points) > 1:
            curves.append(plots.Series(name or "agent", *np.transpose(points)))
    if curves:
        text = (
            "Accuracy of each batch's tests over the mean hours of exploration before it, "
            f"{MASS_TEXT} band, objects drawn as wholes."
        )
        yield {"title": "Learning", "figures": [(plots.learning_curve(curves), text)]}


def _calibration(rows: Sequence[SummaryRow], logged: LoggedOutcomes) -> Section:
    figures = []
    pooled = logged.measured(POOLED).outcomes
    for row in rows:
        if not math.isnan(row.ece):
            beliefs = pooled.of_agent(row.agent).beliefs()
            drawn = plots.reliability_diagram(*beliefs, small=True, agent=row.agent)
            caption = f"{row.agent}: ECE {row.ece:.3f}, if calibrated {row.ece_calibrated:.3f}"
            figures.append((drawn, caption))
    return {
        "title": "Calibration",
        "says": "Of all attributes with a final belief of 80 %, 80 % should be true: points on "
        f"the diagonal. Bars are {MASS_TEXT} intervals, gray columns the fraction of beliefs in "
        "each bin. The second number of a caption is the expected calibration error (ECE) that "
        "calibrated beliefs of the same values would show.",
        "figures": figures,
        "kind": "small",
    }


def _attributes(agents: Mapping[str, TrialOutcomes]) -> Section:
    counts = Counter[str]()
    for outcomes in agents.values():
        counts.update(outcomes.attribute[_answerable(outcomes)].tolist())
    trials = {
        attribute: [_right(outcomes, attribute) for outcomes in agents.values()]
        for attribute in sorted(counts, key=lambda name: (-counts[name], name))
    }
    cells = []
    for attribute, columns in trials.items():
        numbers = sorted({len(right) for right, _ in columns if len(right)})
        counted = "-".join(f"{n:,}" for n in (numbers[0], numbers[-1])[: len(numbers)])
        row: list[Cell] = [attribute, counted]
        for right, objects in columns:
            if not len(right):
                row.append("-")
                continue
            estimate, _, low, high = clustered(right, objects, fraction=True).interval()
            few = len(right) < _FEW
            text = f"{estimate:{FRACTION}}"
            row.append({"text": text, "bar": estimate, "low": low, "high": high, "few": few})
        cells.append(row)
    head = ["attribute", "trials an agent", *agents]
    return {
        "title": "Attributes",
        "says": f"Fraction of right answers in each attribute, with its {MASS_TEXT} interval as a "
        f"line on the bar; gray: fewer than {_FEW} trials. An agent that abstained was not right.",
        "measures": True,
        "tables": [{"head": head, "rows": cells}],
    }


def _answerable(outcomes: TrialOutcomes) -> Bools:
    """Return whether the truth of each attribute is known, of trials that ended, (n,N)."""
    return np.asarray((outcomes.truth >= 0) & (outcomes.ended == "")[:, None])


def _right(outcomes: TrialOutcomes, attribute: str) -> tuple[Bools, NDArray[np.object_]]:
    """Return whether an attribute was answered rightly in each trial, and the objects, (M,)."""
    answerable = _answerable(outcomes) & (outcomes.attribute == attribute)
    right = (outcomes.report == outcomes.truth) & answerable
    trials = answerable.any(axis=1)
    return right.any(axis=1)[trials], outcomes.object_name[trials]


def _behaviors(agents: Mapping[str, TrialOutcomes]) -> Section:
    counts = [
        (outcomes.executed.sum(axis=0), outcomes.failed.sum(axis=0)) for outcomes in agents.values()
    ]
    cells = []
    for column, behavior in enumerate(next(iter(agents.values())).behaviors):
        row: list[Cell] = [behavior]
        for executed, failed in counts:
            n = executed[column]
            text = f"{n:,} ({failed[column] / max(n, 1):.0%})"
            fraction = n / max(executed.sum(), 1)
            row.append({"text": text, "bar": fraction} if n else "-")
        cells.append(row)
    return {
        "title": "Behaviors",
        "says": "Executions, and in brackets how many of them were without a percept. A bar is the "
        "behavior's fraction of all that the agent executed; full is all.",
        "tables": [{"head": ["behavior", *agents], "rows": cells}],
    }

"""A report: one page of a run, in the order in which a reader asks.

What was compared and who is ahead; how each agent learned; whether its beliefs are calibrated;
three telling trials; what is answered rightly, attribute by attribute; then all trials, folded. The
page is self-contained: no script, nothing fetched, every text escaped.
"""

import base64
import dataclasses
import json
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from statistics import fmean
from typing import Any, TypedDict

import numpy as np
from jinja2 import Environment, PackageLoader
from numpy.typing import NDArray

from meal_bayes.arrays import Bools
from meal_bayes.canvas import Axes
from meal_bayes.domain.words import denied
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation import plots
from meal_bayes.evaluation.learning import POOLED
from meal_bayes.evaluation.logged import (
    TEST,
    TRAINING,
    AgentPart,
    LoggedOutcomes,
    ShownTrial,
    ShownTrials,
    worst_first,
)
from meal_bayes.evaluation.statistics import MASS_TEXT, Interval, clustered
from meal_bayes.evaluation.summary import (
    Comparison,
    SummaryRow,
    accuracy_text,
    comparisons,
    estimate_mean,
    no_better_than_prior,
    reward_text,
    summarize,
)
from meal_bayes.files import check_output, checked_path, command_line, write_whole
from meal_bayes.look import (
    AMOUNT,
    FRACTION,
    ordered_agents,
    percent,
    reference_agent,
    render,
)
from meal_bayes.trial_log import Group, Logs
from meal_bayes.trial_log.folder import begun_text
from meal_bayes.trials import BatchOutcomes, Trial, TrialOutcomes
from meal_bayes.trials.outcomes import HOUR
from meal_bayes.trials.text import (
    UNKNOWN,
    attribute_labels,
    outcome_facts,
    trial_reward_text,
    verdict_word,
)

_WORST = "worst"  # name of the trial with the lowest reward, to which the head of a page links
_FEW = 10  # trials, below which a bar is gray
_LISTED = 200  # trials of one list
_NAMED = 4  # agents that a title names
_BLOCK = 5  # least trials of a block of a lab's curve
_BLOCKS = 10  # of them at most
_LEARNED = 0.9  # right answers of an attribute, from which on it counts as learned
_SHORT = 0.1  # h, below which a time is shown in s


class MarkedCell(TypedDict, total=False):
    """A cell that is more than text."""

    text: str
    best: bool  # in bold
    right: bool  # a verdict, in the color of right or wrong
    bar: float  # from 0 to 1, beside the text;
    low: float  # its interval, where there is one,
    high: float
    few: bool  # and whether it is of few trials


Cell = str | MarkedCell


class Table(TypedDict, total=False):
    """A table, under its note."""

    head: Sequence[str]
    rows: Sequence[Sequence[Cell]]
    texts: Sequence[int]  # columns that are aligned as text
    note: str


class Section(TypedDict, total=False):
    """A section of a page, or a part of one; every entry but the title may be left out."""

    title: str
    lead: str  # which trials it counts
    says: str  # what it shows, on every page
    kind: str  # "warning", or "small" where the figures are
    text: str
    problems: Sequence[str]
    command: str
    code: str
    figures: Sequence[tuple[Axes, str]]  # with captions, which are the alternative texts as well
    wide: bool  # figures as wide as the page, before the tables
    tables: Sequence[Table]
    parts: Sequence["Section"]  # shown folded,
    opened: bool  # but for a part that is opened
    verdict: str  # of a part, before its title,
    anchor: str  # name that links on the page lead to
    right: bool  # whose color shows whether it is "right"


def write_report(
    logs: Logs,
    path: str | Path,
    *,
    reference: str | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> TrialOutcomes:
    """Read logs as far as they can be read, write one self-contained HTML page, return outcomes.

    Of an online run, tests after the last batch are the measures; the curves have all batches.

    Parameters
    ----------
    logs : Logs
        Of one data set, as objects are the clusters of standard errors.
    path : str | Path
        The page.
    reference : str | None
        Agent that the others are compared with; by default the paper's, else the first in order.
    on_progress : Callable[[int, int], None] | None
        Called with (files done, files in all).

    Raises
    ------
    LogError
        Not one trial can be read.
    SettingsError
        A reference that has no trial.
    """
    path = checked_path("The report", path)
    check_output(path, inputs=logs.files)
    trials = ShownTrials()
    files = set[Path]()

    def take(group: Group) -> None:
        files.add(group.file)
        if on_progress is not None:
            on_progress(len(files) - 1, len(logs.files))
        trials.take(group)

    logged = LoggedOutcomes.read(logs, on_group=take)
    agents = logged.outcomes.agents
    if reference is not None and reference not in agents:
        raise SettingsError(
            f"The reference {reference!r} has no trial here; expected one of {', '.join(agents)}."
        )
    page = _page(logged, trials, logs, reference or reference_agent(agents))
    write_whole(path, page, inputs=logs.files)
    return logged.outcomes


def _page(logged: LoggedOutcomes, trials: ShownTrials, logs: Logs, reference: str) -> str:
    """Return the page as HTML."""
    sections = list[Section]()
    if logs.problems:
        says = (
            "Some of the logs are damaged or unfinished; this page shows what can be read of them."
        )
        sections.append(
            {"title": "Warning", "says": says, "kind": "warning", "problems": logs.problems}
        )
    if logs.copies:
        says = "Some of the logs are there more than once."
        sections.append(
            {"title": "Copies", "says": says, "kind": "warning", "problems": [logs.copies]}
        )
    if len(logged.outcomes) == 1:
        (only,) = trials.newest
        head = _single(only)
        if only.trial is not None:
            sections.append({**_trial_content(only, only.trial), "title": "The trial"})
    else:
        head = _many(logged, trials, logs)
        sections += _sections(logged, trials, reference)
    # A title above nothing would read as a finding.
    sections = [section for section in sections if _says_something(section)]
    sections.append({"title": "The run", "parts": _run(logs)})
    environment = Environment(loader=PackageLoader("meal_bayes.evaluation"), autoescape=True)
    environment.filters["base64"] = lambda ax: base64.b64encode(
        render(ax, "svg", transparent=True)
    ).decode()
    template = environment.get_template("report.html")
    return template.render(**head, blocks=sections) + "\n"


def _sections(logged: LoggedOutcomes, trials: ShownTrials, reference: str) -> Iterator[Section]:
    """Yield the sections about many trials, in the order of a reader's questions."""
    measured = logged.measured().outcomes
    rows = _summaries(logged)
    agents = {row.agent or "agent": measured.of_agent(row.agent) for row in rows}
    lead = logged.heading
    yield {**_agents(rows, agents, measured, reference), "lead": lead}
    yield from _learning(logged.batches())
    if trials.lab:
        yield from _progress(logged.outcomes)
        yield _learned(logged.outcomes)
    yield {**_calibration(rows, logged), "lead": lead}
    yield _telling(logged, trials, rows)
    yield {**_attributes(agents), "lead": lead}
    yield {**_behaviors(agents), "lead": lead}
    yield _all_trials(logged, trials)


def _says_something(section: Section) -> bool:
    """Return whether a section has content beside its title and what it says of trials."""
    tables = section.get("tables", ())
    filled = any(table["rows"] or table.get("note") for table in tables)
    return filled or any(section.get(name) for name in ("problems", "figures", "parts", "code"))


def _single(shown_trial: ShownTrial) -> dict[str, Any]:
    """Return title, source and facts of a page about one trial."""
    facts = outcome_facts(shown_trial.outcome, 0)
    unjudged = "none" if shown_trial.outcome.ended[0] else UNKNOWN
    cards = {
        "answer": facts["answer"],
        "truth": facts["truth"] or "unknown",
        "verdict": _verdict_of(shown_trial.outcome, 0) or unjudged,
        "seconds": f"{shown_trial.outcome.cost[0]:{AMOUNT}}",
        "reward": trial_reward_text(float(shown_trial.outcome.reward[0])),
    }
    return {
        "title": shown_trial.question,
        "source": f"{facts['object']}, {facts['agent']}, from {shown_trial.file.name}",
        "facts": cards,
    }


def _many(logged: LoggedOutcomes, trials: ShownTrials, logs: Logs) -> dict[str, Any]:
    """Return title, source, finding and facts of a page about many trials."""
    outcomes = logged.outcomes
    config = logs.header.get("config")
    name = config.get("dataset") if isinstance(config, dict) else None
    source = logs.files[0].name
    if len(logs.files) > 1:
        folder = os.path.commonpath([file.resolve() for file in logs.files])
        source = f"{len(logs.files)} log files of the folder {Path(folder).name!r}"
    numbers = {
        "trial": len(outcomes),
        "step": int(outcomes.steps.sum()),
        "agent": len(outcomes.agents),
        "object": len(set(outcomes.object_name.tolist())),
    }
    facts = {name if n == 1 else f"{name}s": f"{n:,}" for name, n in numbers.items()}
    hours = float(outcomes.cost.sum()) / HOUR
    if hours > _SHORT:
        facts["hours of robot time"] = f"{hours:.1f}"
    else:
        facts["seconds of robot time"] = f"{HOUR * hours:{AMOUNT}}"
    agents = ordered_agents(outcomes.agents)
    title = f"{len(agents)} agents" if len(agents) > _NAMED else _joined(agents)
    return {
        "title": (title or "Trials") + (f" on {name}" if isinstance(name, str) else ""),
        "source": source,
        "finding": [text for text in _finding(logged) if text],
        "worst": _worst_text(logged, trials),
        "anchor": _WORST,
        "facts": facts,
    }


def _run(logs: Logs) -> list[Section]:
    """Return the settings of the run and the names of its logs."""
    header = json.dumps(logs.header, indent=2, sort_keys=True, ensure_ascii=False)
    files = [[str(file), f"{file.stat().st_size:,}"] for file in logs.files]
    return [
        {"title": "Configuration and versions", "code": header},
        {"title": "Logs", "tables": [{"head": ["file", "bytes"], "rows": files}]},
    ]


def _joined(names: Sequence[str]) -> str:
    """Return names as in a sentence.

    >>> _joined(["morc"]), _joined(["morc", "greedy", "bayes"])
    ('morc', 'morc, greedy and bayes')
    """
    return " and ".join(filter(None, (", ".join(names[:-1]), *names[-1:])))


def _finding(logged: LoggedOutcomes) -> list[str]:
    """Return paragraphs: who earns most, ahead of whom by how much, and whether that is sure."""
    measured = logged.measured().outcomes
    rows = [row for row in _summaries(logged) if not math.isnan(row.reward)]
    if not rows:
        return []
    best, *rest = sorted(rows, key=lambda row: -row.reward)
    if not rest:
        right = f"is right in {best.accuracy:.1%} of {best.judged:,} trials"
        return [
            f"{best.agent or 'The agent'} {right}, with a mean reward of {best.reward:{AMOUNT}}."
        ]
    try:
        others = comparisons(measured, reference=best.agent)
    except SettingsError as fault:  # tasks that do not pair
        return [f"It cannot be said who is ahead. {fault}"]
    behind = [_gain_text(row) for row in others if row.verdict == "behind"]
    level = [_gain_text(row) for row in others if row.verdict != "behind" and row.tasks]
    apart = [row.agent for row in others if not row.tasks]
    texts = [f"{best.agent} has the highest mean reward, {best.reward:{AMOUNT}} a trial."]
    if len(apart) == len(others):
        shown = [float(f"{row.reward:{AMOUNT}}") for row in (best, rest[0])]
        gain = f"{shown[0] - shown[1]:{AMOUNT}} more than {rest[0].agent}, the next"
        texts = [
            f"It cannot be said who is ahead: no other agent had the tasks of {best.agent}, so the "
            "differences may come from the tasks.",
            f"{texts[0][:-1]}: {gain}.",
        ]
        return [" ".join(texts), no_better_than_prior(measured)]
    if behind:
        intervals = "interval lies" if len(behind) == 1 else "intervals lie"
        texts.append(
            f"{best.agent} is ahead of {_joined(behind)}: the {MASS_TEXT} {intervals} above 0."
        )
    if level:
        intervals = "interval contains" if len(level) == 1 else "intervals contain"
        texts.append(
            f"It cannot be said whether {best.agent} is ahead of {_joined(level)}: the {MASS_TEXT} "
            f"{intervals} 0, so the difference may be chance."
        )
    texts.append("These are differences in the mean reward on the same tasks.")
    texts += _costs_text(measured, best.agent)
    if apart:
        verb = "shares" if len(apart) == 1 else "share"
        texts.append(f"{_joined(apart)} {verb} no task with {best.agent}.")
    return [" ".join(texts), no_better_than_prior(measured)]


def _worst_text(logged: LoggedOutcomes, trials: ShownTrials) -> str:
    """Say which trial has the lowest reward, to be followed by a link to it."""
    worst = trials.worst(_parts(logged))
    if worst is None:
        return ""
    facts = outcome_facts(worst.outcome, 0)
    reward = trial_reward_text(float(worst.outcome.reward[0]))
    return (
        f"The lowest reward of a trial is {reward}: {facts['agent'] or 'the agent'}, asked "
        f"\N{LEFT DOUBLE QUOTATION MARK}{worst.question}\N{RIGHT DOUBLE QUOTATION MARK} about "
        f"{facts['object']}."
    )


def _parts(logged: LoggedOutcomes, agent: str | None = None) -> list[AgentPart]:
    """Return the parts of the run that measure an agent, or all agents."""
    measured = logged.measured()
    columns = (measured.outcomes.agent.tolist(), measured.batch.tolist(), measured.part.tolist())
    parts = {AgentPart(*values) for values in zip(*columns, strict=True)}
    return sorted(part for part in parts if agent in (None, part.agent))


def _gain_text(row: Comparison) -> str:
    """Return an agent, and by how much the reference is above it."""
    return f"{row.agent} (by {(-_difference(row)).text(signed=True)})"


def _costs_text(measured: TrialOutcomes, agent: str) -> list[str]:
    """Say which agents are surely dearer or cheaper than one, on the same tasks."""
    rows = [row for row in comparisons(measured, measure="cost", reference=agent) if row.tasks]
    dearer = [f"{row.agent} (by {_difference(row).text()} s)" for row in rows if row.low > 0]
    cheaper = [f"{row.agent} (by {(-_difference(row)).text()} s)" for row in rows if row.high < 0]
    return [
        f"{agent} costs {word} than {_joined(names)}: the {MASS_TEXT} interval does not contain 0."
        for word, names in (("less", dearer), ("more", cheaper))
        if names
    ]


def _rank(value: float) -> float:
    """Return a number by which to sort; what is unknown comes last."""
    return -math.inf if math.isnan(value) else value


def _difference(row: Comparison) -> Interval:
    return Interval(row.difference, math.nan, row.low, row.high)


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
    pairs = sorted(zip(rows, agents.items(), strict=True), key=lambda pair: -_rank(pair[0].reward))
    rows = [row for row, _ in pairs]
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
        for row, (name, part) in pairs
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
    table: Table = {"head": head, "rows": cells}
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
    tables = [*_differences(outcomes, reference), table] if len(rows) > 1 else [table]
    return {
        "title": "Who is ahead" if len(rows) > 1 else "The agent",
        "says": "A trial is right if its answer is right for all attributes; an abstention is "
        f"not right. The reward of a trial is the payoff of its answer minus its cost. Brackets "
        f"contain a {MASS_TEXT} interval, and the number after ± is one standard error; both "
        "take into account that trials with the same object are similar. The standard deviation "
        "(sd) of the cost is in parentheses. NLL (in nats) is the negative log-likelihood of the "
        "final beliefs, and ECE is their expected calibration error. The best accuracy, reward "
        "and NLL are bold, unless all agents have the same value.",
        "tables": tables,
        "figures": figures,
    }


def best_of(merits: Sequence[float]) -> set[int]:
    """Return the positions of the largest merit; none where all are equal or unknown."""
    values = {merit for merit in merits if not math.isnan(merit)}
    return {n for n, merit in enumerate(merits) if len(values) > 1 and merit == max(values)}


def _differences(outcomes: TrialOutcomes, reference: str) -> Iterator[Table]:
    """Compare every agent with the reference, on the tasks that both have."""
    try:
        by_measure = {
            measure: comparisons(outcomes, measure=measure, reference=reference)
            for measure in ("reward", "cost", "success")
        }
    except SettingsError as fault:
        yield {"head": [], "rows": [], "note": f"It cannot be said who is ahead. {fault}"}
        return
    cells = []
    paired = zip(*by_measure.values(), strict=True)
    for reward, cost, success in sorted(paired, key=lambda row: -_rank(row[0].difference)):
        if reward.tasks:
            forms = (AMOUNT, AMOUNT, FRACTION)
            texts = [
                _difference(row).text(form, signed=True)
                for row, form in zip((reward, cost, success), forms, strict=True)
            ]
            cells.append([reward.agent, reward.verdict, f"{reward.tasks:,}", *texts])
    apart = [row.agent for row in by_measure["reward"] if not row.tasks]
    note = f"Differences from {reference} on the same tasks, with {MASS_TEXT} intervals. "
    note += "The verdict refers to the reward, which costs and wrong answers reduce."
    if apart:
        verb = "shares" if len(apart) == 1 else "share"
        nothing = f"{_joined(apart)} {verb} no task with {reference}."
        note = f"{note} {nothing}" if cells else nothing
    head = [
        "agent", "verdict", "tasks", f"reward difference from {reference}", "cost difference, s",
        "accuracy difference",
    ]  # fmt: skip
    yield {"head": head if cells else [], "rows": cells, "texts": (1,), "note": note}


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


def _progress(outcomes: TrialOutcomes) -> Iterator[Section]:
    """Yield the accuracy over the number of trials, a curve for each agent, in blocks.

    Only agents with enough trials of known truth have a curve.
    """
    curves = []
    for name in ordered_agents(outcomes.agents):
        of_agent = outcomes.of_agent(name)
        judged = np.flatnonzero(of_agent.judged)
        blocks = min(len(judged) // _BLOCK, _BLOCKS)
        if blocks < 2:
            continue
        points = []
        # Blocks do not overlap: their errors are independent but for objects.
        for rows in np.array_split(judged, blocks):
            accuracy = estimate_mean(of_agent.rows(rows), "success").interval()
            points.append((rows.mean() + 1, accuracy.estimate, accuracy.low, accuracy.high))
        curves.append(plots.Series(name or "agent", *np.transpose(points)))
    if curves:
        drawn = plots.lines(
            curves, x_label="trials of the agent so far", y_label="accuracy (fraction of trials)"
        )
        drawn.set_ylim(-0.02, 1.02)
        text = (
            f"Accuracy of each agent's trials whose truth is known, in blocks; {MASS_TEXT} band, "
            "objects drawn as wholes."
        )
        yield {"title": "Learning", "figures": [(drawn, text)]}


def _learned(outcomes: TrialOutcomes) -> Section:
    """Return, by attribute, what a lab's robot learned, and which labels it lacks.

    An attribute is learned if at least nine tenths of the answers in the second half of its trials
    are right; else the robot lacks labels of the truth that fewer objects have.
    """
    answerable = _answerable(outcomes)
    entries = []
    for name in sorted({*outcomes.attribute[answerable].tolist()}):
        asked = answerable & (outcomes.attribute == name)
        rows, columns = np.nonzero(asked)
        right = (outcomes.report == outcomes.truth)[rows, columns]
        truth = outcomes.truth[rows, columns]
        objects = [len({*outcomes.object_name[rows[truth == value]].tolist()}) for value in (0, 1)]
        half = len(right) // 2
        entries.append((name, len(right), right[:half], right[half:], objects))
    # The worst first, and of equal ones that with the fewest objects.
    entries.sort(key=lambda entry: (entry[3].mean(), min(entry[4]), entry[0]))
    weak = [entry for entry in entries if entry[3].mean() < _LEARNED]
    learned = [name for name, *_ in entries if name not in {entry[0] for entry in weak}]
    texts = []
    if learned:
        texts.append(f"Learned: {_joined(sorted(learned))}.")
    if weak:
        told = [f"{name} ({later.mean():.0%} right)" for name, _, _, later, _ in weak[:3]]
        texts.append(f"Still badly perceived: {_joined(told)}.")
        lacking = []
        for name, _, _, _, (false, true) in weak[:3]:
            said = name if true <= false else denied(name)
            lacking.append(f"{said} ({min(false, true)} so far)")
        texts.append(f"Label next objects that are: {_joined(lacking)}.")
    cells: list[list[Cell]] = [
        [
            name,
            f"{count:,}",
            f"{before.mean():{FRACTION}}" if len(before) else "-",
            {"text": f"{later.mean():{FRACTION}}", "bar": later.mean(), "few": len(later) < _FEW},
            f"{true:,}",
            f"{false:,}",
        ]
        for name, count, before, later, (false, true) in entries
    ]
    halves = ("right, first half", "right, second half")
    head = ["attribute", "trials", *halves, "objects of truth yes", "of truth no"]
    return {
        "title": "What it learned, and what to label next",
        "says": "Trials whose truth is known, in the order of time. An attribute counts as learned "
        f"if at least {_LEARNED:.0%} of the second half of its answers are right; gray: fewer than "
        f"{_FEW} trials.",
        "text": " ".join(texts),
        "tables": [{"head": head, "rows": cells}],
    }


def _calibration(rows: Sequence[SummaryRow], logged: LoggedOutcomes) -> Section:
    figures = []
    pooled = logged.measured(POOLED).outcomes
    for row in rows:
        if not math.isnan(row.ece):
            beliefs = pooled.of_agent(row.agent).beliefs()
            drawn = plots.reliability_diagram(*beliefs, small=True, agent=row.agent)
            caption = f"{row.agent}: ECE {row.ece:.3f} ({row.ece_calibrated:.3f} by chance)"
            figures.append((drawn, caption))
    return {
        "title": "Calibration",
        "says": "If beliefs are calibrated, 80 % of all attributes with a final belief of 80 % are "
        f"true, and points lie on the diagonal. Bars are {MASS_TEXT} intervals; gray columns are "
        "the fraction of beliefs in each bin. ECE is the expected calibration error. Calibrated "
        "beliefs have one above 0 too, by chance, which stands in brackets.",
        "figures": figures,
        "kind": "small",
    }


def _telling(logged: LoggedOutcomes, trials: ShownTrials, rows: Sequence[SummaryRow]) -> Section:
    """Return the trial with the lowest reward, and three of the agent that earns most, whole.

    Where no truth is known, return the newest trials. Baselines lose many trials; a reader can
    learn from those that the best agent loses.
    """
    entries = [("newest", shown) for shown in reversed(trials.newest)]
    says = "These are the newest trials. The truth of none is known."
    known = [row for row in rows if not math.isnan(row.reward)]
    worst = trials.worst(_parts(logged))
    if known and worst is not None:
        best = max(known, key=lambda row: row.reward).agent
        entries = trials.telling(_parts(logged, best))
        whose = f"{best}, which has the highest mean reward" if len(known) > 1 else best
        says = (
            f"These are trials of {whose or 'the agent'}: the one with the lowest reward, the "
            "right answer that cost most, and the one with the highest reward."
        )
        if worst.outcome.agent[0] != best:
            entries.insert(0, ("the lowest reward of all agents", worst))
            says = says.replace("These", "The first trial has the lowest reward. The others", 1)
    parts = [_trial_section(shown, why) for why, shown in entries]
    parts[0]["opened"] = True
    if worst is not None:
        parts[0]["anchor"] = _WORST
    section: Section = {"title": "Telling trials", "says": says, "parts": parts}
    if any(shown.trial is None for _, shown in entries):
        section["text"] = "A compact log holds the outcome of a trial without its steps."
    return section


def _all_trials(logged: LoggedOutcomes, trials: ShownTrials) -> Section:
    """Return the lists of all trials, folded, tests apart from training trials."""
    last = logged.last_batch
    tested = logged.part == TEST
    parts = {"Trials": logged.part == ""}
    if last is not None:
        parts[f"Tests after batch {last}"] = tested & (logged.batch == last)
        parts["Tests after other batches"] = tested & (logged.batch != last)
    parts["Training trials"] = logged.part == TRAINING
    lists = [
        _list(title, np.flatnonzero(rows), logged, trials)
        for title, rows in parts.items()
        if rows.any()
    ]
    order = "the newest trial" if trials.lab else "the lowest reward"
    return {"title": "All trials", "says": f"Each list begins with {order}.", "parts": lists}


def _list(
    title: str, rows: NDArray[np.intp], logged: LoggedOutcomes, trials: ShownTrials
) -> Section:
    """Return a list of trials: those of a lab newest first, of a run the lowest reward first."""
    outcomes = logged.outcomes.rows(rows)
    places = [trials.places[row] for row in rows.tolist()]
    if trials.lab:
        # Names of a lab's logs begin with the time, so that their order is that of the trials.
        order = sorted(
            range(len(rows)), key=lambda n: (places[n].file.name, places[n].number), reverse=True
        )
    else:
        worst = worst_first(outcomes).tolist()
        order = [*worst, *np.setdiff1d(np.arange(len(rows)), worst).tolist()]
    cells = []
    for n in order[:_LISTED]:
        facts = outcome_facts(outcomes, n)
        place = places[n]
        verdict: Cell = "-"
        word = _verdict_of(outcomes, n)
        if word:
            verdict = {"text": word, "right": bool(outcomes.success[n] == 1)}
        begun = (
            begun_text(place.file) or "-" if trials.lab else f"{place.file.name}, {place.number}"
        )
        cells.append(
            [
                begun,
                facts["agent"] or "agent",
                verdict,
                facts["object"],
                place.question,
                facts["answer"],
                percent(float(outcomes.certainty[n])),
                f"{outcomes.cost[n]:{AMOUNT}}",
                _number(float(outcomes.reward[n]), AMOUNT),
                facts["truth"],
            ]
        )
    head = [
        "time (UTC)" if trials.lab else "log, trial", "agent", "verdict", "object", "question",
        "answer", "belief", "cost, s", "reward", "truth",
    ]  # fmt: skip
    table: Table = {"head": head, "rows": cells, "texts": (1, 2, 3, 4, 5, 9)}
    if len(rows) > _LISTED:
        table["note"] = f"The first {_LISTED} of {len(rows):,} trials."
    return {"title": f"{title}: {len(rows):,}", "tables": [table]}


def _verdict_of(outcomes: TrialOutcomes, row: int) -> str:
    """Return whether a trial's answer is right, that it abstained, or "" where nobody knows."""
    if not outcomes.answered[row]:
        return "" if outcomes.ended[row] else "abstained"
    if not outcomes.judged[row]:
        return ""
    return verdict_word(bool(outcomes.success[row]))


def _trial_section(shown: ShownTrial, why: str) -> Section:
    """Return a trial as a part of a section, its verdict before its title."""
    facts = outcome_facts(shown.outcome, 0)
    title = f"{why}: {shown.question} {facts['object']}, {facts['agent']}: {facts['answer']}"
    section: Section = {
        "title": f"{title}; {facts['cost']}",
        "verdict": _verdict_of(shown.outcome, 0),
        "right": bool(shown.outcome.success[0] == 1),
    }
    if shown.trial is None:
        text = f"trial {shown.number} of {shown.file}; truth: {facts['truth']}"
        return {**section, "text": text}
    return {**section, **_trial_content(shown, shown.trial)}


def _trial_content(shown_trial: ShownTrial, trial: Trial) -> Section:
    """Return the picture of a trial and the table of its steps."""
    caption = (
        "Behaviors, beliefs, and how much more reward was expected from going on than from "
        "answering now. Circles are the truth."
    )
    gaps = any(step.decision.gap is not None for step in trial.steps)
    names = trial.task.query.value_names
    head = ["", "behavior", "s", *names, *(["gap"] if gaps else [])]
    table: Table = {
        "head": head,
        "rows": list(_steps(trial, gaps=gaps)),
        "texts": (1, *range(3, 3 + len(names))),
        "note": "Each attribute has its percept and the belief after it."
        + (" The gap is an upper bound of the reward lost by the chosen action." if gaps else ""),
    }
    facts = outcome_facts(shown_trial.outcome, 0)
    return {
        "text": f"truth: {facts['truth']}",
        "command": command_line(
            "meal-bayes view", shown_trial.file, "--trial", str(shown_trial.number)
        ),
        "tables": [table],
        "figures": [(plots.trial_picture(trial), caption)] if trial.steps else [],
        "wide": True,
    }


def _steps(trial: Trial, *, gaps: bool) -> Iterator[list[str]]:
    momdp = trial.momdp
    for number, step in enumerate(trial.steps, start=1):
        action = step.decision.action
        beliefs = [percent(p) for p in step.belief.positive.tolist()]
        words = [""] * len(beliefs)
        if step.observation is not None:
            words = attribute_labels(momdp, action, step.observation)
        label = trial.momdp.action_label(action)
        if step.warning:
            label += f" ({step.warning})"
        cells = [f"{word}, {p}" if word else p for word, p in zip(words, beliefs, strict=True)]
        row = [str(number), label, f"{step.cost:g}", *cells]
        if gaps:
            gap = step.decision.gap
            row.append("" if gap is None else f"{gap:{AMOUNT}}")
        yield row


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
    weak = _least_right(trials)
    head = ["attribute", "trials an agent", *agents]
    return {
        "title": "Attributes",
        "says": f"Fraction of right answers about each attribute, with a {MASS_TEXT} interval as a "
        f"line on the bar. Bars of fewer than {_FEW} trials are gray. An abstention is not right.",
        "text": weak,
        "tables": [{"head": head, "rows": cells}],
    }


def _least_right(trials: Mapping[str, Sequence[tuple[Bools, NDArray[np.object_]]]]) -> str:
    """Say which attributes are answered rightly least often, by the agent that is best at each.

    Attributes with few trials are left out: their fractions are chance.
    """
    best = {
        attribute: max(float(right.mean()) for right, _ in columns)
        for attribute, columns in trials.items()
        if min(len(right) for right, _ in columns) >= _FEW
    }
    weak = sorted((name for name in best if best[name] < 1), key=lambda name: best[name])[:3]
    if not weak:
        return ""
    told = _joined([f"{name} ({best[name]:.0%})" for name in weak])
    return (
        f"Answers about {told} are right least often, by the agent that is best at each. Labels of "
        "more objects would help most there, or a behavior that perceives them better."
    )


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
        "says": "Number of executions, and in brackets the fraction that gave no percept. A bar is "
        "the behavior's fraction of all executions of the agent.",
        "tables": [{"head": ["behavior", *agents], "rows": cells}],
    }

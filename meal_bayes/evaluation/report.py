"""One page of a run: accuracy, cost, calibration, and the trials with the lowest reward."""

import base64
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader

from meal_bayes.canvas import render
from meal_bayes.display import AMOUNT
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.logged import LoggedOutcomes
from meal_bayes.evaluation.page import Section
from meal_bayes.evaluation.sections import finding_of, sections_of
from meal_bayes.evaluation.summary import estimate_mean
from meal_bayes.evaluation.worst import (
    WORST,
    AgentPart,
    ShownTrial,
    lab_sections,
    live_trials,
    search_finding,
    searches_section,
    shown_rows,
    trial_content,
    verdict_of,
    worst_of,
    worst_section,
)
from meal_bayes.files import check_output, checked_path, write_whole
from meal_bayes.palette import reference_agent
from meal_bayes.trial_log import Group, Logs
from meal_bayes.trials import TrialOutcomes
from meal_bayes.trials.outcomes import HOUR
from meal_bayes.trials.text import UNKNOWN, outcome_facts, trial_reward_text

_SHORT = 0.1  # h, below which a time is shown in s


def write_report(
    logs: Logs,
    path: str | Path,
    *,
    reference: str | None = None,
    on_progress: Callable[[int, int], None] | None = None,
) -> TrialOutcomes:
    """Read logs as far as they can be read, write one self-contained HTML page, return outcomes.

    Of an online run, tests after the last batch are the measures; the curve has all batches.

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
    trials = _Shown()
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


class _Shown:
    """The trials that are shown by themselves: the worst, the first, those of a robot's lab."""

    def __init__(self) -> None:
        self.worst: dict[AgentPart, Sequence[ShownTrial]] = {}
        self.live = list[ShownTrial]()
        self.first: ShownTrial | None = None

    def take(self, group: Group) -> None:
        """Choose from the trials of a group."""
        self.worst = worst_of(self.worst, group)
        self.live += live_trials(group)
        if self.first is None:
            (self.first,) = shown_rows(group, [0])


def _page(logged: LoggedOutcomes, trials: _Shown, logs: Logs, reference: str) -> str:
    """Return the page as HTML."""
    sections = list[Section]()
    searches = list(logs.searches())
    if logs.problems:
        says = (
            "Some of the logs are damaged or unfinished; this page shows what can be read of them."
        )
        sections.append(
            {"title": "Warning", "says": says, "kind": "warning", "problems": logs.problems}
        )
    if len(logged.outcomes) == 1 and trials.first is not None and not logged.searched:
        head = _single(trials.first)
        if trials.first.trial is not None:
            content = trial_content(trials.first, trials.first.trial)
            sections.append({**content, "title": "The trial"})
    else:
        head = _many(logged, logs)
        sections += lab_sections(trials.live) if trials.live else []
        sections += sections_of(logged, reference)
        sections.append(_worst(logged, trials))
    if logged.searched:
        sections = [section for section in sections if not section.get("measures")]
    if searches:
        sections.insert(bool(logs.problems), searches_section(searches))
        finding = "" if logged.searched else head.get("finding", "")
        head["finding"] = f"{search_finding(searches)} {finding}".strip()
    # A title above nothing would read as a finding.
    sections = [section for section in sections if _says_something(section)]
    sections.append({"title": "The run", "parts": _run(logs)})
    environment = Environment(loader=PackageLoader("meal_bayes.evaluation"), autoescape=True)
    environment.filters["base64"] = lambda ax: base64.b64encode(
        render(ax, "svg", transparent=True)
    ).decode()
    template = environment.get_template("report.html")
    return template.render(**head, blocks=sections) + "\n"


def _says_something(section: Section) -> bool:
    """Return whether a section has content beside its title and what it says of trials."""
    tables = section.get("tables", ())
    filled = any(table["rows"] or table.get("note") for table in tables)
    return filled or any(section.get(name) for name in ("problems", "figures", "parts", "code"))


def _worst(logged: LoggedOutcomes, trials: _Shown) -> Section:
    """Return the worst of the trials that measure each agent, the best agent first."""
    measured = logged.measured()
    by_agent = []
    for agent in measured.outcomes.agents:
        rows = measured.outcomes.agent == agent
        batches = measured.batch[rows].tolist()
        parts = measured.part[rows].tolist()
        keys = {AgentPart(agent, *pair) for pair in zip(batches, parts, strict=True)}
        entries = [entry for key in sorted(keys) for entry in trials.worst.get(key, ())]
        if entries:
            reward = estimate_mean(measured.outcomes.rows(rows), "reward").estimate
            by_agent.append((reward, agent, entries[:WORST]))
    # Baselines lose many trials; what the best agent loses is what a reader can learn from.
    best_first = sorted(by_agent, key=lambda entry: -entry[0])
    return worst_section([(agent, entries) for _, agent, entries in best_first])


def _single(shown_trial: ShownTrial) -> dict[str, Any]:
    """Return title, source and facts of a page about one trial."""
    facts = outcome_facts(shown_trial.outcome, 0)
    question = (
        shown_trial.trial.task.question if shown_trial.trial is not None else facts["question"]
    )
    cards = {
        "answer": facts["answer"],
        "truth": facts["truth"] or "unknown",
        "verdict": verdict_of(shown_trial) or ("none" if shown_trial.outcome.ended[0] else UNKNOWN),
        "seconds": f"{shown_trial.outcome.cost[0]:{AMOUNT}}",
        "reward": trial_reward_text(float(shown_trial.outcome.reward[0])),
    }
    return {
        "title": question,
        "source": f"{facts['object']}, {facts['agent']}, from {shown_trial.file.name}",
        "facts": cards,
    }


def _many(logged: LoggedOutcomes, logs: Logs) -> dict[str, Any]:
    """Return title, source, finding and facts of a page about many trials."""
    outcomes = logged.outcomes
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
    facts = {name if n == 1 else f"{name}s": f"{n:,}" for name, n in numbers.items()}
    hours = float(outcomes.cost.sum()) / HOUR
    if hours > _SHORT:
        facts["hours of robot time"] = f"{hours:.1f}"
    else:
        facts["seconds of robot time"] = f"{HOUR * hours:{AMOUNT}}"
    return {
        "title": f"Trials on {name}" if isinstance(name, str) else "Trials",
        "source": source,
        "finding": finding_of(logged),
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

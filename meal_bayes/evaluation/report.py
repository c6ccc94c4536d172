"""One page of a run: accuracy, cost, calibration, and the trials with the lowest reward.

Sections are dictionaries, whose entries stand at the head of `templates/report.html`.
"""

import base64
import json
import os
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader

from meal_bayes.canvas import render
from meal_bayes.errors import SettingsError
from meal_bayes.evaluation.logged import LoggedOutcomes
from meal_bayes.evaluation.sections import sections_of
from meal_bayes.evaluation.worst import Worst, trial_section, worst_of
from meal_bayes.files import check_output, write_whole
from meal_bayes.palette import reference_agent
from meal_bayes.trial_log import Group, Logs
from meal_bayes.trials import TrialOutcomes

_HOUR = 3600.0  # s
_SHORT = 0.1  # h, below which a time is shown in s
_OPENED = 3  # of these, that are not folded

Section = dict[str, Any]


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
    path = Path(path)
    files = set[Path]()
    worst = list[Worst]()
    check_output(path, inputs=logs.files)

    def take(group: Group) -> None:
        nonlocal worst
        files.add(group.file)
        if on_progress is not None:
            on_progress(len(files) - 1, len(logs.files))
        worst = worst_of(worst, group)

    logged = LoggedOutcomes.read(logs, on_group=take)
    agents = logged.outcomes.agents
    if reference is not None and reference not in agents:
        raise SettingsError(
            f"The reference {reference!r} has no trial here; expected one of {', '.join(agents)}."
        )
    page = _page(logged, worst, logs, reference or reference_agent(agents))
    write_whole(path, page, inputs=logs.files)
    return logged.outcomes


def _page(logged: LoggedOutcomes, worst: Sequence[Worst], logs: Logs, reference: str) -> str:
    """Return the page as HTML; of a single trial, the trial without statistics."""
    outcomes = logged.outcomes
    sections = list[Section]()
    if logs.problems:
        sections.append({"title": "Warning", "problems": logs.problems, "kind": "warning"})
    if len(outcomes) > 1:
        sections += sections_of(logged, reference)
    title = "The worst trials" if len(outcomes) > 1 else "The trial"
    parts = [trial_section(bad) | {"opened": i < _OPENED} for i, bad in enumerate(worst)]
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

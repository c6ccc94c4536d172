"""Answering one question: run the trial, log it, and give its facts as plain values."""

import hashlib
import json
import re
import time
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meal_bayes.cli.screen import prepare_planner
from meal_bayes.cli.story import Story

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from rich.console import Console

    from meal_bayes.agents import Step, Task, Trial
    from meal_bayes.datasets import PerceptTable


def answer(
    table: "PerceptTable",
    task: "Task",
    *,
    agent: str,
    seed: int,
    logs: Path,
    config: Mapping[str, object],
    console: "Console | None" = None,
    told: "NDArray[np.int8] | None" = None,
) -> "tuple[Trial, Path]":
    """Run the trial of a task and log it under a name that its config tells.

    Parameters
    ----------
    config : goes into the log's header; its "command" begins the log's name.
    console : where the trial is told as it happens.
    told : (O,P) what people told of objects before; -1 nothing.
    """
    from meal_bayes.agents import Morc, load_agent
    from meal_bayes.files import check_folder
    from meal_bayes.trial_log import TrialWriter

    recipe = load_agent(agent)
    check_folder(logs)
    if recipe.searches:
        prepare_planner()
    start = time.perf_counter()
    morc = Morc(table, recipe, seed, told=told)
    story = None if console is None else Story(console, task, morc.prepare(task)[0])
    trial = morc.run(task, on_step=None if story is None else story.step)
    path = logs / f"{_file_name(config, task.object_name)}.mcap"
    header = {"config": dict(config), "seed": seed, "data": table.domain.data}
    with TrialWriter(path, header) as log:
        log.write(trial, seconds=time.perf_counter() - start)
    if story is not None:
        story.end(trial)
    return trial, path


def trial_facts(trial: "Trial") -> dict[str, object]:
    """Give what a program would ask of a trial, in JSON values."""
    names, report = trial.task.query.attributes, trial.report
    return {
        "object": trial.task.object_name,
        "attributes": list(names),
        "agent": trial.agent,
        "report": None if report is None else _by_name(names, report),
        "truth": _by_name(names, trial.truth),
        "success": trial.success,
        "cost_s": trial.cost,
        "reward": trial.reward,
        "belief": _by_name(names, trial.last_belief.positive),
        "steps": [_step_facts(trial, step) for step in trial.steps],
    }


def _step_facts(trial: "Trial", step: "Step") -> dict[str, object]:
    seen, names = step.observation, trial.task.query.attributes
    return {
        "x": trial.momdp.x_names[step.x],
        "action": trial.momdp.action_name(step.decision.action),
        "next_x": trial.momdp.x_names[step.next_x],
        "percept": None if seen is None else _by_name(names, seen),
        "cost_s": step.cost,
        "belief": _by_name(names, step.belief.positive),
    }


def _by_name(names: tuple[str, ...], values: "NDArray[Any]") -> dict[str, object]:
    return dict(zip(names, values.tolist(), strict=True))


def _file_name(config: Mapping[str, object], name: str) -> str:
    """Name a log so that equal runs share it and others do not."""
    digest = hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:8]
    return f"{config['command']}-{re.sub(r'[^A-Za-z0-9_.-]+', '_', name)[:60]}-{digest}"

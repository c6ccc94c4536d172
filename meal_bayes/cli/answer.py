"""Answering one question: run the trial, log it, and give its facts as plain values."""

import hashlib
import json
import math
import re
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meal_bayes.cli.screen import showing_compilation
from meal_bayes.cli.story import Story

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from rich.console import Console

    from meal_bayes.agents import Step, Task, Trial
    from meal_bayes.datasets import PerceptTable
    from meal_bayes.learner import Lesson


def answer(
    table: "PerceptTable",
    task: "Task",
    *,
    agent: object,
    seed: int,
    logs: Path,
    config: Mapping[str, object],
    console: "Console | None" = None,
    lessons: "Sequence[Lesson]" = (),
) -> "tuple[Trial, Path]":
    """Run the trial of a task and log it under a name that its config tells.

    Parameters
    ----------
    config : goes into the log's header; its "command" begins the log's name.
    console : where the trial is told as it happens.
    lessons : what people told of objects before.
    """
    from meal_bayes.files import check_folder
    from meal_bayes.learner import Learner
    from meal_bayes.trial_log import TrialWriter

    learner = Learner(table.domain, agent=agent, seed=seed, logs=None)
    check_folder(logs)  # once the agent is known to be one
    start = time.perf_counter()
    learner.resume(table, lessons, [False] * len(lessons))
    story = None if console is None else Story(console, task, learner.problem(task))
    with showing_compilation():
        trial = learner.replay(task, on_step=None if story is None else story.step)
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
        "truth": {
            name: None if value < 0 else value == 1
            for name, value in zip(names, trial.truth.tolist(), strict=True)
        },
        "success": trial.success,
        "ended": trial.ended,
        "cost_s": trial.cost,
        "reward": None if math.isnan(trial.reward) else trial.reward,
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
        "warning": step.warning,
        "cost_s": step.cost,
        "belief": _by_name(names, step.belief.positive),
    }


def _by_name(names: tuple[str, ...], values: "NDArray[Any]") -> dict[str, object]:
    return dict(zip(names, values.tolist(), strict=True))


def _file_name(config: Mapping[str, object], name: str) -> str:
    """Name a log so that equal runs share it and others do not."""
    digest = hashlib.sha256(json.dumps(config, sort_keys=True).encode()).hexdigest()[:8]
    return f"{config['command']}-{re.sub(r'[^A-Za-z0-9_.-]+', '_', name)[:60]}-{digest}"

"""Answering one question: run the trial, log it, and return its facts as JSON values."""

import math
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from meal_bayes.cli.console import showing_compilation
from meal_bayes.cli.options import digest

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from meal_bayes.datasets import PerceptTable
    from meal_bayes.trials import Task, Trial


def answer(
    table: "PerceptTable",
    task: "Task",
    *,
    agent: object,
    seed: int,
    logs: Path,
    config: Mapping[str, object],
    labels: Sequence[Mapping[str, Any]] | None = None,
) -> "tuple[Trial, Path]":
    """Run the trial of a task, and return it with the path of its log.

    The log's name begins with the "command" of `config`. Labels are those that people gave before
    ("object", "labels" by attribute), None where objects are not recognized.
    """
    from meal_bayes.files import check_folder, file_name
    from meal_bayes.learner import Learner
    from meal_bayes.trial_log import TrialWriter

    learner = Learner(table.domain, agent=agent, seed=seed, logs=None)
    check_folder(logs)  # once the agent is known to be one
    start = time.perf_counter()
    learner.fit(table)
    if labels is not None:
        learner.agent = replace(learner.agent, memory=True)
    for entry in labels or ():
        if entry["object"] in table.objects:
            known = {k: v for k, v in entry["labels"].items() if k in table.domain.attributes}
            learner.tell(entry["object"], known)
    with showing_compilation():
        trial = learner.ask(task)
    path = logs / f"{config['command']}-{file_name(task.object_name)}-{digest(config)}.mcap"
    header = {"config": dict(config), "seed": seed, "data": table.domain.data}
    with TrialWriter(path, header) as log:
        log.write(trial, seconds=time.perf_counter() - start)
    return trial, path


def trial_facts(trial: "Trial") -> dict[str, object]:
    """Return the facts of a trial as JSON values."""
    names = trial.task.query.attributes
    truth = [None if value < 0 else value == 1 for value in trial.truth.tolist()]
    return {
        "object": trial.task.object_name,
        "attributes": list(names),
        "agent": trial.agent,
        "report": _by_name(names, trial.report),
        "truth": dict(zip(names, truth, strict=True)),
        "success": trial.success,
        "ended": trial.ended,
        "cost_s": trial.cost,
        "reward": None if math.isnan(trial.reward) else trial.reward,
        "belief": _by_name(names, trial.last_belief.positive),
        "steps": [
            {
                "x": trial.momdp.x_names[step.x],
                "action": trial.momdp.action_name(step.decision.action),
                "next_x": trial.momdp.x_names[step.next_x],
                "percept": _by_name(names, step.observation),
                "warning": step.warning,
                "cost_s": step.cost,
                "belief": _by_name(names, step.belief.positive),
            }
            for step in trial.steps
        ],
    }


def _by_name(names: tuple[str, ...], values: "NDArray[Any] | None") -> dict[str, object] | None:
    return None if values is None else dict(zip(names, values.tolist(), strict=True))

"""`meal-bayes ask`: one question about one object; with --learn, the robot remembers the answer."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from meal_bayes.cli.answer import answer, trial_facts
from meal_bayes.cli.options import (
    AGENTS,
    OWN,
    agent_value,
    dataset_option,
    json_option,
    logs_option,
    seed_option,
    table_of,
)
from meal_bayes.cli.screen import note, output, printable
from meal_bayes.cli.story import tell_briefly

if TYPE_CHECKING:
    from collections.abc import Iterable

    from meal_bayes.agents import Trial
    from meal_bayes.datasets import PerceptTable
    from meal_bayes.learner import Lesson
    from meal_bayes.trial_log import ObjectLabels


@click.command(short_help="Ask about one object.")
@click.argument("question")
@dataset_option
@click.option("--object", "name", required=True, metavar="NAME", help="The object asked about.")
@click.option(
    "--agent",
    default="bayes",
    show_default=True,
    metavar="NAME",
    help=f"Who answers: {AGENTS}; or {OWN}.",
)
@click.option(
    "--learn", is_flag=True,
    help="Ask whether the answer was right, and use what was told before; see `meal-bayes memory`.",
)  # fmt: skip
@seed_option()
@logs_option
@json_option
def ask(
    question: str,
    dataset: str,
    root: Path | None,
    name: str,
    agent: str,
    learn: bool,
    seed: int,
    logs: Path,
    as_json: bool,
) -> None:
    """Answer a question about an object, such as "Is it heavy, and does it hold beans?".

    The agent has learned from all other objects of the data set, never from this one; percepts are
    classifiers' outputs on the robot's recordings of it. The trial is logged. With --learn it
    remembers what it is told of an object: the folder of logs is its memory.
    """
    from meal_bayes.datasets import load_percepts
    from meal_bayes.learner.asking import question_task
    from meal_bayes.trial_log import read_memory

    dataset = table_of(dataset, root)
    table = load_percepts(dataset)
    task = question_task(question, table, name)
    config: dict[str, object] = {
        "command": "ask",
        "question": question,
        "dataset": dataset,
        "object": name,
        "agent": agent,
        "seed": seed,
    }
    memory = read_memory(logs, table.domain.data) if learn else []
    number = 1 + max((told.number for told in memory), default=-1)
    if learn:
        config["told_before"] = number
    trial, path = answer(
        table, task, agent=agent_value(agent), seed=seed, logs=logs, config=config,
        lessons=_lessons(memory, table),
    )  # fmt: skip
    if as_json:
        facts = {"config": config, "trial": trial_facts(trial), "log": str(path)}
        click.echo(json.dumps(facts, allow_nan=False))
    else:
        tell_briefly(output(), trial)
    if learn:
        known = {name for told in memory if told.object_name == task.object_name
                 for name in told.values}  # fmt: skip
        _listen(trial, path, number, known)
    elif not as_json:
        note(f"every decision and its reasons: meal-bayes log show {path}")


def _lessons(memory: "Iterable[ObjectLabels]", table: "PerceptTable") -> "list[Lesson]":
    """Return what is remembered of a table's objects and attributes."""
    from meal_bayes.learner import Lesson

    known = set(table.domain.attributes)
    return [
        Lesson(
            ("memory", told.number),
            told.object_name,
            {name: value for name, value in told.values.items() if name in known},
            (),
        )
        for told in memory
        if told.object_name in table.objects
    ]


def _listen(trial: "Trial", path: Path, number: int, known: set[str]) -> None:
    """Ask a person about the answer, and put the reply into the trial's log, as word `number`.

    Where a verdict does not say what an attribute is, and nobody has said so before, it is asked.
    """
    from meal_bayes.agents import implied
    from meal_bayes.trial_log import ObjectLabels, write_labels

    names = trial.task.query.attributes
    values: dict[str, bool] = {}
    right: bool | None = False
    if trial.report is not None:
        said = trial.task.query.report_name(trial.report.tolist())
        right = _prompt(f"The answer was: {said}. Was that right?")
        if right is not None:
            labels = zip(names, implied(trial.report, right=right).tolist(), strict=True)
            values = {name: label == 1 for name, label in labels if label >= 0}
    if right is False:
        for name in names:
            if name not in values and name not in known:
                reply = _prompt(f"Is it {name}?")
                if reply is not None:
                    values[name] = reply
    if not values:
        note("nothing was told, and nothing is remembered")
        return
    write_labels(ObjectLabels(number, trial.task.object_name, values, path))
    words = ", ".join(name if value else f"not {name}" for name, value in values.items())
    note(f"remembered in {path}: {trial.task.object_name} is {words}")


def _prompt(text: str) -> bool | None:
    """Ask on standard error for y or n; Enter, or no more lines to read, tells nothing."""
    replies = {"y": True, "yes": True, "n": False, "no": False, "": None, "skip": None}
    asked = f"{printable(text)} [y/n, Enter: do not know]"
    while True:
        try:
            reply: str = click.prompt(asked, err=True, default="", show_default=False)
        except click.Abort:
            click.echo(err=True)
            return None
        if reply.strip().lower() in replies:
            return replies[reply.strip().lower()]
        note(f"{reply!r} is not understood; type y or n")

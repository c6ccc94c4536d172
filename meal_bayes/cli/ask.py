"""`meal-bayes ask`: one question about one object; with --learn, the robot remembers the answer."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from meal_bayes.cli.answer import answer, trial_facts
from meal_bayes.cli.options import AGENTS, dataset_option, json_option, logs_option, seed_option
from meal_bayes.cli.screen import note, output
from meal_bayes.cli.story import tell_briefly

if TYPE_CHECKING:
    from meal_bayes.agents import Trial


@click.command(short_help="Ask about one object.")
@click.argument("question")
@dataset_option
@click.option("--object", "name", required=True, metavar="NAME", help="The object asked about.")
@click.option(
    "--agent", default="bayes", show_default=True, metavar="NAME", help=f"Who answers: {AGENTS}."
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
    from meal_bayes.learner.asking import question_task
    from meal_bayes.datasets import load_percepts
    from meal_bayes.trial_log import labels_told, read_memory

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
    told, number = None, 0
    if learn:
        memory = read_memory(logs, table.domain.data)
        number = 1 + max((told.number for told in memory), default=-1)
        config["told_before"] = number
        told = labels_told(memory, table.objects, table.domain.attributes)
    trial, path = answer(table, task, agent=agent, seed=seed, logs=logs, config=config, told=told)
    if as_json:
        facts = {"config": config, "trial": trial_facts(trial), "log": str(path)}
        click.echo(json.dumps(facts, allow_nan=False))
    else:
        tell_briefly(output(), trial)
    if learn:
        _listen(trial, path, number)
    elif not as_json:
        note(f"every decision and its reasons: meal-bayes log show {path}")


def _listen(trial: "Trial", path: Path, number: int) -> None:
    """Ask a person about the answer, and put the reply into the trial's log, as word `number`."""
    from meal_bayes.agents import implied
    from meal_bayes.trial_log import Told, write_told

    if trial.report is None:
        note("it gave no answer, so there is nothing to be told")
        return
    names = trial.task.query.attributes
    said = trial.task.query.report_name(trial.report.tolist())
    reply = _prompt(f"The answer was: {said}. Was that right?", ("yes", "no", "skip"))
    values: dict[str, bool] = {}
    if reply != "skip":
        labels = zip(names, implied(trial.report, right=reply == "yes").tolist(), strict=True)
        values = {name: label == 1 for name, label in labels if label >= 0}
    if reply == "no" and len(names) > 1:
        for name in names:
            each = _prompt(f"Is it {name}?", ("yes", "no", "skip"))
            if each != "skip":
                values[name] = each == "yes"
    if not values:
        note("nothing was told, and nothing is remembered")
        return
    write_told(Told(number, trial.task.object_name, values, path))
    words = ", ".join(name if value else f"not {name}" for name, value in values.items())
    note(f"remembered in {path}: {trial.task.object_name} is {words}")


def _prompt(text: str, choices: tuple[str, ...]) -> str:
    """Ask on standard error; what has no more lines to say skips."""
    try:
        reply: str = click.prompt(text, type=click.Choice(choices), err=True, default="skip")
    except click.Abort:
        click.echo(err=True)
        return "skip"
    return reply

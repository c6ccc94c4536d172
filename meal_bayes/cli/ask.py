"""`meal-bayes ask`: one question about one object."""

import json
from pathlib import Path

import click

from meal_bayes.cli.answer import answer, trial_facts
from meal_bayes.cli.options import AGENTS, dataset_option, json_option, logs_option, seed_option
from meal_bayes.cli.screen import note, output
from meal_bayes.cli.story import tell_briefly


@click.command(short_help="Ask about one object.")
@click.argument("question")
@dataset_option
@click.option("--object", "name", required=True, metavar="NAME", help="The object asked about.")
@click.option(
    "--agent", default="bayes", show_default=True, metavar="NAME", help=f"Who answers: {AGENTS}."
)
@seed_option()
@logs_option
@json_option
def ask(
    question: str, dataset: str, name: str, agent: str, seed: int, logs: Path, as_json: bool
) -> None:
    """Answer a question about an object, such as "Is it heavy, and does it hold beans?".

    The agent has learned from all other objects of the data set, never from this one; percepts are
    classifiers' outputs on the robot's recordings of it. The trial is logged.
    """
    from meal_bayes.agents.asking import question_task
    from meal_bayes.datasets import load_percepts

    table = load_percepts(dataset)
    task = question_task(question, table, name)
    config = {
        "command": "ask",
        "question": question,
        "dataset": dataset,
        "object": name,
        "agent": agent,
        "seed": seed,
    }
    trial, path = answer(table, task, agent=agent, seed=seed, logs=logs, config=config)
    if as_json:
        facts = {"config": config, "trial": trial_facts(trial), "log": str(path)}
        click.echo(json.dumps(facts, allow_nan=False))
        return
    tell_briefly(output(), trial)
    note(f"every decision and its reasons: meal-bayes log show {path}")

"""`meal-bayes ask`: one question about one object; `meal-bayes memory`: the labels it received."""

import contextlib
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from meal_bayes.cli import options as opt
from meal_bayes.cli.answer import answer, trial_facts
from meal_bayes.cli.console import note, output, print_json, print_table, printable
from meal_bayes.cli.program import Section

if TYPE_CHECKING:
    from meal_bayes.trial_log import ObjectLabels
    from meal_bayes.trials import Trial


@click.command(short_help="Ask about one object.")
@click.argument("question")
@opt.dataset_option
@click.option("--object", required=True, metavar="NAME", help="The object asked about.")
@opt.option("--agent", None, "bayes", "NAME", f"Who answers: {opt.AGENTS}; or {opt.OWN}.")
@click.option(
    "--learn", is_flag=True,
    help="Ask whether the answer was right, and use earlier labels; see `meal-bayes memory`.",
)  # fmt: skip
@opt.seed_option()
@opt.logs_option
@opt.json_option
def ask(root: Path | None, learn: bool, logs: Path, as_json: bool, **options: Any) -> None:
    """Answer a question about an object, such as "Is it heavy, and does it hold beans?".

    The agent has learned from all other objects of the data set, never from this one; percepts are
    classifiers' outputs on the robot's recordings of it. The trial is logged. With --learn it
    keeps the labels that it gets of an object: the folder of logs is its memory.
    """
    from meal_bayes.cli.narration import print_trial_table
    from meal_bayes.datasets import load_percepts
    from meal_bayes.learner.api import question_task
    from meal_bayes.trial_log import read_memory

    config = {"command": "ask", **options, "dataset": opt.table_of(options["dataset"], root)}
    table = load_percepts(config["dataset"])
    task = question_task(config["question"], table, config["object"])
    memory = read_memory(logs, table.domain.data) if learn else []
    number = 1 + max((one.number for one in memory), default=-1)
    if learn:
        config["labels_before"] = number
    trial, path = answer(
        table, task, agent=opt.agent_value(config["agent"]), seed=config["seed"], logs=logs,
        config=config, labels=memory if learn else None,
    )  # fmt: skip
    if as_json:
        print_json({"config": config, "trial": trial_facts(trial), "log": str(path)})
    else:
        print_trial_table(output(), trial)
    if learn:
        own = (one.values for one in memory if one.object_name == task.object_name)
        _ask_labels(trial, path, number, set().union(*own))
    elif not as_json:
        note(f"every decision and its reasons: meal-bayes log show {path}")


def _ask_labels(trial: "Trial", path: Path, number: int, known: set[str]) -> None:
    """Ask a person about the answer, and write the labels, the `number`-th, into the trial's log.

    Nothing is asked about attributes that are known.
    """
    from meal_bayes.learner import implied
    from meal_bayes.trial_log import ObjectLabels, write_labels

    names = trial.task.query.attributes
    values: dict[str, bool] = {}
    right: bool | None = False
    if trial.report is not None:
        said = trial.task.query.report_name(trial.report.tolist())
        right = _prompt(f"The answer was: {said}. Was that right?")
        if right is not None:
            pairs = zip(names, implied(trial.report, right=right).tolist(), strict=True)
            values = {name: label == 1 for name, label in pairs if label >= 0}
    if right is False:
        for name in names:
            if name not in values and name not in known:
                reply = _prompt(f"Is it {name}?")
                if reply is not None:
                    values[name] = reply
    if not values:
        note("no labels were given, none are kept")
        return
    write_labels(ObjectLabels(number, trial.task.object_name, values, path))
    labels = ", ".join(name if value else f"not {name}" for name, value in values.items())
    note(f"kept in {path}: {trial.task.object_name} is {labels}")


def _prompt(text: str) -> bool | None:
    """Return a person's reply to a yes/no question on standard error; None where unknown."""
    replies = {"y": True, "yes": True, "n": False, "no": False, "": None, "skip": None}
    prompt = f"{printable(text)} [y/n, Enter: do not know]"
    while True:
        try:
            reply: str = click.prompt(prompt, err=True, default="", show_default=False)
        except click.Abort:
            click.echo(err=True)
            return None
        with contextlib.suppress(KeyError):
            return replies[reply.strip().lower()]
        note(f"{reply!r} is not understood; type y or n")


@click.group(cls=Section)
def memory() -> None:
    """Show or forget the labels that `ask --learn` received."""


@memory.command()
@opt.dataset_option
@opt.logs_option
@opt.json_option
def show(dataset: str, root: Path | None, logs: Path, as_json: bool) -> None:
    """List the labels of the objects of a data set, the latest last."""
    labels = _memory(logs, dataset)
    if as_json:
        rows = [
            {"object": each.object_name, "labels": dict(each.values), "log": str(each.path)}
            for each in labels
        ]
        print_json({"memory": rows})
        return
    if not labels:
        note(f'no labels yet; ask with --learn: meal-bayes ask --learn "..." --logs {logs}')
        return
    cells = (
        (each.object_name, ", ".join(k if v else f"not {k}" for k, v in each.values.items()),
         each.path.name)
        for each in labels
    )  # fmt: skip
    print_table(("object", "is", "log"), cells, left=("is", "log"))


@memory.command()
@click.option("--object", "name", metavar="NAME", help="Only the labels of this object.")
@opt.dataset_option
@opt.logs_option
def forget(name: str | None, dataset: str, root: Path | None, logs: Path) -> None:
    """Forget labels; the trials stay in their logs."""
    from meal_bayes.trial_log import forget as forget_labels

    labels = [each for each in _memory(logs, dataset) if name in (None, each.object_name)]
    note(f"forgot the labels in {forget_labels(labels)} trials")


def _memory(logs: Path, dataset: str) -> "list[ObjectLabels]":
    from meal_bayes.datasets.percept_file import domain_of
    from meal_bayes.trial_log import read_memory

    return read_memory(logs, domain_of(dataset).data)

"""`meal-bayes ask`, `demo`: one question about one object; `memory`: the labels it received."""

import textwrap
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypedDict, Unpack

import click
from rich.text import Text

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.console import note, output, print_facts, print_json
from meal_bayes.cli.program import Section
from meal_bayes.files import command_line, file_name

if TYPE_CHECKING:
    from meal_bayes.datasets import PerceptTable
    from meal_bayes.domain import Domain
    from meal_bayes.learner import Learner
    from meal_bayes.trials import Trial

_QUESTION = "Is it heavy, and does it hold beans?"
_OBJECT = "heavy_blue_beans"
_SEED = 0  # with which that object is taken


@click.command()
@opt.seed_option(_SEED)
@opt.shared("logs")
def demo(seed: int, logs: Path) -> None:
    """Show one trial step by step. Start here.

    The package contains the percepts of a real robot. Another seed chooses another object.
    """
    from meal_bayes.cli.narration import print_trial
    from meal_bayes.datasets import load_percepts
    from meal_bayes.domain.event import wrong_reward
    from meal_bayes.seeds import stream

    table = load_percepts("roc36")
    name = _OBJECT
    if seed != _SEED:
        name = table.objects[int(stream(seed, "demo").integers(len(table.objects)))]
    config = {
        "command": "demo",
        "question": _QUESTION,
        "dataset": "roc36",
        "object": name,
        "agent": "bayes",
        "seed": seed,
    }
    console = output()
    text = (
        "A robot meets an object it has never learned from, and is asked about it. It tries one "
        "behavior after another, updates its belief by Bayes' rule, and answers once the next "
        "percept would cost more than it is worth."
    )
    console.print(Text(textwrap.fill(text, console.width) + "\n"))
    # What a newcomer needs to know before the first step.
    right = table.domain.report_reward
    sensing = sum(bool(behavior.modalities) for behavior in table.domain.behaviors)
    facts = {
        "question": _QUESTION,
        "object": f"{name}, from the recordings of a real robot (ROC36)",
        "learned": f"from the other {len(table.objects) - 1} objects: what each of {sensing} "
        "behaviors shows",
        "agent": "bayes: exact beliefs, tree search (POMCP)",
        "reward": f"{right:+g} for a right answer, {wrong_reward(right):g} for a wrong one, "
        "-1 a second",
    }
    print_facts(console, facts)
    console.print()
    trial, path = _answer(table, config, logs)
    print_trial(console, trial)
    other = name.replace("heavy", "light") if "heavy" in name else _OBJECT
    console.print()
    console.print(Text("what next", "bold"))
    many = "meal-bayes run offline --trials 100 --agent predefined_plus --agent bayes"
    for command, what in (
        (command_line("meal-bayes log show", path), "this trial again, from its log"),
        (f'meal-bayes ask "Is it blue, and does it hold rice?" --object {other}', "ask your own"),
        (many, "many trials, two agents compared"),
    ):
        console.print(Text(f"  # {what}", "dim"))
        console.print(Text(f"  {command}"), soft_wrap=True)


class _Asking(TypedDict):
    """Options of `ask` that name its trial, and so its log."""

    dataset: str
    question: str
    object: str
    agent: str
    yes_no: bool
    payoffs: tuple[float, float, float, float] | None
    seed: int


@click.command(short_help="Ask about one object.")
@click.argument("question")
@opt.shared("dataset", "root")
@click.option("--object", required=True, metavar="NAME", help="Name of the object in the question.")
@opt.option("--agent", None, "bayes", "NAME", f"Agent that answers: {opt.AGENTS}; or {opt.OWN}.")
@opt.shared("yes_no", "payoffs")
@click.option(
    "--learn",
    is_flag=True,
    help="Ask whether the answer was right, and use earlier labels; see `meal-bayes memory`.",
)
@opt.shared("seed", "logs", "json")
def ask(
    root: Path | None, learn: bool, logs: Path, as_json: bool, **options: Unpack[_Asking]
) -> None:
    """Answer a question about an object, such as "Is it heavy, and does it hold beans?".

    The agent has learned from all other objects of the data set, but not from this one. Percepts
    are the outputs of classifiers for the robot's recordings of the object. The trial is logged.
    With --learn, the command asks you whether the answer was right, and logs the labels.
    """
    from meal_bayes.cli.narration import note_reasons, print_answer, trial_json
    from meal_bayes.trial_log import Feedback

    dataset, table = opt.table_of(options["dataset"], root)
    config = {"command": "ask", **options, "dataset": dataset}
    told = None
    if learn:  # labels change the answer, so the number of messages is a part of the log's name
        told, config["told_before"] = _told(table.domain, logs)
    trial, path = _answer(table, config, logs)
    if as_json:
        print_json({"config": config, "trial": trial_json(trial), "log": str(path)})
    else:
        print_answer(output(), trial)
    if told is not None:
        name = options["object"]
        labels = _ask_labels(trial, set(_labels_of(told).get(name, {})))
        if not labels:
            note("no labels were given, none are kept")
            return
        told.experience.object_number(name)  # it has recordings, so its name is no slip
        told.tell(name, labels)
        text = Feedback(name, labels).text
        note(f"kept in {logs / file_name(table.domain.name)}: {name} is {text}")
    elif not as_json:
        note_reasons(path)


def _answer(
    table: "PerceptTable",
    config: Mapping[str, Any],
    logs: Path,
) -> "tuple[Trial, Path]":
    """Ask what a command's settings say, and return the trial with the path of its log."""
    from meal_bayes.files import check_folder, file_name
    from meal_bayes.learner import Learner
    from meal_bayes.learner.recalled import hear
    from meal_bayes.trial_log import write_trials

    agent = opt.agent_value(config["agent"])
    seed = config["seed"]
    learner = Learner(table.domain, agent=agent, seed=seed, logs=None).fit(table)
    task = learner.task(
        config["question"],
        config["object"],
        answer="yes or no" if config.get("yes_no") else "values",
        payoffs=config.get("payoffs") or None,
    )
    check_folder(logs)  # once agent, question and object are known to be some
    start = time.perf_counter()
    if "told_before" in config:
        learner.agent = replace(learner.agent, memory=True)
        hear(learner, logs / file_name(table.domain.name), _left_out)
    with terminal.showing_compilation():
        trial = learner.ask(task)
    path = logs / f"{config['command']}-{file_name(task.object_name)}-{opt.digest(config)}.mcap"
    header = {"config": dict(config), "seed": seed, "data": table.domain.data}
    seconds = [time.perf_counter() - start]
    write_trials(path, [trial], header=header, seconds=seconds, overwrite=True)  # asked again
    return trial, path


def _ask_labels(trial: "Trial", labeled: set[str]) -> dict[str, bool]:
    """Ask a person about the answer, and each attribute that it leaves open and nobody labeled."""
    from meal_bayes.learner import implied

    query = trial.task.query
    names = query.attributes
    labels: dict[str, bool] = {}
    right: bool | None = False
    if trial.report is not None:
        answer = query.report_name(trial.report.tolist())
        right = _prompt(f"The answer was: {answer}. Was that right?")
        if right is not None:
            implied_labels = implied(trial.report, right=right)
            if query.event is not None:  # "no" to several literals says nothing of any
                implied_labels = query.event.labels(bool(trial.report[0]) == right, query.variables)
            pairs = zip(names, implied_labels.tolist(), strict=True)
            labels = {name: label == 1 for name, label in pairs if label >= 0}
    if right is False:
        for question, indices in query.questions:
            members = [names[index] for index in indices]
            if {*members} & ({*labels} | labeled):
                continue
            if len(members) > 1:
                labels |= _prompt_value(question, members)
                continue
            reply = _prompt(f"Is it {question}?")
            if reply is not None:
                labels[question] = reply
    return labels


def _prompt_value(group: str, members: Sequence[str]) -> dict[str, bool]:
    """Return a person's reply to which value of a group it is, by attribute; {} where unknown."""
    text = f"What {group} is it? [{', '.join(members)}; Enter: do not know]"
    reply = _replied(text, ["", *members])
    return {name: name == reply for name in members} if reply else {}


def _prompt(text: str) -> bool | None:
    """Return a person's reply to a yes/no question on standard error; None where unknown."""
    replies = {"y": True, "yes": True, "n": False, "no": False, "": None, "skip": None}
    return replies[_replied(f"{text} [y/n, Enter: do not know]", list(replies))]


def _replied(text: str, choices: Sequence[str]) -> str:
    """Return which of the choices a person types; "" where nobody is there."""
    kind = click.Choice(choices, case_sensitive=False)
    try:
        reply: str = click.prompt(
            terminal.printable(text),
            type=kind,
            default="",
            show_choices=False,
            show_default=False,
            err=True,
        )
    except (click.Abort, RuntimeError):  # as where standard input is closed
        click.echo(err=True)
        return ""
    return reply


@click.group(cls=Section)
def memory() -> None:
    """List or remove the labels that people gave to objects."""


@memory.command(short_help="List the labels that people gave to objects.")
@opt.shared("dataset", "logs", "json")
def show(dataset: str, logs: Path, as_json: bool) -> None:
    """List the labels that people gave to objects, by `ask --learn` or a Learner in Python.

    Labels that were given for a trial in Python are not listed; `meal-bayes log show` shows them
    with the trial.
    """
    from meal_bayes.datasets.percepts import domain_of
    from meal_bayes.trial_log import Feedback

    labels_of = _labels_of(_told(domain_of(dataset), logs)[0])
    if as_json:
        print_json({"memory": [{"object": o, "labels": labels_of[o]} for o in labels_of]})
        return
    if not labels_of:
        command = command_line('meal-bayes ask --learn "..." --logs', logs)
        note(f"no labels yet; ask with --learn: {command}")
        return
    cells = ((name, Feedback(name, labels).text) for name, labels in labels_of.items())
    terminal.print_table(("object", "is"), cells, left_aligned=("is",))


@memory.command(short_help="Remove labels; the trials remain in their logs.")
@click.option("--object", "name", metavar="NAME", help="Only the labels of this object.")
@opt.shared("dataset", "logs")
def forget(name: str | None, dataset: str, logs: Path) -> None:
    """Remove the labels of one object or of all objects; the trials remain in their logs."""
    from meal_bayes.datasets.percepts import domain_of

    told, _ = _told(domain_of(dataset), logs)
    objects = [*_labels_of(told)] if name is None else [name]
    for o in objects:
        told.forget(o)  # raises where nothing was told of it
    note(f"forgot the labels of {len(objects)} objects")


def _told(domain: "Domain", logs: Path) -> "tuple[Learner, int]":
    """Return a learner that knows what was told of objects alone, and how many messages say it.

    It is told and forgets beside the logs that it has heard.
    """
    from meal_bayes.learner import Learner
    from meal_bayes.learner.recalled import hear

    learner = Learner(domain, agent="prior", logs=logs)
    return learner, hear(learner, logs / file_name(domain.name), _left_out)


def _labels_of(learner: "Learner") -> dict[str, dict[str, bool]]:
    """Return the labels that hold, by object, of those that were told by its name."""
    from meal_bayes.learner.experience import key_of_name

    labels_of = dict[str, dict[str, bool]]()
    for name in learner.experience.objects:
        labels = learner.experience.labels_of_trial(key_of_name(name)).tolist()
        pairs = zip(learner.domain.attributes, labels, strict=True)
        labels_of[name] = {attribute: label == 1 for attribute, label in pairs if label >= 0}
    return {name: labels for name, labels in labels_of.items() if labels}


def _left_out(fault: str) -> None:
    """Say which message could not be read."""
    note(f"left out of what was told: {fault}")

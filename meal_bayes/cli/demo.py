"""`meal-bayes demo`: one trial on the recordings of a real robot, step by step."""

import textwrap
from pathlib import Path

import click
from rich.text import Text

from meal_bayes.cli.answer import answer
from meal_bayes.cli.console import output, print_facts
from meal_bayes.cli.options import logs_option, seed_option

_DATASET = "roc36"
_QUESTION = "Is it heavy, and does it hold beans?"
_AGENT = "bayes"
_SEED = 7  # a trial in which a behavior fails


@click.command()
@seed_option(_SEED)
@logs_option
def demo(seed: int, logs: Path) -> None:
    """Show one trial step by step. Start here.

    The percepts of a real robot come with the package; another seed takes another object.
    """
    from meal_bayes.cli.narration import print_trial
    from meal_bayes.datasets import load_percepts
    from meal_bayes.learner.api import question_task
    from meal_bayes.seeds import stream

    table = load_percepts(_DATASET)
    name = table.objects[int(stream(seed, "demo").integers(len(table.objects)))]
    task = question_task(_QUESTION, table, name)
    config = {
        "command": "demo", "question": _QUESTION, "dataset": _DATASET, "object": name,
        "agent": _AGENT, "seed": seed,
    }  # fmt: skip
    console = output()
    text = (
        "A robot meets an object it has never learned from, and is asked about it. It tries one "
        "behavior after another, updates its belief by Bayes' rule, and answers once the next "
        "percept would cost more than it is worth."
    )
    console.print(Text(textwrap.fill(text, console.width) + "\n"))
    right = table.domain.report_reward
    sensing = sum(bool(behavior.modalities) for behavior in table.domain.behaviors)
    facts = {
        "question": _QUESTION,
        "object": f"{name}, from the recordings of a real robot (ROC36)",
        "learned": f"from the other {len(table.objects) - 1} objects: what each of {sensing} "
        "behaviors shows",
        "agent": f"{_AGENT}: exact beliefs, tree search (POMCP)",
        "reward": f"+{right:g} for a right answer, -{right:g} for a wrong one, -1 a second",
    }
    print_facts(console, facts)
    console.print()
    trial, path = answer(table, task, agent=_AGENT, seed=seed, logs=logs, config=config)
    print_trial(console, trial)
    other = name.replace("heavy", "light") if "heavy" in name else "heavy_blue_beans"
    console.print()
    console.print(Text("what next", "bold"))
    many = "meal-bayes run offline --trials 100 --agent predefined_plus --agent bayes"
    for command, what in (
        (f"meal-bayes log show {path}", "this trial again, from its log"),
        (f'meal-bayes ask "Is it blue, and does it hold rice?" --object {other}', "ask your own"),
        (many, "many trials, two agents compared"),
    ):
        console.print(Text(f"  # {what}", "dim"))
        console.print(Text(f"  {command}"), soft_wrap=True)

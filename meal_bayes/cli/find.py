"""`meal-bayes find`: say which of several objects it is."""

from pathlib import Path
from typing import TypedDict, Unpack

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.console import output, print_facts, print_json, print_table


class _Finding(TypedDict):
    """Options of `find` that name its folder."""

    dataset: str
    objects: str
    agent: str
    payoffs: tuple[float, float, float, float] | None
    seed: int
    question: str


@click.command(short_help="Find one of several objects.")
@click.argument("question")
@opt.shared("dataset", "root")
@opt.option("--objects", None, None, "NAME,NAME", "Recorded objects to choose from.", required=True)
@opt.option("--agent", None, "bayes", "NAME", f"Agent that answers: {opt.AGENTS}; or {opt.OWN}.")
@opt.shared("payoffs", "seed", "logs", "json")
def find(root: Path | None, logs: Path, as_json: bool, **options: Unpack[_Finding]) -> None:
    """Find the object for which the answer is yes ("Which one is heavy and blue?"), or none.

    The agent asks about one object after another, the most probable first, until one answer is yes.
    The agent has learned from all other objects of the data set. The logs of the trials are written
    into one folder.
    """
    from meal_bayes.cli.narration import VERDICT_STYLES, note_reasons, trial_json
    from meal_bayes.files import check_folder, file_name
    from meal_bayes.learner import Learner
    from meal_bayes.look import AMOUNT, percent
    from meal_bayes.trial_log import write_trials
    from meal_bayes.trials.text import verdict_text, verdict_word

    dataset, table = opt.table_of(options["dataset"], root)
    config = {"command": "find", **options, "dataset": dataset}
    agent = opt.agent_value(options["agent"])
    learner = Learner(table.domain, agent=agent, seed=options["seed"], logs=None).fit(table)
    folder = check_folder(logs) / f"find-{opt.digest(config)}"
    with terminal.showing_compilation():
        found = learner.find(
            options["question"],
            opt.comma_list(options["objects"]),
            payoffs=options["payoffs"] or None,
        )
    header = {"config": config, "seed": options["seed"], "data": table.domain.data}
    earlier = {*folder.glob("[0-9][0-9]*-*.mcap")}  # of an equal question
    for number, (name, trial) in enumerate(found.trials.items(), 1):
        path = folder / f"{number:02}-{file_name(name)}.mcap"
        write_trials(path, [trial], header=header, overwrite=True)
        earlier.discard(path)
    for path in earlier:
        path.unlink(missing_ok=True)
    if as_json:
        print_json(
            {
                "config": config,
                "object": found.object_name,
                "probability": found.probability,
                "success": found.success,
                "cost_s": found.cost,
                "trials": {name: trial_json(trial) for name, trial in found.trials.items()},
                "log": str(folder),
            }
        )
        return
    rows = (
        (name, verdict_text(trial), f"{trial.cost:{AMOUNT}}", percent(trial.probability or 0.0))
        for name, trial in found.trials.items()
    )
    print_table(("object", "answer", "s", "Pr(yes)"), rows, left_aligned=("answer",))
    facts = {
        "question": options["question"],
        "answer": found.object_name or "none of them",
        "certainty": percent(found.probability),
        "verdict": verdict_word(found.success),
        "cost": f"{found.cost:{AMOUNT}} s",
    }
    print_facts(output(), facts, answer="bold", verdict=VERDICT_STYLES[found.success])
    note_reasons(folder)

"""`meal-bayes find`: claim one of several objects, or none."""

from pathlib import Path
from typing import TYPE_CHECKING, TypedDict, Unpack

import click

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.console import note, output, print_facts, print_json, print_table
from meal_bayes.files import command_line

if TYPE_CHECKING:
    from meal_bayes.learner import Learner
    from meal_bayes.trials import Search, SearchSession


class _Searching(TypedDict):
    """Options of `find` that name its log."""

    dataset: str
    objects: str
    agent: str
    payoffs: tuple[float, float] | None
    none: float
    turn_cost: float
    seed: int
    question: str


@click.command(short_help="Find one of several objects.")
@click.argument("question")
@opt.shared("dataset", "root")
@opt.option(
    "--objects",
    None,
    None,
    "NAME,NAME",
    "Recorded objects to choose from.",
    required=True,
)
@opt.option("--agent", None, "bayes", "NAME", f"Who finds: {opt.AGENTS}; or {opt.OWN}.")
@click.option(
    "--payoffs", type=float, nargs=2, metavar="S S", help="What a right and a wrong claim earn."
)
@opt.option("--none", float, 0.0, "S", 'What the answer "none of them" earns.')
@opt.option("--turn-cost", opt.AMOUNT, 0.0, "S", "Of turning to an object.")
@opt.shared("seed", "logs", "json")
def find(root: Path | None, logs: Path, as_json: bool, **options: Unpack[_Searching]) -> None:
    """Find the object of which it is true ("Which one is heavy and blue?"), or none.

    The robot turns to the most promising object, and leaves it for another as soon as that promises
    more. The agent has learned from all other objects, of each without that one. A folder of its
    own holds the search, and a log of each object that it explored. One that was killed goes on by
    the same command.
    """
    from meal_bayes.learner import Learner
    from meal_bayes.trial_log.names import free_folder
    from meal_bayes.trials import run_search

    dataset, table = opt.table_of(options["dataset"], root)
    config = {"command": "find", **options, "dataset": dataset}
    agent = opt.agent_value(options["agent"])
    learner = Learner(table.domain, agent=agent, seed=options["seed"], logs=None).fit(table)
    first_folder = logs / f"find-{opt.digest(config)}"
    with terminal.showing_compilation():
        folder, session = _broken_off(learner, first_folder)
        if session is None:
            folder = free_folder(first_folder)
            session = learner.begin_find(
                options["question"],
                opt.comma_list(options["objects"]),
                payoffs=options["payoffs"] or None,
                none=options["none"],
                turn_cost=options["turn_cost"],
                log=folder,
            )
        search = run_search(session, learner.replays(session))
    print_answer(search, folder, as_json=as_json)


def _broken_off(learner: "Learner", first_folder: Path) -> "tuple[Path, SearchSession | None]":
    """Return the folder and session of the search of these settings that was killed, if any."""
    from meal_bayes.errors import LogError
    from meal_bayes.trial_log.schema import ACTIVE

    for folder in sorted(first_folder.parent.glob(f"{first_folder.name}*")):
        if not any(folder.glob(f"*{ACTIVE}")):
            continue
        try:
            session = learner.resume_find(folder)
        except LogError as fault:  # it is another process's, or was decided by other code
            note(f"a search of these settings was broken off, but this one begins anew: {fault}")
        else:
            note(f"a search of these settings was broken off; going on with {folder}")
            return folder, session
    return first_folder, None


def print_answer(search: "Search", folder: Path, *, as_json: bool) -> None:
    """Print a search that has ended, and where its logs are."""
    from meal_bayes.cli.narration import note_reasons, trial_json

    if as_json:
        print_json(
            {
                "search": {
                    "question": search.question,
                    "claim": search.claim,
                    "turns": list(search.turns),
                    "success": search.success,
                    "cost_s": search.cost,
                    "reward": None if search.success is None else search.reward,
                    "ended": search.ended,
                },
                "trials": {name: trial_json(trial) for name, trial in search.trials.items()},
                "log": str(folder),
            }
        )
        return
    print_search(search)
    if any(trial.steps for trial in search.trials.values()):
        note_reasons(folder)
    else:
        note(f"it stands in {folder}: {command_line('meal-bayes log show', folder)}")


def print_search(search: "Search") -> None:
    """Print what a search did with each object, and its answer."""
    from meal_bayes.cli.narration import VERDICT_STYLES
    from meal_bayes.trials.search import EXPLORED, explored_rows, search_facts

    print_table(EXPLORED, explored_rows(search), left_aligned=(EXPLORED.behaviors,))
    style = VERDICT_STYLES[search.success]
    print_facts(output(), search_facts(search), answer="bold", verdict=style)

"""`meal-bayes run`: many trials, paired over agents, resumed where they stopped."""

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from meal_bayes.cli.options import (
    AGENTS,
    OWN,
    agent_value,
    cluster_option,
    dataset_option,
    fresh_option,
    jobs_option,
    json_option,
    listed,
    logs_option,
    perception_option,
    seed_option,
    table_of,
)
from meal_bayes.cli.program import Section
from meal_bayes.cli.screen import note, output, progress, resumed, showing_compilation, signs_of
from meal_bayes.cli.values import LARGEST, MOST_TRIALS, Finite, Whole
from meal_bayes.untrusted import NAME_LIMIT

if TYPE_CHECKING:
    from meal_bayes.evaluation import SummaryRow
    from meal_bayes.experiments import OfflineConfig, OfflineRun
    from meal_bayes.trial_log import TrialOutcomes

_AGAINST = "morc"  # the paper's agent, which the others are compared with
_MEASURE = "reward"


@click.group(cls=Section)
def run() -> None:
    """Run many trials of several agents."""


@run.command(short_help="Agents answer the same queries about new objects.")
@dataset_option
@click.option(
    "--attributes", type=Whole(1, NAME_LIMIT), default=2, show_default=True, metavar="N",
    help="Asked at a time.",
)  # fmt: skip
@click.option(
    "--trials", type=Whole(1, MOST_TRIALS), default=400, show_default=True, metavar="T",
    help="For each agent.",
)  # fmt: skip
@click.option(
    "--agent", "agents", multiple=True, metavar="NAME",
    help=f"{AGENTS}; or {OWN}; may be repeated, or a comma list. All of them by default.",
)  # fmt: skip
@seed_option()
@jobs_option
@cluster_option
@click.option(
    "--percepts", type=click.Choice(["recorded", "model"]), default="recorded", show_default=True,
    help="Of real recordings, or drawn from the learned confusion matrices.",
)  # fmt: skip
@perception_option
@click.option(
    "--reward", type=Finite(0, LARGEST, min_open=True), metavar="R",
    help="For a right answer, and taken for a wrong one; the data set's by default.",
)  # fmt: skip
@logs_option
@fresh_option
@json_option
def offline(
    dataset: str,
    root: Path | None,
    attributes: int,
    trials: int,
    agents: tuple[str, ...],
    seed: int,
    jobs: int,
    cluster: str | None,
    percepts: str,
    perception: str,
    reward: float | None,
    logs: Path,
    fresh: bool,
    as_json: bool,
) -> None:
    """Let agents answer the same queries about objects they never learned from.

    A run that was interrupted goes on where it stopped when the same command is given again.
    """
    from meal_bayes.experiments import DEFAULT_AGENTS, OfflineConfig

    named = listed(*agents)
    config = OfflineConfig(
        dataset=table_of(dataset, root, perception),
        attributes=attributes,
        trials=trials,
        agents=tuple(map(agent_value, named)) or DEFAULT_AGENTS,
        seed=seed,
        percepts=percepts,
        perception=perception,
        reward=reward,
    )
    finished = _run(config, logs, jobs, cluster, fresh=fresh)
    rows, paired = _measure(finished)
    if as_json:
        facts = {
            "config": config.as_dict(),
            "rows": [row.as_dict() for row in rows],
            "paired": paired,
            "log": str(finished.folder),
        }
        click.echo(json.dumps(facts, allow_nan=False))
        return
    _print(output(), rows, paired)
    note(f"trials in {finished.folder}")


def _run(
    config: "OfflineConfig", logs: Path, jobs: int, cluster: str | None, *, fresh: bool
) -> "OfflineRun":
    """Run what is not there yet, telling how far it is."""
    from meal_bayes.experiments import offline_tasks, run_offline
    from meal_bayes.experiments.percepts import percepts_for

    if config.perception == "default":
        table = percepts_for(config.dataset)
    else:
        with progress("percepts", "behaviors") as advance:
            table = percepts_for(
                config.dataset, config.perception, on_progress=advance, on_note=note
            )
    offline_tasks(table, config.attributes, config.trials, config.seed)  # or say what is wrong
    from meal_bayes.experiments import warm_up_offline

    with showing_compilation():
        warm_up_offline(config)
    with resumed("trials") as advance:
        return run_offline(
            config,
            logs=logs,
            jobs=jobs,
            cluster=cluster,
            fresh=fresh,
            on_progress=advance,
            on_note=note,
        )


def _measure(finished: "OfflineRun") -> "tuple[list[SummaryRow], list[dict[str, object]]]":
    """Summarize the trials, and compare each agent with the paper's on the tasks they share."""
    from meal_bayes.evaluation import summarize

    outcomes = finished.outcomes()
    rows = summarize(outcomes, seconds=finished.seconds)
    others = [row.agent for row in rows if row.agent != _AGAINST]
    if len(others) == len(rows):
        return rows, []
    return rows, [_difference(outcomes, agent) for agent in others]


def _difference(outcomes: "TrialOutcomes", agent: str) -> dict[str, object]:
    from meal_bayes.evaluation import compare
    from meal_bayes.evaluation.statistics import plain

    found = compare(outcomes, agent, _AGAINST, measure=_MEASURE)
    return {"agent": agent, "against": _AGAINST, "measure": _MEASURE, **plain(found._asdict())}


def _print(console: Console, rows: "list[SummaryRow]", paired: "list[dict[str, object]]") -> None:
    spread = signs_of(console).spread
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("agent", no_wrap=True)
    for name in ("accuracy", "cost, s", "reward", "NLL", "ECE", "gave up"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(
            row.agent,
            f"{row.accuracy:.3f} {spread}{row.accuracy_se:.3f}",
            f"{row.cost_s:.1f}",
            f"{row.reward:.1f} {spread}{row.reward_se:.1f}",
            f"{row.nll:.3f}",
            f"{row.ece:.3f}",
            f"{row.abstained:.1%}",
        )
    console.print(table)
    console.print(
        Text(
            f"{rows[0].trials} trials an agent; {spread} one standard error, objects drawn as "
            "wholes; NLL and ECE of the final belief",
            "dim",
        )
    )
    _print_beliefs(console, rows)
    if paired:
        _print_paired(console, paired)


def _print_beliefs(console: Console, rows: "list[SummaryRow]") -> None:
    console.print()
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("final belief", no_wrap=True)
    for name in ("NLL", "Brier", "ECE", "ECE if calibrated"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        numbers = (row.nll, row.brier, row.ece, row.ece_calibrated)
        table.add_row(row.agent, *(f"{number:.3f}" for number in numbers))
    console.print(table)


def _print_paired(console: Console, paired: "list[dict[str, object]]") -> None:
    console.print()
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column(f"{_MEASURE} against {_AGAINST}", no_wrap=True)
    table.add_column("difference", justify="right")
    table.add_column("95 % interval", justify="right")
    for entry in paired:
        low, high = (_signed(entry[name]) for name in ("low", "high"))
        table.add_row(str(entry["agent"]), _signed(entry["estimate"]), f"{low} to {high}")
    console.print(table)


def _signed(value: object) -> str:
    return f"{value:+.1f}" if isinstance(value, float) else "?"

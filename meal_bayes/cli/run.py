"""`meal-bayes run`: many trials, paired over agents, resumed where they stopped."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.text import Text

from meal_bayes.cli.console import (
    new_table,
    note,
    output,
    print_json,
    progress,
    resumed,
    showing_compilation,
    signs_of,
)
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
from meal_bayes.cli.values import LARGEST, MOST_TRIALS, Finite
from meal_bayes.untrusted import NAME_LIMIT

if TYPE_CHECKING:
    from meal_bayes.evaluation import SummaryRow
    from meal_bayes.experiments import OfflineConfig, OfflineRun
    from meal_bayes.trials import TrialOutcomes

_AGAINST = "morc"  # the paper's agent, which the others are compared with
_MEASURE = "reward"


@click.group(cls=Section)
def run() -> None:
    """Run many trials of several agents."""


@run.command(short_help="Agents answer the same queries about new objects.")
@dataset_option
@click.option(
    "--attributes", type=click.IntRange(1, NAME_LIMIT), default=2, show_default=True, metavar="N",
    help="Asked at a time.",
)  # fmt: skip
@click.option(
    "--trials", type=click.IntRange(1, MOST_TRIALS), default=400, show_default=True, metavar="T",
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
    root: Path | None,
    agents: tuple[str, ...],
    as_json: bool,
    logs: Path,
    jobs: int,
    cluster: str | None,
    fresh: bool,
    **settings: Any,
) -> None:
    """Run agents on the same queries about objects they never learned from.

    An interrupted run continues when the same command is given again.
    """
    from meal_bayes.experiments import DEFAULT_AGENTS, OfflineConfig

    settings["dataset"] = table_of(settings["dataset"], root, settings["perception"])
    chosen = tuple(map(agent_value, listed(*agents))) or DEFAULT_AGENTS
    config = OfflineConfig(**settings, agents=chosen)
    finished = _run(config, logs=logs, jobs=jobs, cluster=cluster, fresh=fresh)
    rows, paired = _measure(finished)
    if as_json:
        facts = {"rows": [row.as_dict() for row in rows], "paired": paired}
        print_json({"config": config.as_dict(), **facts, "log": str(finished.folder)})
        return
    _print(output(), rows, paired)
    note(f"trials in {finished.folder}")


def _run(config: "OfflineConfig", **options: Any) -> "OfflineRun":
    """Run the trials that are missing, and show progress."""
    from meal_bayes.experiments import offline_tasks, run_offline, warm_up_offline
    from meal_bayes.experiments.percepts import percepts_for

    if config.perception == "default":
        table = percepts_for(config.dataset)
    else:
        with progress("percepts", "behaviors") as advance:
            table = percepts_for(
                config.dataset, config.perception, on_progress=advance, on_note=note
            )
    offline_tasks(table, config.attributes, config.trials, config.seed)  # raises before any work
    with showing_compilation():
        warm_up_offline(config)
    with resumed("trials") as advance:
        return run_offline(config, on_progress=advance, on_note=note, **options)


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
    interval = signs_of(console).interval
    table = new_table("agent", "accuracy", "cost, s", "reward", "NLL", "ECE", "abstained")
    for column in table.columns:
        column.no_wrap = True
    for row in rows:
        table.add_row(
            row.agent,
            f"{row.accuracy:.3f} {interval}{row.accuracy_se:.3f}",
            f"{row.cost_s:.1f}",
            f"{row.reward:.1f} {interval}{row.reward_se:.1f}",
            f"{row.nll:.3f}",
            f"{row.ece:.3f}",
            f"{row.abstained:.1%}",
        )
    console.print(table)
    console.print(
        Text(
            f"{rows[0].trials} trials an agent; {interval} one standard error, objects drawn as "
            "wholes; NLL and ECE of the final belief",
            "dim",
        )
    )
    _print_beliefs(console, rows)
    if paired:
        _print_paired(console, paired)


def _print_beliefs(console: Console, rows: "list[SummaryRow]") -> None:
    console.print()
    table = new_table("final belief", "NLL", "Brier", "ECE", "ECE if calibrated")
    for row in rows:
        numbers = (row.nll, row.brier, row.ece, row.ece_calibrated)
        table.add_row(row.agent, *(f"{number:.3f}" for number in numbers))
    console.print(table)


def _print_paired(console: Console, paired: "list[dict[str, object]]") -> None:
    console.print()
    table = new_table(f"{_MEASURE} against {_AGAINST}", "difference", "95 % interval")
    for entry in paired:
        low, high = (_signed(entry[name]) for name in ("low", "high"))
        table.add_row(str(entry["agent"]), _signed(entry["estimate"]), f"{low} to {high}")
    console.print(table)


def _signed(value: object) -> str:
    return f"{value:+.1f}" if isinstance(value, float) else "?"

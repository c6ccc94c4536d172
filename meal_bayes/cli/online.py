"""`meal-bayes run online`: robots that learn while they work."""

import json
import math
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from meal_bayes.cli.options import (
    OWN,
    agent_value,
    cluster_option,
    dataset_option,
    fresh_option,
    jobs_option,
    json_option,
    listed,
    logs_option,
    seed_option,
)
from meal_bayes.cli.screen import note, output, resumed, showing_compilation, signs_of
from meal_bayes.cli.values import LARGEST, MOST_TRIALS, Chance, Finite, Shares, Whole
from meal_bayes.untrusted import NAME_LIMIT

if TYPE_CHECKING:
    from meal_bayes.evaluation import LearningRow, LearningSummary

AGENTS = "iterative_random_legal, iterative_morc, morc_itrs, morc_itrs_auto, bayes or bayes_memory"


@click.command(short_help="Agents learn while they work, tested after every batch.")
@dataset_option
@click.option(
    "--attributes", type=Whole(1, NAME_LIMIT), default=1, show_default=True, metavar="N",
    help="Asked at a time.",
)  # fmt: skip
@click.option(
    "--agent", "agents", multiple=True, metavar="NAME",
    help=f"{AGENTS}; or {OWN}; may be repeated, or a comma list. "
    "iterative_morc, morc_itrs, bayes and bayes_memory by default.",
)  # fmt: skip
@click.option(
    "--batches", type=Whole(1, MOST_TRIALS), default=10, show_default=True, metavar="B",
    help="Refits.",
)  # fmt: skip
@click.option(
    "--trials", type=Whole(1, MOST_TRIALS), default=40, show_default=True, metavar="T",
    help="Of training, a batch.",
)  # fmt: skip
@click.option(
    "--repeats", type=Whole(1, MOST_TRIALS), default=1, show_default=True, metavar="R",
    help="Runs on other splits of the objects.",
)  # fmt: skip
@click.option(
    "--split", type=Shares(), default="33/33/34", show_default=True, metavar="A/B/C",
    help="Shares of objects known before, met in training, and tested on.",
)  # fmt: skip
@click.option(
    "--alpha", type=Finite(0, LARGEST), metavar="A", help="Of morc_itrs, s a bit; 6 by default."
)
@click.option(
    "--beta", type=Finite(0, LARGEST), metavar="B", help="Of morc_itrs, s; 30 by default."
)
@click.option(
    "--feedback", type=click.Choice(["verdict", "all"]), default="verdict", show_default=True,
    help="Is the robot told right or wrong, or every attribute?",
)  # fmt: skip
@click.option(
    "--error", type=Finite(0, 1, max_open=True), default=0.0, show_default=True,
    help="Share of what a person tells that is wrong.",
)  # fmt: skip
@click.option(
    "--success", type=Chance(), multiple=True, metavar="BEHAVIOR=P",
    help="How often a behavior of the robot's body succeeds; the data set's by default.",
)  # fmt: skip
@click.option("--learn-success", is_flag=True, help="Let agents learn how often behaviors succeed.")
@click.option(
    "--published", metavar="NAMES",
    help="Do as the authors' code: all, or a comma list of shaped_test, sample_wise, joint_label, "
    "model_percepts.",
)  # fmt: skip
@seed_option()
@jobs_option
@cluster_option
@click.option(
    "--log", type=click.Choice(["all", "train"]), default="all", show_default=True,
    help="Trials that are logged whole; of the others only what measures need is kept.",
)  # fmt: skip
@logs_option
@fresh_option
@json_option
def online(
    dataset: str,
    root: Path | None,
    attributes: int,
    agents: tuple[str, ...],
    batches: int,
    trials: int,
    repeats: int,
    split: tuple[int, int, int],
    alpha: float | None,
    beta: float | None,
    feedback: str,
    error: float,
    success: tuple[tuple[str, float], ...],
    learn_success: bool,
    published: str | None,
    seed: int,
    jobs: int,
    cluster: str | None,
    log: str,
    logs: Path,
    fresh: bool,
    as_json: bool,
) -> None:
    """Let agents answer questions, learn from whether they were right, and be tested in between.

    Needs the recordings: they are downloaded once, or read from MEAL_BAYES_DATA_URL. A run that was
    interrupted goes on where it stopped when the same command is given again.
    """
    from meal_bayes.agents import PublishedVariants
    from meal_bayes.experiments import OnlineConfig, run_online

    named = listed(*agents)
    config = OnlineConfig(
        dataset=dataset,
        root=None if root is None else str(root),
        attributes=attributes,
        **({"agents": tuple(map(agent_value, named))} if named else {}),  # type: ignore[arg-type]
        batches=batches,
        trials=trials,
        repeats=repeats,
        seed=seed,
        split=split,
        alpha=alpha,
        beta=beta,
        answers=feedback,
        error=error,
        success=success,
        learn_success=learn_success,
        published=PublishedVariants.named(*(listed(published) if published else ())),
        log=log,
    )
    from meal_bayes.evaluation import learning_rows, summarize_learning
    from meal_bayes.experiments import warm_up_online

    with showing_compilation():
        warm_up_online(config)
    with resumed("batches") as advance:
        finished = run_online(
            config,
            logs=logs,
            jobs=jobs,
            cluster=cluster,
            fresh=fresh,
            on_progress=advance,
            on_note=note,
        )
    results = list(finished.results())
    rows, summary = learning_rows(results), summarize_learning(results)
    if as_json:
        facts = {
            "config": finished.config.as_dict(),
            "rows": [row.as_dict() for row in rows],
            "summary": [row.as_dict() for row in summary],
            "log": str(finished.folder),
        }
        click.echo(json.dumps(facts, allow_nan=False))
        return
    _print(output(), rows, summary)
    note(f"trials in {finished.folder}")
    if log == "all":
        note(f"learning curves: meal-bayes report {finished.folder} -o report.html")


def _print(
    console: Console, rows: "Iterable[LearningRow]", summary: "list[LearningSummary]"
) -> None:
    spread = signs_of(console).spread
    table = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("agent", no_wrap=True)
    for name in ("explored, h", "accuracy", "claimed", "test cost, s", "reward", "ECE"):
        table.add_column(name, justify="right", no_wrap=True)
    by_agent: dict[str, list[LearningRow]] = {}
    for row in rows:
        by_agent.setdefault(row.agent, []).append(row)
    for one in summary:
        own = by_agent[one.agent]
        last = max(row.batch for row in own)
        end = [row for row in own if row.batch == last]
        table.add_row(
            one.agent,
            f"{one.exploration_hours:.1f}",
            f"{one.accuracy:.3f}",
            f"{_mean(row.claimed_accuracy for row in end):.3f}",
            f"{_mean(row.test_cost_s for row in end):.1f}",
            f"{one.reward:.1f}",
            f"{one.pooled_ece:.3f}",
        )
    console.print(table)
    console.print(
        Text(
            f"repeats: {summary[0].repeats}; accuracy and ECE of the last three batches, the rest "
            "after the last",
            "dim",
        )
    )
    against = Table(box=None, padding=(0, 2, 0, 0), header_style="bold")
    against.add_column("against iterative_morc", no_wrap=True)
    for name in ("hours ratio (90 %)", "accuracy", "reward"):
        against.add_column(name, justify="right", no_wrap=True)
    for one in summary:
        if one.hours_ratio == one.hours_ratio:  # not nan
            against.add_row(
                one.agent,
                f"{one.hours_ratio:.2f} ({one.hours_ratio_low:.2f} to {one.hours_ratio_high:.2f})",
                _difference(one.accuracy_difference, one.accuracy_difference_se, 3, spread),
                _difference(one.reward_difference, one.reward_difference_se, 1, spread),
            )
    if against.row_count:
        console.print()
        console.print(against)


def _difference(value: float, se: float, digits: int, spread: str) -> str:
    error = "" if math.isnan(se) else f" {spread}{se:.{digits}f}"  # nan: a single repeat tells none
    return f"{value:+.{digits}f}{error}"


def _mean(values: Iterable[float]) -> float:
    every = list(values)
    return sum(every) / len(every)

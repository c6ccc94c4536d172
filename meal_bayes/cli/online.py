"""`meal-bayes run online`: robots that learn while they work."""

import json
import math
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from meal_bayes.cli.console import note, output, resumed, showing_compilation, signs_of
from meal_bayes.cli.options import (
    ONLINE_AGENTS,
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
from meal_bayes.cli.values import LARGEST, MOST_TRIALS, Chance, Finite, Shares, Whole
from meal_bayes.untrusted import NAME_LIMIT

if TYPE_CHECKING:
    from meal_bayes.evaluation import LearningSummary
    from meal_bayes.trial_log import BatchOutcomes

_MOST = 40  # repeats of a run that goes on until it is decided


@click.command(short_help="Agents learn while they work, tested after every batch.")
@dataset_option
@click.option(
    "--attributes", type=Whole(1, NAME_LIMIT), default=1, show_default=True, metavar="N",
    help="Asked at a time.",
)  # fmt: skip
@click.option(
    "--agent", "agents", multiple=True, metavar="NAME",
    help=f"{ONLINE_AGENTS}; any agent of `run offline`; or {OWN}; may be repeated, or a comma "
    "list. The others are compared with the first. "
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
    "--repeats", type=Whole(1, MOST_TRIALS), metavar="R",
    help="Runs on other splits of the objects; 1 by default.",
)  # fmt: skip
@click.option(
    "--until-decided", is_flag=True,
    help="Run 10, 20, 40, ... repeats until every agent's 90 % interval excludes 0, at most "
    f"--repeats, {_MOST} by default.",
)  # fmt: skip
@click.option(
    "--split", type=Shares(), default="33/33/34", show_default=True, metavar="A/B/C",
    help="Shares of objects known before, met in training, and tested on.",
)  # fmt: skip
@click.option(
    "--alpha", type=Finite(0, LARGEST), metavar="A", help="Of Eq. 11, s a bit; 6 by default."
)
@click.option("--beta", type=Finite(0, LARGEST), metavar="B", help="Of Eq. 11, s; 30 by default.")
@click.option(
    "--normalizer", type=click.Choice(["paper", "all"]), default="paper", show_default=True,
    help="Of Eq. 10: experience gathered in training, as in the paper, or in pretraining too.",
)  # fmt: skip
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
    "--log", type=click.Choice(["compact", "full"]), default="compact", show_default=True,
    help="Form of the logs of test trials; a compact one keeps outcomes, no steps.",
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
    repeats: int | None,
    until_decided: bool,
    split: tuple[int, int, int],
    alpha: float | None,
    beta: float | None,
    normalizer: str,
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
    from meal_bayes.evaluation import decided, learning_rows, summarize_learning
    from meal_bayes.experiments import (
        OnlineConfig,
        run_online,
        run_online_until,
        warm_up_online,
    )

    named = listed(*agents)
    config = OnlineConfig(
        dataset=dataset,
        root=None if root is None else str(root),
        attributes=attributes,
        **({"agents": tuple(map(agent_value, named))} if named else {}),  # type: ignore[arg-type]
        batches=batches,
        trials=trials,
        repeats=repeats or (_MOST if until_decided else 1),
        seed=seed,
        split=split,
        alpha=alpha,
        beta=beta,
        normalizer=normalizer,
        answers=feedback,
        error=error,
        success=success,
        learn_success=learn_success,
        published=PublishedVariants.named(*(listed(published) if published else ())),
        log=log,
    )
    with showing_compilation():
        warm_up_online(config)
    with resumed("batches") as advance:
        how: dict[str, Any] = {
            "logs": logs, "jobs": jobs, "cluster": cluster, "fresh": fresh,
            "on_progress": advance, "on_note": note,
        }  # fmt: skip
        if until_decided:
            finished = run_online_until(config, decided, **how)
        else:
            finished = run_online(config, **how)
    results = list(finished.results())
    if as_json:
        facts = {
            "config": finished.config.as_dict(),
            "rows": [row.as_dict() for row in learning_rows(results)],
            "summary": [row.as_dict() for row in summarize_learning(results)],
        }
        click.echo(json.dumps(facts, allow_nan=False))
    else:
        _print(output(), results)
    note(f"trials in {finished.folder}")
    note(f"learning curves: meal-bayes report {finished.folder} -o report.html")


def _print(console: Console, results: "list[BatchOutcomes]") -> None:
    from meal_bayes.evaluation import learning_rows, summarize_learning

    rows, summary = learning_rows(results), summarize_learning(results)
    last = max(row.batch for row in rows)
    table = _table("agent", "explored, h", "accuracy", "claimed", "test cost, s", "reward", "ECE")
    for one in summary:
        end = [row for row in rows if (row.agent, row.batch) == (one.agent, last)]
        table.add_row(
            one.agent,
            f"{fmean(row.hours for row in end):.1f}",
            f"{one.accuracy_after:.3f}",
            f"{fmean(row.claimed_accuracy for row in end):.3f}",
            f"{fmean(row.test_cost_s for row in end):.1f}",
            f"{one.reward_after:.1f}",
            f"{one.ece_after:.3f}",
        )
    console.print(table)
    repeats = len({row.repeat for row in rows})
    console.print(Text(f"repeats: {repeats}; after the last batch, ECE of the last three", "dim"))
    if len(summary) > 1:
        console.print()
        console.print(_differences(results, summary, signs_of(console).interval))


def _differences(
    results: "list[BatchOutcomes]", summary: "list[LearningSummary]", spread: str
) -> Table:
    """Lay out the differences of mean reward: over the reference's hours, and at budgets."""
    from meal_bayes.evaluation.learning import BUDGETS, curves_of, difference_at

    base, hours = curves_of(results, summary[0].agent), summary[0].area_hours
    names = (f"first {hours:.1f} h", *(f"at {budget:g} h" for budget in BUDGETS), "after")
    table = _table(f"reward less {summary[0].agent}'s", *names)
    for one in summary[1:]:
        own = curves_of(results, one.agent)
        found = [difference_at(own, base, budget) for budget in BUDGETS]
        table.add_row(
            one.agent,
            _with_reach(one.area_reward_difference, one.area_high, spread),
            *(f"{at.estimate:+.1f}" for at in found),
            f"{one.reward_after_difference:+.1f}",
        )
    table.caption = f"{spread}: half of the 90 % interval over repeats"
    return table


def _with_reach(estimate: float, high: float, spread: str) -> str:
    reach = high - estimate
    return f"{estimate:+.1f}" + ("" if math.isnan(reach) else f" {spread}{reach:.1f}")


def _table(*names: str) -> Table:
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="bold")
    table.add_column(names[0], no_wrap=True)
    for name in names[1:]:
        table.add_column(name, justify="right", no_wrap=True)
    return table

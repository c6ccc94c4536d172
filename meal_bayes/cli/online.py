"""`meal-bayes run online`: agents that learn from their own trials."""

import math
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import click
from rich.console import Console
from rich.table import Table
from rich.text import Text

from meal_bayes.cli.console import (
    new_table,
    note,
    output,
    print_json,
    resumed,
    showing_compilation,
    signs_of,
)
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
from meal_bayes.cli.values import LARGEST, MOST_TRIALS, Chance, Finite, Shares
from meal_bayes.untrusted import NAME_LIMIT

if TYPE_CHECKING:
    from collections.abc import Callable

    from meal_bayes.evaluation import LearningSummary
    from meal_bayes.trials import BatchOutcomes, TrialOutcomes

    Training = Callable[[str], list[TrialOutcomes]]

_MOST = 40  # repeats of a run that goes on until it is decided


@click.command(short_help="Agents learn while they work, tested after every batch.")
@dataset_option
@click.option(
    "--attributes", type=click.IntRange(1, NAME_LIMIT), default=1, show_default=True, metavar="N",
    help="Asked at a time.",
)  # fmt: skip
@click.option(
    "--agent", "agents", multiple=True, metavar="NAME",
    help=f"{ONLINE_AGENTS}; any agent of `run offline`; or {OWN}; may be repeated, or a comma "
    "list. The others are compared with the first. "
    "iterative_morc, morc_itrs, bayes and bayes_memory by default.",
)  # fmt: skip
@click.option(
    "--batches", type=click.IntRange(1, MOST_TRIALS), default=10, show_default=True, metavar="B",
    help="Refits.",
)  # fmt: skip
@click.option(
    "--trials", type=click.IntRange(1, MOST_TRIALS), default=40, show_default=True, metavar="T",
    help="Of training, a batch.",
)  # fmt: skip
@click.option(
    "--repeats", type=click.IntRange(1, MOST_TRIALS), metavar="R",
    help="Runs on other splits of the objects; 1 by default.",
)  # fmt: skip
@click.option(
    "--until-decided", is_flag=True,
    help="Run 10, 20, 40, ... repeats until every agent's interval excludes 0, at most "
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
    "--feedback", "answers", type=click.Choice(["verdict", "all"]), default="verdict",
    show_default=True,
    help="Whether the report was right, or the labels of all attributes asked.",
)  # fmt: skip
@click.option(
    "--error", type=Finite(0, 1, max_open=True), default=0.0, show_default=True,
    help="Probability that feedback is wrong.",
)  # fmt: skip
@click.option(
    "--success", type=Chance(), multiple=True, metavar="BEHAVIOR=P",
    help="True success probability of a behavior; the data set's by default.",
)  # fmt: skip
@click.option("--learn-success", is_flag=True, help="Let agents learn success probabilities.")
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
    root: Path | None,
    agents: tuple[str, ...],
    until_decided: bool,
    as_json: bool,
    **settings: Any,
) -> None:
    """Train agents on their own trials by feedback, and test them after every batch.

    Needs the recordings: they are downloaded once, or read from MEAL_BAYES_DATA_URL. A run that was
    interrupted continues when the same command is given again.
    """
    from meal_bayes.evaluation import decided, learning_rows, summarize_learning
    from meal_bayes.experiments import (
        OnlineConfig,
        run_online,
        run_online_until,
        warm_up_online,
    )

    how = {name: settings.pop(name) for name in ("logs", "jobs", "cluster", "fresh")}
    settings["root"] = None if root is None else str(root)
    settings["repeats"] = settings["repeats"] or (_MOST if until_decided else 1)
    if agents:
        settings["agents"] = tuple(map(agent_value, listed(*agents)))
    config = OnlineConfig(**settings)
    with showing_compilation():
        warm_up_online(config)
    with resumed("batches") as advance:
        how |= {"on_progress": advance, "on_note": note}
        if until_decided:
            finished = run_online_until(config, decided, **how)
        else:
            finished = run_online(config, **how)
    results = list(finished.results())
    if as_json:
        print_json(
            {
                "config": finished.config.as_dict(),
                "rows": [row.as_dict() for row in learning_rows(results)],
                "summary": [row.as_dict() for row in summarize_learning(results)],
            }
        )
    else:
        _print(output(), results, finished.training)
    note(f"trials in {finished.folder}")
    note(f"learning curves: meal-bayes report {finished.folder} -o report.html")


def _print(console: Console, results: "list[BatchOutcomes]", training: "Training") -> None:
    from meal_bayes.evaluation import learning_rows, summarize_learning

    rows, summary = learning_rows(results), summarize_learning(results)
    last = max(row.batch for row in rows)
    names = ("explored, h", "accuracy", "claimed", "test cost, s", "reward", "ECE")
    table = _narrow(new_table("agent", *names))
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
        spread = signs_of(console).interval
        console.print(_differences(results, summary, spread))
        console.print(_successes(training, [one.agent for one in summary], spread))


def _differences(
    results: "list[BatchOutcomes]", summary: "list[LearningSummary]", spread: str
) -> Table:
    """Return a table of mean reward differences: over the reference's hours, and at budgets."""
    from meal_bayes.evaluation.learning import BUDGETS, curves_of, difference_at

    base, hours = curves_of(results, summary[0].agent), summary[0].area_hours
    names = (f"first {hours:.1f} h", *(f"at {budget:g} h" for budget in BUDGETS), "after")
    table = _narrow(new_table(f"reward less {summary[0].agent}'s", *names))
    for one in summary[1:]:
        own = curves_of(results, one.agent)
        found = [difference_at(own, base, budget) for budget in BUDGETS]
        table.add_row(
            one.agent,
            _with_reach(one.area_reward_difference, one.area_high, spread),
            *(f"{at.estimate:+.1f}" for at in found),
            f"{one.reward_after_difference:+.1f}",
        )
    table.caption = f"{spread}: half of the 95 % interval over splits"
    return table


def _successes(training: "Training", agents: list[str], spread: str) -> Table:
    """Return a table of differences in training's successes within budgets (Eq. 7)."""
    from meal_bayes.evaluation.learning import BUDGETS, success_difference

    names, base = (f"in {budget:g} h" for budget in BUDGETS), training(agents[0])
    table = _narrow(new_table(f"successes less {agents[0]}'s", *names))
    for name in agents[1:]:
        own = training(name)
        found = [success_difference(own, base, 3600 * hours) for hours in BUDGETS]
        table.add_row(name, *(_with_reach(at.estimate, at.high, spread) for at in found))
    table.caption = "of training trials, none of those that pass the budget (Eq. 7)"
    return table


def _with_reach(estimate: float, high: float, spread: str) -> str:
    reach = high - estimate
    return f"{estimate:+.1f}" + ("" if math.isnan(reach) else f" {spread}{reach:.1f}")


def _narrow(table: Table) -> Table:
    """Set columns close and lines whole, so that 80 characters hold them."""
    table.padding = (0, 1, 0, 0)
    for column in table.columns:
        column.no_wrap = True
    return table

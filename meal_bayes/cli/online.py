"""`meal-bayes run online`: agents that learn from their own trials."""

import math
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from meal_bayes.cli.console import (
    note,
    output,
    print_json,
    print_table,
    resumed,
    showing_compilation,
    signs_of,
)
from meal_bayes.cli.options import (
    COUNT,
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
    option,
    seed_option,
)
from meal_bayes.cli.values import LARGEST, Finite, chance, shares
from meal_bayes.untrusted import NAME_LIMIT

if TYPE_CHECKING:
    from collections.abc import Callable

    from meal_bayes.evaluation import LearningSummary
    from meal_bayes.trials import BatchOutcomes, TrialOutcomes

    Training = Callable[[str], list[TrialOutcomes]]

_MOST = 40  # repeats of a run that goes on until it is decided


@click.command(short_help="Agents learn while they work, tested after every batch.")
@dataset_option
@option("--attributes", click.IntRange(1, NAME_LIMIT), 1, "N", "Asked at a time.")
@option(
    "--agent agents", None, None, "NAME",
    f"{ONLINE_AGENTS}; any agent of `run offline`; or {OWN}; may be repeated, or a comma list. The "
    "others are compared with the first. iterative_morc, morc_itrs, bayes and bayes_memory by "
    "default.", multiple=True,
)  # fmt: skip
@option("--batches", COUNT, 10, "B", "Refits.")
@option("--trials", COUNT, 40, "T", "Of training, a batch.")
@option("--repeats", COUNT, None, "R", "Runs on other splits of the objects; 1 by default.")
@click.option(
    "--until-decided", is_flag=True,
    help="Run 10, 20, 40, ... repeats until every agent's interval excludes 0, at most "
    f"--repeats, {_MOST} by default.",
)  # fmt: skip
@option(
    "--split", shares, "33/33/34", "A/B/C",
    "Shares of objects known before, met in training, and tested on.",
)  # fmt: skip
@option("--alpha", Finite(0, LARGEST), None, "A", "Of Eq. 11, s a bit; 6 by default.")
@option("--beta", Finite(0, LARGEST), None, "B", "Of Eq. 11, s; 30 by default.")
@option(
    "--normalizer", click.Choice(["paper", "all"]), "paper", None,
    "Of Eq. 10: experience gathered in training, as in the paper, or in pretraining too.",
)  # fmt: skip
@option(
    "--feedback answers", click.Choice(["verdict", "all"]), "verdict", None,
    "Whether the report was right, or the labels of all attributes asked.",
)  # fmt: skip
@option("--error", Finite(0, 1, max_open=True), 0.0, None, "Probability that feedback is wrong.")
@option(
    "--success", chance, None, "BEHAVIOR=P",
    "True success probability of a behavior; the data set's by default.", multiple=True,
)  # fmt: skip
@click.option("--learn-success", is_flag=True, help="Let agents learn success probabilities.")
@seed_option()
@jobs_option
@cluster_option
@option(
    "--log", click.Choice(["compact", "full"]), "compact", None,
    "Form of the logs of test trials; a compact one keeps outcomes, no steps.",
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
        _print(results, finished.training)
    note(f"trials in {finished.folder}")
    note(f"learning curves: meal-bayes report {finished.folder} -o report.html")


def _print(results: "list[BatchOutcomes]", training: "Training") -> None:
    from meal_bayes.evaluation import learning_rows, summarize_learning

    rows, summary = learning_rows(results), summarize_learning(results)
    last, cells = max(row.batch for row in rows), []
    for one in summary:
        end = [row for row in rows if (row.agent, row.batch) == (one.agent, last)]
        hours, claimed, cost = (
            fmean(getattr(row, name) for row in end)
            for name in ("hours", "claimed_accuracy", "test_cost_s")
        )
        cells.append(
            (one.agent, f"{hours:.1f}", f"{one.accuracy_after:.3f}", f"{claimed:.3f}",
             f"{cost:.1f}", f"{one.reward_after:.1f}", f"{one.ece_after:.3f}")
        )  # fmt: skip
    heads = ("agent", "explored, h", "accuracy", "claimed", "test cost, s", "reward", "ECE")
    print_table(heads, cells, narrow=True)
    repeats = len({row.repeat for row in rows})
    text = f"repeats: {repeats}; after the last batch, ECE of the last three\n"
    output().print(Text(text, "dim"), end="")
    if len(summary) > 1:
        output().print()
        _print_differences(results, summary)
        _print_successes(training, [one.agent for one in summary])


def _print_differences(results: "list[BatchOutcomes]", summary: "list[LearningSummary]") -> None:
    """Print mean reward differences: over the reference's hours, at budgets, and at the end."""
    from meal_bayes.evaluation.learning import BUDGETS, curves_of, difference_at

    base, cells = curves_of(results, summary[0].agent), []
    for one in summary[1:]:
        own = curves_of(results, one.agent)
        gains = (difference_at(own, base, budget).estimate for budget in BUDGETS)
        first = _with_reach(one.area_reward_difference, one.area_high)
        after = f"{one.reward_after_difference:+.1f}"
        cells.append((one.agent, first, *(f"{gain:+.1f}" for gain in gains), after))
    heads = (f"first {summary[0].area_hours:.1f} h", *(f"at {hours:g} h" for hours in BUDGETS))
    caption = f"{signs_of(output()).interval}: half of the 95 % interval over splits"
    names = (f"reward less {summary[0].agent}'s", *heads, "after")
    print_table(names, cells, narrow=True, caption=caption)


def _print_successes(training: "Training", agents: list[str]) -> None:
    """Print differences in training's successes within budgets (Eq. 7)."""
    from meal_bayes.evaluation.learning import BUDGETS, success_difference

    base, cells = training(agents[0]), []
    for name in agents[1:]:
        own = training(name)
        gains = (success_difference(own, base, 3600 * hours) for hours in BUDGETS)
        cells.append((name, *(_with_reach(gain.estimate, gain.high) for gain in gains)))
    names = (f"successes less {agents[0]}'s", *(f"in {hours:g} h" for hours in BUDGETS))
    caption = "of training trials, none of those that pass the budget (Eq. 7)"
    print_table(names, cells, narrow=True, caption=caption)


def _with_reach(estimate: float, high: float) -> str:
    reach = high - estimate
    interval = "" if math.isnan(reach) else f" {signs_of(output()).interval}{reach:.1f}"
    return f"{estimate:+.1f}{interval}"

"""`meal-bayes run online`: agents that learn from their own trials."""

import contextlib
import math
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.untrusted import LARGEST, NAME_LIMIT

if TYPE_CHECKING:
    from collections.abc import Callable

    from meal_bayes.evaluation.learning import LearningSummary
    from meal_bayes.trials import BatchOutcomes, TrialOutcomes

    Training = Callable[[str], list[TrialOutcomes]]

_MOST = 40  # repeats of a run that goes on until it is decided


def _shares(text: str) -> tuple[int, ...]:
    """Read three parts of the objects, such as 33/33/34."""
    with contextlib.suppress(ValueError):
        parts = tuple(map(int, text.split("/")))
        if len(parts) == 3 and min(parts) > 0:
            return parts
    raise click.BadParameter(
        f"split is {text!r}; give three whole numbers above 0, such as 33/33/34."
    )


def _chance(text: str) -> tuple[str, float]:
    """Read a behavior and its probability, such as grasp=0.5."""
    name, _, number = text.rpartition("=")
    with contextlib.suppress(ValueError):
        if name.strip() and 0 < float(number) <= 1:
            return name.strip(), float(number)
    raise click.BadParameter(f"success is {text!r}; give it as grasp=0.5, above 0 and at most 1.")


@click.command(short_help="Agents learn while they work, tested after every batch.")
@opt.dataset_option
@opt.option("--attributes", click.IntRange(1, NAME_LIMIT), 1, "N", "Asked at a time.")
@opt.option(
    "--agent agents", None, None, "NAME",
    f"{opt.ONLINE_AGENTS}; any agent of `run offline`; or {opt.OWN}; may be repeated, or a comma "
    "list. The others are compared with the first. iterative_morc, morc_itrs, bayes and "
    "bayes_memory by default.", multiple=True,
)  # fmt: skip
@opt.option("--batches", opt.COUNT, 10, "B", "Refits.")
@opt.option("--trials", opt.COUNT, 40, "T", "Of training, a batch.")
@opt.option("--repeats", opt.COUNT, None, "R", "Runs on other splits of the objects; 1 by default.")
@click.option(
    "--until-decided", is_flag=True,
    help="Run 10, 20, 40, ... repeats until every agent's interval excludes 0, at most "
    f"--repeats, {_MOST} by default.",
)  # fmt: skip
@opt.option(
    "--split", _shares, "33/33/34", "A/B/C",
    "Shares of objects known before, met in training, and tested on.",
)  # fmt: skip
@opt.option("--alpha", click.FloatRange(0, LARGEST), None, "A", "Of Eq. 11, s a bit; 6 by default.")
@opt.option("--beta", click.FloatRange(0, LARGEST), None, "B", "Of Eq. 11, s; 30 by default.")
@opt.option(
    "--normalizer", click.Choice(["paper", "all"]), "paper", None,
    "Of Eq. 10: experience gathered in training, as in the paper, or in pretraining too.",
)  # fmt: skip
@opt.option(
    "--feedback answers", click.Choice(["verdict", "all"]), "verdict", None,
    "Whether the report was right, or the labels of all attributes asked.",
)  # fmt: skip
@opt.option(
    "--error",
    click.FloatRange(0, 1, max_open=True),
    0.0,
    None,
    "Probability that feedback is wrong.",
)
@opt.option(
    "--success", _chance, None, "BEHAVIOR=P",
    "True success probability of a behavior; the data set's by default.", multiple=True,
)  # fmt: skip
@click.option("--learn-success", is_flag=True, help="Let agents learn success probabilities.")
@opt.seed_option()
@opt.jobs_option
@opt.cluster_option
@opt.option(
    "--log", click.Choice(["compact", "full"]), "compact", None,
    "Form of the logs of test trials; a compact one keeps outcomes, no steps.",
)  # fmt: skip
@opt.logs_option
@opt.fresh_option
@opt.json_option
def online(
    root: Path | None, agents: tuple[str, ...], until_decided: bool, as_json: bool, **settings: Any
) -> None:
    """Train agents on their own trials by feedback, and test them after every batch.

    Needs the recordings: they are downloaded once, or read from MEAL_BAYES_DATA_URL. A run that was
    interrupted continues when the same command is given again.
    """
    from meal_bayes.evaluation.learning import decided, learning_rows, summarize_learning
    from meal_bayes.experiments import OnlineConfig, run_online, run_online_until, warm_up_online

    how = {name: settings.pop(name) for name in ("logs", "jobs", "cluster", "fresh")}
    settings["root"] = None if root is None else str(root)
    settings["repeats"] = settings["repeats"] or (_MOST if until_decided else 1)
    if agents:
        settings["agents"] = tuple(map(opt.agent_value, opt.listed(*agents)))
    config = OnlineConfig(**settings)
    with terminal.showing_compilation():
        warm_up_online(config)
    with terminal.resumed("batches") as advance:
        how |= {"on_progress": advance, "on_note": terminal.note}
        if until_decided:
            finished = run_online_until(config, decided, **how)
        else:
            finished = run_online(config, **how)
    results = list(finished.results())
    if as_json:
        rows = [row.as_dict() for row in learning_rows(results)]
        summary = [row.as_dict() for row in summarize_learning(results)]
        config_facts = finished.config.as_dict()
        terminal.print_json({"config": config_facts, "rows": rows, "summary": summary})
    else:
        _print(results, finished.training)
    terminal.note(f"trials in {finished.folder}")
    terminal.note(f"learning curves: meal-bayes report {finished.folder} -o report.html")


def _print(results: "list[BatchOutcomes]", training: "Training") -> None:
    from meal_bayes.evaluation.learning import learning_rows, summarize_learning

    rows, summary = learning_rows(results), summarize_learning(results)
    last, cells = max(row.batch for row in rows), []
    for one in summary:
        end = [row for row in rows if (row.agent, row.batch) == (one.agent, last)]
        claimed = fmean(row.claimed_accuracy for row in end)
        cells.append(
            (one.agent, f"{fmean(row.hours for row in end):.1f}", f"{one.accuracy_after:.3f}",
             f"{claimed:.3f}", f"{fmean(row.test_cost_s for row in end):.1f}",
             f"{one.reward_after:.1f}", f"{one.ece_after:.3f}")
        )  # fmt: skip
    heads = ("agent", "explored, h", "accuracy", "claimed", "test cost, s", "reward", "ECE")
    terminal.print_table(heads, cells, narrow=True)
    repeats = len({row.repeat for row in rows})
    text = f"repeats: {repeats}; after the last batch, ECE of the last three\n"
    terminal.output().print(Text(text, "dim"), end="")
    if len(summary) > 1:
        terminal.output().print()
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
    caption = "±: half of the 95 % interval over splits"
    names = (f"reward less {summary[0].agent}'s", *heads, "after")
    terminal.print_table(names, cells, narrow=True, caption=caption)


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
    terminal.print_table(names, cells, narrow=True, caption=caption)


def _with_reach(estimate: float, high: float) -> str:
    reach = high - estimate
    return f"{estimate:+.1f}" + ("" if math.isnan(reach) else f" ±{reach:.1f}")

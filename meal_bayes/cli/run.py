"""`meal-bayes run`: many trials, paired over agents, resumed where they stopped."""

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.program import Section
from meal_bayes.untrusted import LARGEST, NAME_LIMIT

if TYPE_CHECKING:
    from meal_bayes.evaluation import SummaryRow

_AGAINST = "morc"  # the paper's agent, which the others are compared with
_MEASURE = "reward"


@click.group(cls=Section)
def run() -> None:
    """Run many trials of several agents."""


@run.command(short_help="Agents answer the same queries about new objects.")
@opt.dataset_option
@opt.option("--attributes", click.IntRange(1, NAME_LIMIT), 2, "N", "Asked at a time.")
@opt.option("--trials", opt.COUNT, 400, "T", "For each agent.")
@opt.option(
    "--agent agents", None, None, "NAME",
    f"{opt.AGENTS}; or {opt.OWN}; may be repeated, or a comma list. All of them by default.",
    multiple=True,
)  # fmt: skip
@opt.seed_option()
@opt.jobs_option
@opt.cluster_option
@opt.option(
    "--percepts", click.Choice(["recorded", "model"]), "recorded", None,
    "Of real recordings, or drawn from the learned confusion matrices.",
)  # fmt: skip
@opt.perception_option
@opt.option(
    "--reward", click.FloatRange(0, LARGEST, min_open=True), None, "R",
    "For a right answer, and taken for a wrong one; the data set's by default.",
)  # fmt: skip
@opt.logs_option
@opt.fresh_option
@opt.json_option
def offline(
    root: Path | None, agents: tuple[str, ...], as_json: bool, logs: Path, jobs: int,
    cluster: str | None, fresh: bool, **settings: Any,
) -> None:  # fmt: skip
    """Run agents on the same queries about objects they never learned from.

    An interrupted run continues when the same command is given again.
    """
    from meal_bayes.evaluation import compare, summarize
    from meal_bayes.evaluation.statistics import plain
    from meal_bayes.experiments import (
        DEFAULT_AGENTS,
        OfflineConfig,
        offline_tasks,
        run_offline,
        warm_up_offline,
    )
    from meal_bayes.experiments.percepts import percepts_for

    settings["dataset"] = opt.table_of(settings["dataset"], root, settings["perception"])
    chosen = tuple(map(opt.agent_value, opt.listed(*agents))) or DEFAULT_AGENTS
    config = OfflineConfig(**settings, agents=chosen)
    how: dict[str, Any] = {"on_note": terminal.note}
    with terminal.progress("percepts", "behaviors") as advance:
        table = percepts_for(config.dataset, config.perception, on_progress=advance, **how)
    offline_tasks(table, config.attributes, config.trials, config.seed)  # raises before any work
    with terminal.showing_compilation():
        warm_up_offline(config)
    how |= {"logs": logs, "jobs": jobs, "cluster": cluster, "fresh": fresh}
    with terminal.resumed("trials") as advance:
        finished = run_offline(config, on_progress=advance, **how)
    outcomes = finished.outcomes()
    rows = summarize(outcomes, seconds=finished.seconds)
    pair: dict[str, object] = {"against": _AGAINST, "measure": _MEASURE}
    paired = [
        {
            "agent": name,
            **pair,
            **plain(compare(outcomes, name, _AGAINST, measure=_MEASURE)._asdict()),
        }
        for name in outcomes.agents
        if _AGAINST in outcomes.agents and name != _AGAINST
    ]
    if as_json:
        facts = {"rows": [row.as_dict() for row in rows], "paired": paired}
        terminal.print_json({"config": config.as_dict(), **facts, "log": str(finished.folder)})
        return
    _print(rows, paired)
    terminal.note(f"trials in {finished.folder}")


def _print(rows: "list[SummaryRow]", paired: "list[dict[str, object]]") -> None:
    console = terminal.output()
    cells = (
        (row.agent, f"{row.accuracy:.3f} ±{row.accuracy_se:.3f}", f"{row.cost_s:.1f}",
         f"{row.reward:.1f} ±{row.reward_se:.1f}", f"{row.nll:.3f}", f"{row.ece:.3f}",
         f"{row.abstained:.1%}")
        for row in rows
    )  # fmt: skip
    names = ("agent", "accuracy", "cost, s", "reward", "NLL", "ECE", "abstained")
    terminal.print_table(names, cells, narrow=True)
    text = (
        f"{rows[0].trials} trials an agent; ± one standard error, objects drawn as "
        "wholes; NLL and ECE of the final belief"
    )
    console.print(Text(text, "dim"))
    console.print()
    beliefs = (
        (row.agent, f"{row.nll:.3f}", f"{row.brier:.3f}", f"{row.ece:.3f}",
         f"{row.ece_calibrated:.3f}")
        for row in rows
    )  # fmt: skip
    terminal.print_table(("final belief", "NLL", "Brier", "ECE", "ECE if calibrated"), beliefs)
    if paired:
        console.print()
        differences = (
            (str(pair["agent"]), _signed(pair["estimate"]),
             f"{_signed(pair['low'])} to {_signed(pair['high'])}")
            for pair in paired
        )  # fmt: skip
        heads = (f"{_MEASURE} against {_AGAINST}", "difference", "95 % interval")
        terminal.print_table(heads, differences)


def _signed(value: object) -> str:
    return f"{value:+.1f}" if isinstance(value, float) else "?"

"""`meal-bayes report`: one page of a run; `compare`: who is ahead, by a model of all outcomes."""

from dataclasses import asdict
from pathlib import Path

import click

from meal_bayes.cli.console import note, print_json, print_table, progress, say
from meal_bayes.cli.options import FILE, option, shared


@click.command(short_help="Write one page (HTML) of a run: tables, figures, worst trials.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path))
@option("-o --out", FILE, Path("report.html"), "FILE.html",
        "The page; everything it needs is in it.")  # fmt: skip
def report(logs: tuple[Path, ...], out: Path) -> None:
    """Write one page of the trials in LOGS, files or runs' folders."""
    from meal_bayes.evaluation.report import write_report
    from meal_bayes.trial_log import Logs

    files = Logs(*logs)
    with progress("reading", "files") as advance:
        outcomes = write_report(files, out, on_progress=advance)
    for problem in files.problems:
        note(f"warning: {problem}; the report counts the whole trials")
    trials, agents = len(outcomes), len(outcomes.agents)
    counted = f"{trials} trial{'s' * (trials != 1)} of {agents} agent{'s' * (agents != 1)}"
    say(f"{out}: {counted}, {out.stat().st_size:,} bytes")


@click.command(short_help="Compare agents by a hierarchical model of their outcomes.")
@click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path))
@option("--measure", click.Choice(["success", "cost", "reward"]), "success", None,
        "What is compared.")  # fmt: skip
@option("--reference", None, None, "AGENT", "Compared with; the first one by default.")
@option(
    "--margin", click.FloatRange(0, min_open=True), None, "M",
    "Of practical equivalence; .02 of accuracy, 2 s of cost, 10 of reward by default.",
)  # fmt: skip
@shared("seed", "json")
def compare(
    logs: tuple[Path, ...], measure: str, reference: str | None, margin: float | None, seed: int,
    as_json: bool,
) -> None:  # fmt: skip
    """Compare the agents in LOGS, files or runs' folders, on the tasks that they were given.

    Effects are shrunk towards each other; `ahead` is the probability of being better than the
    reference, `equivalent` that of differing by less than the margin.
    """
    from meal_bayes.evaluation.outcome_model import compare_outcomes
    from meal_bayes.trial_log import Logs
    from meal_bayes.trials import TrialOutcomes

    repeats: dict[str, int] = {}
    parts, again = [], []
    for group in Logs(*logs).groups():
        place = next((name for name in group.file.parts if name.startswith("repeat-")), "")
        parts.append(group.outcomes)
        again += [repeats.setdefault(place, len(repeats))] * len(group.outcomes)
    rows = compare_outcomes(
        TrialOutcomes.join(parts), measure=measure, reference=reference, repeats=again,
        margin=margin, seed=seed,
    )  # fmt: skip
    if as_json:
        print_json({"effects": [row.as_dict() for row in rows]})
        return
    say(f"{measure} less {rows[0].reference}'s, by the model of all outcomes")
    columns = {
        "agent": "{agent}", "trials": "{trials}", "plain": "{plain:+.3f}",
        "effect": "{effect:+.3f}", "95 %": "{low:+.3f} to {high:+.3f}", "ahead": "{ahead:.3f}",
        "equivalent": "{equivalent:.3f}",
    }  # fmt: skip
    print_table(columns, map(asdict, rows))

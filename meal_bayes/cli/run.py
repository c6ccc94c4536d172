"""`meal-bayes run`: many trials, paired over agents, resumed where they stopped."""

import math
from dataclasses import asdict, replace
from pathlib import Path
from statistics import fmean
from typing import TYPE_CHECKING, Any

import click
from rich.text import Text

from meal_bayes.cli import console as terminal
from meal_bayes.cli import options as opt
from meal_bayes.cli.program import Section
from meal_bayes.files import command_line

if TYPE_CHECKING:
    from meal_bayes.evaluation import SummaryRow
    from meal_bayes.evaluation.learning import LearningRow, LearningSummary
    from meal_bayes.evaluation.summary import Summary
    from meal_bayes.experiments.units import Planned

_AGAINST = "morc"  # the paper's agent, which the others are compared with
_MEASURE = "reward"
_HOW = ("logs", "jobs", "fresh")  # options that are no settings of a run
_LEAST_SPLITS = 5  # splits, below which an interval over them says nothing
_FIRST_LOOK = 10  # repeats after which a run that goes on until it is decided looks first
_MOST_REPEATS = 40  # of such a run


@click.group(cls=Section)
def run() -> None:
    """Run many trials of several agents."""


@run.command(short_help="Agents answer the same questions about new objects.")
@opt.shared("dataset", "root")
@opt.option(
    "--attributes", click.IntRange(1, opt.NAME_LIMIT), 2, "N", "Number of attributes in a question."
)
@opt.option("--trials", opt.COUNT, 400, "T", "Trials of each agent.")
@opt.option(
    "--agent agents",
    None,
    None,
    "NAME",
    f"{opt.AGENTS}; or {opt.OWN}; may be repeated, or a comma list. All but olfc by default.",
    multiple=True,
)
@opt.shared("seed", "key", "jobs", "cluster")
@opt.option(
    "--percepts",
    click.Choice(["recorded", "model"]),
    "recorded",
    None,
    "Take percepts from recordings, or draw them from the learned confusion matrices.",
)
@opt.shared("perception")
@opt.option(
    "--reward",
    opt.FiniteRange(0, opt.LARGEST, min_open=True),
    None,
    "R",
    "Reward of a right answer, and loss of a wrong one; the data set's by default.",
)
@click.option(
    "--yes-no",
    is_flag=True,
    help="Ask whether all attributes are true, instead of asking for their values.",
)
@click.option(
    "--yes-no-balanced",
    is_flag=True,
    help='Like --yes-no, with negations ("red and not empty"): half of the answers are yes.',
)
@opt.shared("payoffs", "logs", "fresh", "json")
def offline(
    root: Path | None,
    agents: tuple[str, ...],
    cluster: str | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Run agents on the same questions about objects from which they did not learn.

    If a run was interrupted, the same command continues it.
    """
    from meal_bayes import experiments
    from meal_bayes.evaluation import answer_rates, summarize
    from meal_bayes.evaluation.summary import no_better_than_prior
    from meal_bayes.experiments.offline import plan_offline
    from meal_bayes.experiments.parallel import on_cluster

    how = {name: settings.pop(name) for name in _HOW}
    settings["answer"] = _answer(settings.pop("yes_no"), settings.pop("yes_no_balanced"))
    settings["payoffs"] = settings["payoffs"] or None
    perception = settings["perception"]
    settings["dataset"], _ = opt.table_of(settings["dataset"], root, perception)
    compared = tuple(map(opt.agent_value, opt.comma_list(*agents))) or experiments.DEFAULT_AGENTS
    config = experiments.OfflineConfig(**settings, agents=compared)
    _compile(plan_offline(config, logs=how["logs"]))
    with on_cluster(cluster), terminal.resumed("trials") as advance:
        how |= {"on_progress": advance, "on_note": terminal.note}
        finished = experiments.run_offline(config, **how)
    rows = summarize(finished)
    paired = _paired(rows)
    rates = {}
    if config.answer != "values":
        outcomes = rows.outcomes
        rates = {name: answer_rates(outcomes.of_agent(name)) for name in outcomes.agents}
    if as_json:
        facts: dict[str, Any] = {"rows": [row.as_dict() for row in rows], "paired": paired}
        facts |= {"rates": {name: rate._asdict() for name, rate in rates.items()}} if rates else {}
        terminal.print_json({"config": config.as_dict(), **facts, "log": str(finished.folder)})
        return
    _print_summary(rows, paired)
    if rates:
        _print_rates(rates)
    no_better = no_better_than_prior(rows.outcomes)
    if no_better:
        terminal.say(no_better)
    terminal.note(f"trials in {finished.folder}")


def _compile(planned: "Planned") -> None:
    """Compile what a run needs, before the bar of its trials, which would stand still meanwhile.

    A run is planned before, so that what cannot be asked is told before anything is compiled.
    """
    with terminal.showing_compilation():
        planned.warm_up()


def _answer(yes_no: bool, balanced: bool) -> str:
    """Return how questions are answered, by the two options."""
    if yes_no and balanced:
        raise click.UsageError("--yes-no and --yes-no-balanced are two forms; give one.")
    if balanced:
        return "balanced"
    if yes_no:
        return "yes or no"
    return "values"


def _paired(rows: "Summary") -> list[dict[str, object]]:
    """Return the difference of each agent from the one that they are compared with, if it ran."""
    compared_agents = rows.outcomes.agents
    if _AGAINST not in compared_agents:
        return []
    return [
        {
            "agent": name,
            "against": _AGAINST,
            "measure": _MEASURE,
            **rows.compare(name, _AGAINST, measure=_MEASURE)._asdict(),
        }
        for name in compared_agents
        if name != _AGAINST
    ]


def _print_rates(rates: "dict[str, Any]") -> None:
    """Print hits and false alarms of each agent's answers yes or no."""
    terminal.output().print()
    heads = {
        "agent": "{agent}",
        "hit rate": "{hit_rate:.3f}",
        "false-alarm rate": "{false_alarm_rate:.3f}",
        "yes is right": "{yes:.1%}",
    }
    cells = ({"agent": name, **rate._asdict()} for name, rate in rates.items())
    terminal.print_table(heads, cells, narrow=True)


def _print_summary(rows: "list[SummaryRow]", paired: "list[dict[str, object]]") -> None:
    from meal_bayes.evaluation.statistics import MASS_TEXT
    from meal_bayes.evaluation.summary import accuracy_text, reward_text
    from meal_bayes.look import AMOUNT, ERROR_TEXT

    console = terminal.output()
    columns = {
        "agent": "{agent}",
        "accuracy": "{accuracy}", "cost, s": f"{{cost_s:{AMOUNT}}}", "reward": "{reward}",
        "NLL": "{nll:.3f}", "ECE": "{ece:.3f}", "abstained": "{abstained:.1%}",
    }  # fmt: skip
    cells = (
        asdict(row) | {"accuracy": accuracy_text(row), "reward": reward_text(row)} for row in rows
    )
    terminal.print_table(columns, cells, narrow=True)
    text = (
        f"{rows[0].trials} trials for each agent; [{MASS_TEXT} interval]; {ERROR_TEXT}; objects "
        "are clusters; NLL and ECE of the final belief"
    )
    console.print(Text(text, "dim"))
    if paired:
        console.print()
        differences = (
            (
                str(pair["agent"]),
                terminal.signed(pair["estimate"]),
                f"{terminal.signed(pair['low'])} to {terminal.signed(pair['high'])}",
            )
            for pair in paired
        )
        heads = (f"{_MEASURE} against {_AGAINST}", "difference", f"{MASS_TEXT} interval")
        terminal.print_table(heads, differences)


@run.command(short_help="Agents learn while they work, and are tested in between.")
@opt.shared("dataset", "root")
@opt.option(
    "--attributes", click.IntRange(1, opt.NAME_LIMIT), 1, "N", "Number of attributes in a question."
)
@opt.option(
    "--agent agents",
    None,
    None,
    "NAME",
    f"{opt.ONLINE_AGENTS}; any agent of `run offline`; or {opt.OWN}; may be repeated, or a comma "
    "list. The others are compared with the first. iterative_morc, morc_itrs, bayes and "
    "bayes_memory by default.",
    multiple=True,
)
@opt.option("--batches", opt.COUNT, 10, "B", "Number of batches; the agent refits after each.")
@opt.option("--trials", opt.COUNT, 40, "T", "Training trials in a batch.")
@opt.option(
    "--repeats",
    opt.COUNT,
    None,
    "R",
    "Number of runs, each with another split of the objects; 1 by default.",
)
@click.option(
    "--until-decided",
    is_flag=True,
    help=f"Run {_FIRST_LOOK}, {2 * _FIRST_LOOK}, {4 * _FIRST_LOOK}, ... repeats until every "
    f"agent's interval excludes 0, at most --repeats, {_MOST_REPEATS} by default.",
)
@opt.option(
    "--split",
    opt.COUNT,
    (33, 33, 34),
    "A B C",
    "Shares of the objects: known before, met in training, and used in tests.",
    nargs=3,
)
@opt.option(
    "--alpha", opt.AMOUNT, None, "A", "Weight of entropy in Eq. 11, s per bit; 6 by default."
)
@opt.option("--beta", opt.AMOUNT, None, "B", "Weight of experience in Eq. 11, s; 30 by default.")
@opt.option(
    "--normalizer",
    click.Choice(["paper", "all"]),
    "paper",
    None,
    "Experience that Eq. 10 counts: training only (paper), or pretraining too (all).",
)
@opt.shared("seed", "key", "jobs", "cluster")
@opt.option(
    "--log",
    click.Choice(["compact", "full"]),
    "compact",
    None,
    "Form of the logs of tests. Compact logs keep the steps of eleven tests of each batch.",
)
@opt.shared("logs", "fresh", "json")
def online(
    root: Path | None,
    agents: tuple[str, ...],
    until_decided: bool,
    cluster: str | None,
    as_json: bool,
    **settings: Any,
) -> None:
    """Train agents on their own trials by feedback, and test them after every batch.

    The command downloads the recordings once, or reads them from MEAL_BAYES_DATA_URL. If a run was
    interrupted, the same command continues it.
    """
    from meal_bayes.evaluation.learning import decided, learning_rows, summarize_learning
    from meal_bayes.experiments import OnlineConfig, run_online
    from meal_bayes.experiments.online import plan_online
    from meal_bayes.experiments.parallel import on_cluster

    # Options of how to run are no settings of what is run: they do not name the folder.
    how = {name: settings.pop(name) for name in _HOW}
    settings["root"] = None if root is None else str(root)
    settings["repeats"] = settings["repeats"] or (_MOST_REPEATS if until_decided else 1)
    if agents:
        settings["agents"] = tuple(map(opt.agent_value, opt.comma_list(*agents)))
    config = OnlineConfig(**settings)
    _compile(plan_online(config, logs=how["logs"]))
    with on_cluster(cluster), terminal.resumed("batches") as advance:
        how |= {"on_progress": advance, "on_note": terminal.note}
        repeats = min(_FIRST_LOOK, config.repeats) if until_decided else config.repeats
        # Repeats double until the intervals decide; those that are there are not run again.
        while True:
            finished = run_online(replace(config, repeats=repeats), **how)
            results = list(finished.results())
            if repeats == config.repeats or decided(results, _FIRST_LOOK):
                break
            repeats = min(2 * repeats, config.repeats)
    rows = learning_rows(results)
    summary = summarize_learning(results)
    if as_json:
        facts = {"rows": [row.as_dict() for row in rows]}
        facts["summary"] = [row.as_dict() for row in summary]
        terminal.print_json({"config": finished.config.as_dict(), **facts})
    else:
        _print_learning(rows, summary)
        if len(summary) > 1:
            _print_differences(summary, repeats)
    terminal.note(f"trials in {finished.folder}")
    report = command_line("meal-bayes report", finished.folder, "-o", "report.html")
    terminal.note(f"learning curves: {report}")


def _print_learning(rows: "list[LearningRow]", summary: "list[LearningSummary]") -> None:
    from meal_bayes.evaluation.learning import POOLED
    from meal_bayes.look import AMOUNT

    last = max(row.batch for row in rows)
    cells = []
    for agent_row in summary:
        end = [row for row in rows if (row.agent, row.batch) == (agent_row.agent, last)]
        means = {
            name: fmean(getattr(row, name) for row in end)
            for name in ("hours", "certainty", "test_cost_s")
        }
        cells.append(asdict(agent_row) | means)
    columns = {
        "agent": "{agent}", "explored, h": "{hours:.1f}", "accuracy": "{accuracy_after:.3f}",
        "certainty": "{certainty:.3f}", "test cost, s": f"{{test_cost_s:{AMOUNT}}}",
        "reward": f"{{reward_after:{AMOUNT}}}", "ECE": "{ece_after:.3f}",
    }  # fmt: skip
    terminal.print_table(columns, cells, narrow=True)
    repeats = len({row.repeat for row in rows})
    text = f"repeats: {repeats}; after the last batch, ECE of the last {POOLED}\n"
    terminal.output().print(Text(text, "dim"), end="")


def _print_differences(summary: "list[LearningSummary]", repeats: int) -> None:
    """Print how much more reward agents have than the first, over its hours and at some.

    Nothing is said of hours that an agent has not explored.
    """
    from meal_bayes.evaluation.statistics import MASS_TEXT
    from meal_bayes.look import AMOUNT

    first = summary[0]
    compared = summary[1:]
    reached = [
        hours
        for hours in first.reward_difference_at
        if not all(math.isnan(row.reward_difference_at[hours]) for row in compared)
    ]
    rows = []
    for row in compared:
        area = row.area_reward_difference
        few = repeats < _LEAST_SPLITS or math.isnan(row.area_high)
        half = "" if few else f" ±{row.area_high - area:{AMOUNT}}"
        differences = (terminal.signed(row.reward_difference_at[hours]) for hours in reached)
        after = terminal.signed(row.reward_after_difference)
        rows.append((row.agent, f"{area:+{AMOUNT}}{half}", *differences, after))
    at_hours = (f"at {hours} h" for hours in reached)
    names = (
        f"reward less {first.agent}'s",
        f"first {first.area_hours:.1f} h",
        *at_hours,
        "after",
    )
    console = terminal.output()
    console.print()
    terminal.print_table(names, rows, narrow=True)
    text = f"±: half of the {MASS_TEXT} interval over splits"
    if repeats < _LEAST_SPLITS:
        text = f"too few splits for an interval; give --repeats {_LEAST_SPLITS} or more"
    console.print(Text(text, "dim"))

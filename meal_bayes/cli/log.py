"""`log`: contents, check and recovery of trial logs; `report` and `compare`: what runs show."""

from collections.abc import Mapping
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from meal_bayes.cli.console import (
    note,
    output,
    print_facts,
    print_json,
    print_table,
    progress,
    say,
)
from meal_bayes.cli.options import FILE, LARGEST_COUNT, option, shared
from meal_bayes.cli.program import UNREAD, UNSOUND, Section
from meal_bayes.files import check_output, command_line

if TYPE_CHECKING:
    from meal_bayes.trial_log import LogInfo, Logs
    from meal_bayes.trial_log.folder import Group

_file = click.argument("file", type=click.Path(path_type=Path))
_logs = click.argument("logs", nargs=-1, required=True, type=click.Path(path_type=Path))


@click.group(cls=Section)
def log() -> None:
    """Show, check and recover trial logs."""


@log.command(short_help="Show the content of logs, and the settings of the run.")
@_file
@shared("json")
def info(file: Path, as_json: bool) -> None:
    """Show the content of a log, or of all logs in a folder, and the configuration of the run."""
    from meal_bayes.trial_log import FORMAT_VERSION, Feedback, log_files, log_info, read_feedback
    from meal_bayes.trial_log.file import FEEDBACK_FORM

    infos = list(map(log_info, log_files(file)))
    if as_json:
        _print_json(infos, file)
        return
    size = sum(info.path.stat().st_size for info in infos)
    trials = sum(info.trials for info in infos)
    steps = sum(info.steps for info in infos)
    forms = ", ".join(dict.fromkeys(info.form for info in infos))
    files = f" ({len(infos)} files)" if file.is_dir() else ""
    holds = f"{trials} trials, {steps} steps"
    if forms == FEEDBACK_FORM:
        (entry,) = read_feedback(file)
        holds = f"a change of the learner: {entry.text}"
        if isinstance(entry, Feedback):
            holds = f"what was told of {entry.object_name}: {entry.text}"
    facts = {
        "file": f"{file}{files}, {size:,} bytes, format {FORMAT_VERSION}, {forms}",
        "holds": holds,
    }
    print_facts(output(), facts | _header_facts(infos[0].header))


@log.command(short_help="Show one trial step by step; of a compact log its outcome.")
@_file
@option(
    "--trial number",
    click.IntRange(0, LARGEST_COUNT),
    None,
    "N",
    "Number of the trial, counted from 0; the first by default.",
)
@option(
    "--picture",
    FILE,
    None,
    "FILE.svg",
    "Draw the trial into a file; its ending chooses SVG, PNG or PDF.",
)
@click.option("--dark", is_flag=True, help="Draw for a dark page.")
@click.option("--narrow", is_flag=True, help="Draw for a narrow column, as on a phone.")
def show(file: Path, number: int | None, picture: Path | None, dark: bool, narrow: bool) -> None:
    """Show one trial of a log, or of a run's folder, step by step.

    A compact log has only the outcomes of most trials. The picture that --picture draws shows the
    behaviors, the beliefs, and the expected gain of going on, over the time of the trial.
    """
    from meal_bayes.cli.narration import print_trial
    from meal_bayes.trial_log.folder import going_on_text, of_learner
    from meal_bayes.trials.text import UNFINISHED, outcome_facts

    if picture is None and (dark or narrow):
        raise click.UsageError("--dark and --narrow only change a picture; add --picture FILE.svg.")
    group, row = numbered(file, number or 0)
    if picture is not None:
        _draw(file, group, row, picture, dark=dark, narrow=narrow)
        return
    console = output()
    facts = outcome_facts(group.outcomes, row)
    if not group.trials:
        print_facts(console, facts)
        return
    # The rest is told with the steps.
    print_facts(console, {name: facts[name] for name in ("question", "object", "agent")})
    console.print()
    print_trial(console, group.trials[row])
    if group.trials[row].ended == UNFINISHED and of_learner(group.header):
        note(going_on_text(group.file))


def _draw(file: Path, group: "Group", row: int, path: Path, *, dark: bool, narrow: bool) -> None:
    """Write the picture of a trial."""
    from meal_bayes.errors import SettingsError
    from meal_bayes.look import check_figure_name, save

    if not group.trials:
        raise SettingsError(f"{file} contains only outcomes; a picture needs a log with steps.")
    check_figure_name(path)
    check_output(path, inputs=[group.file])
    save(group.trials[row].plot(dark=dark, narrow=narrow), path)
    say(f"{path}: {path.stat().st_size:,} bytes")


def numbered(file: Path, number: int) -> "tuple[Group, int]":
    """Return the group that holds a trial, counted from 0 in all logs, and its row there."""
    from meal_bayes.errors import SettingsError
    from meal_bayes.trial_log import Logs

    before = 0
    for group in Logs(file).begun():
        if number < before + len(group.outcomes):
            return group, number - before
        before += len(group.outcomes)
    raise SettingsError(
        f"{file} contains {before} complete trials; give --trial 0 to {before - 1}."
    )


@log.command(short_help="Read logs to their end and list their problems.")
@_file
@shared("json")
def check(file: Path, as_json: bool) -> None:
    """Read a log, or all logs in a folder, to the end; list problems, and exit with 1 if any.

    Logs of labels, in a folder "feedback", are read too.
    """
    from meal_bayes.trial_log import check_log, log_files
    from meal_bayes.trial_log.file import FEEDBACK_FORM

    reports = list(map(check_log, log_files(file, feedback=True)))
    if as_json:
        _print_json(reports, file)
    else:
        for report in reports:
            state = "complete and undamaged" if report.whole else "incomplete or damaged"
            state = state if report.ours else "no log of meal_bayes"
            held = f"{report.trials} trials, {report.steps} steps can be read"
            if report.whole and report.form == FEEDBACK_FORM:
                held = "labels, or a change of the learner"
            facts = {"file": str(report.path), "state": state, "holds": held}
            if not report.whole:
                facts["problems"] = "\n".join(report.problems)
                if report.trials:
                    facts["repair"] = command_line("meal-bayes log recover", report.path)
            print_facts(output(), facts)
    if not all(report.whole for report in reports):
        click.get_current_context().exit(UNSOUND)


@log.command(short_help="Save the readable trials of a damaged log.")
@_file
@option("--out", FILE, None, "FILE", "The new file.")
@shared("json")
def recover(file: Path, out: Path | None, as_json: bool) -> None:
    """Save the readable trials of a damaged log into a new file, and keep the damaged one.

    An unfinished last trial is saved as far as it went. The command says which bytes it could not
    read, and exits with 3 if they may have held whole trials.
    """
    from meal_bayes.trial_log import check_log, log_info, recover_log

    saved = log_info(recover_log(file, out))
    torn = check_log(file)
    for problem in torn.problems:
        note(f"{torn.path}: {problem}")
    if as_json:
        print_json({"path": str(saved.path), "trials": saved.trials, "unread_bytes": torn.unread})
    else:
        say(f"{saved.path}: {saved.trials} trials saved")
    if torn.unread:
        note(f"{torn.unread:,} bytes of {torn.path} hold no whole record and were not read")
        click.get_current_context().exit(UNREAD)


def _print_json(logs: "list[LogInfo]", path: Path) -> None:
    """Print the facts of one log, or of a folder's logs."""
    facts = [asdict(log) | {"path": str(log.path), "whole": log.whole} for log in logs]
    print_json({"files": facts} if path.is_dir() else facts[0])


def _header_facts(header: Mapping[str, Any]) -> dict[str, str]:
    """Return what a log's header says as text: a line for each question, and each fact once."""
    config = dict(header.get("config") or {})
    questions = config.pop("questions", None)
    facts = {}
    for name, value in header.items():
        if name != "config":
            facts[name] = _as_text(value)
        else:
            once = {key: entry for key, entry in config.items() if header.get(key) != entry}
            facts[name] = _as_text(once)
            if isinstance(questions, list) and questions:
                facts["questions"] = "\n".join(map(_as_text, questions))
    return facts


def _as_text(value: object) -> str:
    if isinstance(value, dict):
        named = ((name, _as_text(entry)) for name, entry in value.items())
        return ", ".join(f"{name} {entry or 'none'}" for name, entry in named)
    if isinstance(value, list):
        return " ".join(map(_as_text, value))
    return "-" if value is None else str(value)


@click.command(short_help="Write an HTML page: tables, figures, worst trials.")
@_logs
@option(
    "-o --out",
    FILE,
    Path("report.html"),
    "FILE.html",
    "File of the page, which contains everything that it needs.",
)
@option(
    "--reference",
    None,
    None,
    "AGENT",
    "Agent with which the others are compared; by default the paper's, or else the first.",
)
def report(logs: tuple[Path, ...], out: Path, reference: str | None) -> None:
    """Write an HTML page about the trials in LOGS, which are files or the folders of runs."""
    from meal_bayes.evaluation.report import write_report
    from meal_bayes.trial_log import Logs

    files = Logs(*logs)
    with progress("reading", "files") as advance:
        outcomes = write_report(files, out, reference=reference, on_progress=advance)
    _note_faults(files, "the report counts")
    trials = len(outcomes)
    agents = len(outcomes.agents)
    counted = f"{_counted(trials, 'trial')} of {_counted(agents, 'agent')}"
    say(f"{out}: {counted}, {out.stat().st_size:,} bytes")


def _note_faults(files: "Logs", counting: str) -> None:
    """Say which logs are damaged or copies, after they were read."""
    for problem in files.problems:
        note(f"warning: {problem}; {counting} what can be read")
    if files.copies:
        note(f"warning: {files.copies}")


def _counted(number: int, noun: str) -> str:
    """Return a number of things, such as "1 trial" or "2 trials"."""
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


@click.command(short_help="Print paired differences between agents, with intervals.")
@_logs
@option(
    "--measure",
    click.Choice(["success", "cost", "reward"]),
    "reward",
    None,
    "Quantity to compare.",
)
@option(
    "--reference",
    None,
    None,
    "AGENT",
    "Agent with which the others are compared; by default the paper's, or else the first.",
)
@shared("json")
def compare(logs: tuple[Path, ...], measure: str, reference: str | None, as_json: bool) -> None:
    """Compare the agents in LOGS, files or runs' folders, on the tasks that they share.

    Differences are paired by task, with 95 % intervals in which objects are the clusters. Costs are
    in seconds, and success is a fraction of trials.
    """
    from meal_bayes.evaluation import comparisons
    from meal_bayes.evaluation.logged import LoggedOutcomes
    from meal_bayes.evaluation.statistics import MASS_TEXT
    from meal_bayes.trial_log import Logs

    files = Logs(*logs)
    logged = LoggedOutcomes.read(files)
    _note_faults(files, "the comparison counts")
    rows = comparisons(logged.measured().outcomes, measure=measure, reference=reference)
    if logged.heading:
        note(logged.heading)
    if as_json:
        print_json({"comparisons": [row.as_dict() for row in rows]})
        return
    form = ".3f" if measure == "success" else ".1f"
    unit = {"success": "a fraction of trials", "cost": "s", "reward": "a trial"}[measure]
    say(f"difference in {measure} ({unit}) to {rows[0].reference}, on the same tasks")
    columns = ["agent", "tasks", "difference", f"{MASS_TEXT} interval", "verdict"]
    cells = []
    for row in rows:
        known = row.tasks and not isnan(row.low)  # of one object there is no interval
        interval = f"{row.low:+{form}} to {row.high:+{form}}" if known else "-"
        estimate = f"{row.difference:+{form}}" if row.tasks else "-"
        cells.append([row.agent, f"{row.tasks:,}", estimate, interval, row.verdict])
    print_table(columns, cells, left_aligned=("verdict",), narrow=True)

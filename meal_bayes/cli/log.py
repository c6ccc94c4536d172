"""`meal-bayes log`: what a trial log holds, whether it is sound, and what a torn one still has."""

import dataclasses
import json
from pathlib import Path

import click

from meal_bayes.cli.options import json_option
from meal_bayes.cli.program import Section
from meal_bayes.cli.screen import output, say
from meal_bayes.cli.story import print_facts, tell_trial
from meal_bayes.cli.values import MOST_TRIALS, Whole

_UNSOUND = 1  # exit code of `check` where something is wrong

_file = click.argument("file", type=click.Path(path_type=Path))


@click.group(cls=Section)
def log() -> None:
    """Look into trial logs: info, show, check, recover."""


@log.command()
@_file
@json_option
def info(file: Path, as_json: bool) -> None:
    """Tell what a whole log holds, and what the run was."""
    from meal_bayes.trial_log import log_info

    found = log_info(file)
    if as_json:
        facts = {**dataclasses.asdict(found), "path": str(found.path)}
        click.echo(json.dumps(facts, allow_nan=False))
        return
    facts = {
        "file": f"{found.path}, {found.size:,} bytes, format {found.format_version}, {found.form}",
        "holds": f"{found.trials} trials, {found.steps} steps, {found.momdps} MOMDPs",
    }
    for name, value in found.header.items():
        facts[name] = _in_words(value)
    print_facts(output(), facts)


@log.command()
@_file
@click.option(
    "--trial", "number", type=Whole(0, MOST_TRIALS), default=0, show_default=True,
    help="Which trial, counted from 0.",
)  # fmt: skip
def show(file: Path, number: int) -> None:
    """Tell one trial of a log step by step."""
    from meal_bayes.errors import SettingsError
    from meal_bayes.trial_log import read_trials

    found = 0
    for trial in read_trials(file):
        if found == number:
            console = output()
            facts = {
                "question": f"{', '.join(trial.task.query.attributes)}?",
                "object": trial.task.object_name,
                "agent": trial.agent,
            }
            print_facts(console, facts)
            console.print()
            tell_trial(console, trial)
            return
        found += 1
    raise SettingsError(f"{file} holds {found} trials; give --trial 0 to {found - 1}.")


@log.command(short_help="Read a log to its end and tell what is wrong.")
@_file
@json_option
def check(file: Path, as_json: bool) -> None:
    """Read a log to its end and tell what is wrong, if anything; then the exit code is 1."""
    from meal_bayes.trial_log import check_log

    report = check_log(file)
    if as_json:
        facts = {**dataclasses.asdict(report), "path": str(report.path)}
        click.echo(json.dumps(facts, allow_nan=False))
    else:
        console = output()
        state = "whole, nothing is missing or changed" if report.whole else "not sound"
        held = f"{report.trials} trials, {report.steps} steps can be read"
        facts = {"file": str(report.path), "state": state, "holds": held}
        if not report.whole:
            facts["problems"] = "\n".join(report.problems)
            facts["mend"] = f"meal-bayes log recover {report.path}"
        print_facts(console, facts)
    if not report.whole:
        click.get_current_context().exit(_UNSOUND)


@log.command(short_help="Save the whole trials of a torn log into a new one.")
@_file
@click.option("--out", type=click.Path(path_type=Path), help="The new file.")
@json_option
def recover(file: Path, out: Path | None, as_json: bool) -> None:
    """Save the whole trials of a torn log into a new one; the torn one stays as it is."""
    from meal_bayes.trial_log import log_info, recover_log

    saved = log_info(recover_log(file, out))
    if as_json:
        click.echo(json.dumps({"path": str(saved.path), "trials": saved.trials}))
        return
    say(f"{saved.path}: {saved.trials} whole trials saved")


def _in_words(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_in_words(entry)}" for name, entry in value.items())
    if isinstance(value, list):
        return " ".join(map(_in_words, value))
    return "-" if value is None else str(value)

"""Defaults and options that several places name are the same: of functions, classes, commands."""

import inspect
import re
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import click
import pytest

from meal_bayes import gym
from meal_bayes.agents import AGENTS, ITRSBonus
from meal_bayes.cli import main, options, program
from meal_bayes.evaluation import compare_outcomes
from meal_bayes.evaluation.outcome_model import MARGINS
from meal_bayes.experiments import (
    DEFAULT_AGENTS,
    OfflineConfig,
    OnlineConfig,
    config,
    offline_tasks,
    run_offline,
    run_online,
)
from meal_bayes.learner import Learner, LearnerSettings, ask, settings
from meal_bayes.learner.search_input import SearchOptions
from meal_bayes.learner.trial import TrialOptions
from meal_bayes.perception import settings as perception
from meal_bayes.planners.rollout import simulate
from meal_bayes.planners.solver import MAX_STEPS
from meal_bayes.posterior import fit
from meal_bayes.posterior.draws import Sampling
from meal_bayes.simulated_arm import training_recordings
from meal_bayes.trials import SearchRules, Session

ROOT = Path(__file__).resolve().parents[1]
EVERYWHERE = [  # a parameter of one name has one default in all of them
    ask, Learner, Learner.load, Learner.ask, Learner.begin, Learner.begin_find, LearnerSettings,
    Session, SearchRules, TrialOptions, OfflineConfig, run_offline, run_online, offline_tasks,
    simulate, compare_outcomes,
]  # fmt: skip
OF_ITS_OWN = {  # names that mean something else there
    (Session, "agent"), (compare_outcomes, "draws"), (compare_outcomes, "measure"),
}  # fmt: skip
COMMANDS = {  # whose options are named as what they fill
    "run offline": OfflineConfig,
    "run online": OnlineConfig,
    "posterior": Sampling,
    "ask": ask,
    "find": Learner.begin_find,
}


def defaults(callee: Callable[..., Any]) -> Iterator[tuple[str, Any]]:
    """Yield the parameters of a function or class that have a default other than None."""
    for name, parameter in inspect.signature(callee).parameters.items():
        if parameter.default not in (None, inspect.Parameter.empty):
            yield name, parameter.default


def command_of(words: str) -> click.Command:
    command: click.Command = main
    for word in words.split():
        assert isinstance(command, click.Group)
        command = command.commands[word]
    return command


def place_of(callee: Callable[..., Any]) -> str:
    return f"{callee.__module__}.{callee.__qualname__}"


def check_alike(callees: list[Callable[..., Any]]) -> None:
    """Fail where two of them have other defaults for a parameter of one name."""
    found = defaultdict[str, dict[str, list[str]]](dict)
    for callee in callees:
        for name, value in defaults(callee):
            if (callee, name) not in OF_ITS_OWN:
                found[name].setdefault(repr(value), []).append(place_of(callee))
    assert sum(len(places) > 1 for by_value in found.values() for places in by_value.values()) > 0
    for name, by_value in found.items():
        assert len(by_value) == 1, f"change the default of {name} in all of: {by_value}"


def test_functions_and_classes_have_one_default_each() -> None:
    check_alike(EVERYWHERE)


def test_a_gym_environment_asks_as_an_offline_run_does() -> None:
    check_alike([gym.MealEnv, OfflineConfig, Session, run_offline, Learner])
    page = (ROOT / "docs" / "how-to" / "gym.md").read_text(encoding="utf-8")
    assert {4: "three to one"}[gym._HELD_OUT] in page
    assert {4: "(a quarter,"}[gym._HELD_OUT] in str(gym.MealEnv.__doc__)


def test_training_objects_of_the_arm_are_as_many_by_command_and_function() -> None:
    check_options("sim ask", training_recordings, leaving={"jobs"})
    check_options("sim find", training_recordings, leaving={"jobs"})


@pytest.mark.parametrize(("words", "callee"), COMMANDS.items(), ids=COMMANDS)
def test_an_option_has_the_default_of_what_it_fills(words: str, callee: Callable[..., Any]) -> None:
    check_options(words, callee)


def check_options(
    words: str, callee: Callable[..., Any], leaving: set[str] | frozenset[str] = frozenset()
) -> None:
    """Fail where an option has another default than the parameter of its name."""
    given = {
        option.name: option.default
        for option in command_of(words).params
        if isinstance(option, click.Option)
        and isinstance(option.default, int | float | str | tuple | Path)
    }
    shared = [(name, value) for name, value in defaults(callee) if name in given.keys() - leaving]
    assert shared
    for name, value in shared:
        where = f"`meal-bayes {words} --{name}` (meal_bayes/cli) and {place_of(callee)}"
        assert str(given[name]) == str(value), f"change both: {where}"


CHOICES = {  # what an option offers, and what takes it
    ("run offline", "percepts"): settings._PERCEPTS,
    ("run offline", "perception"): tuple(perception.NAMED),
    ("run online", "normalizer"): config._CHOICES["normalizer"],
    ("run online", "log"): config._CHOICES["log"],
    ("posterior", "method"): fit.METHODS,
    ("posterior", "model"): fit.MODELS,
    ("compare", "measure"): tuple(MARGINS),
}


@pytest.mark.parametrize(("option", "choices"), CHOICES.items(), ids=lambda value: value[-1])
def test_an_option_offers_what_can_be_chosen(
    option: tuple[str, str], choices: tuple[str, ...]
) -> None:
    words, name = option
    (chosen,) = (entry for entry in command_of(words).params if entry.name == name)
    assert isinstance(chosen.type, click.Choice)
    where = f"`meal-bayes {words} --{name}` (meal_bayes/cli) and what takes it"
    assert tuple(chosen.type.choices) == choices, f"change both: {where}"


def told(words: str, name: str) -> str:
    """Return the help of an option."""
    (option,) = (option for option in command_of(words).params if option.name == name)
    assert isinstance(option, click.Option)
    return str(option.help)


@pytest.mark.parametrize("weight", ["alpha", "beta"])
def test_the_help_has_the_weights_of_equation_11(weight: str) -> None:
    assert f"{getattr(ITRSBonus(), weight):g} by default" in told("run online", weight)


def test_the_help_has_the_margins() -> None:
    text = "{success} of accuracy, {cost:g} s of cost, {reward:g} of reward by default"
    assert text.format(**MARGINS).removeprefix("0") in told("compare", "margin")


def test_the_help_names_the_agents() -> None:
    offline = re.split(", | or ", options.AGENTS)
    online = re.split(", | or ", options.ONLINE_AGENTS)
    assert {*offline, *online} == {*AGENTS}
    assert set(offline) - set(DEFAULT_AGENTS) == {"olfc"}
    assert "All but olfc by default" in told("run offline", "agents")
    first = [agent.name for agent in OnlineConfig("cy101").agents]
    assert f"{', '.join(first[:-1])} and {first[-1]} by default" in told("run online", "agents")


def test_the_page_has_a_row_of_each_exit_code() -> None:
    page = (ROOT / "docs" / "how-to" / "command-line.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+) \|", page.partition("## Exit codes")[2], re.MULTILINE)
    names = ("FAILED", "SYSTEM", "UNSOUND", "ROBOT_FAULT", "UNREAD", "INTERRUPTED")
    assert {*map(int, rows)} == {0, *(getattr(program, name) for name in names)}
    assert f"the exit code is {program.UNREAD}" in str(command_of("log recover").help)
    assert f"exit with {program.UNSOUND}" in str(command_of("log check").help)
    assert f"the exit code is {program.UNSOUND}" in str(command_of("data verify").help)


def test_a_trial_ends_after_as_many_steps_wherever_it_is_run() -> None:
    steps = {place_of(callee): dict(defaults(callee)).get("max_steps") for callee in EVERYWHERE}
    assert {*filter(None, steps.values())} == {MAX_STEPS}, steps


def test_find_takes_the_options_of_begin_find() -> None:
    given = inspect.signature(Learner.begin_find).parameters.values()
    options_of = {entry.name for entry in given if entry.kind is inspect.Parameter.KEYWORD_ONLY}
    assert {*SearchOptions.__annotations__} == options_of, "change SearchOptions and begin_find"


def test_a_log_says_of_a_trial_what_whoever_resumes_it_needs() -> None:
    named = {entry.name for entry in fields(TrialOptions)}
    unsaid = {"truth", "limit", "on_step", "abstain"}  # in the trial, or of what runs it now
    written = {*TrialOptions().begun("table")} - {"state"}
    assert written == named - unsaid, "add an option to TrialOptions.begun, or say why not here"

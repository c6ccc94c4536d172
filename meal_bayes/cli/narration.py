"""A trial as text: beliefs as bars, the decision and its reasons, the outcome; and as JSON."""

import math
from typing import TYPE_CHECKING, Any

from rich.console import Console
from rich.text import Text

from meal_bayes.cli.console import note, print_facts, print_rows
from meal_bayes.files import command_line
from meal_bayes.look import AMOUNT, percent
from meal_bayes.planners import RULE
from meal_bayes.trials.text import (
    belief_before,
    believed,
    compared_actions,
    final_facts,
    gap_text,
    outcome_text,
    percept_labels,
    together_text,
)

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray

    from meal_bayes.domain import Query
    from meal_bayes.momdp import Belief
    from meal_bayes.trials import Trial

_BAR = 30  # characters
_OPTIONS = 4  # actions that are compared
VERDICT_STYLES = {True: "bold green", False: "bold red", None: ""}  # by success


def print_trial(console: Console, trial: "Trial") -> None:
    """Print a finished trial, each step with its decision, outcome and belief."""
    momdp = trial.momdp
    query = trial.task.query
    spent = 0.0
    headed = ""  # the heads that stand above the values of an earlier step
    console.print(Text("before any behavior", "bold"))
    _print_belief(console, trial, trial.first_belief)
    if together := together_text(momdp):
        print_facts(console, {"together": together})
    for number, step in enumerate(trial.steps, start=1):
        action = step.decision.action
        spent = spent + step.cost
        console.print()
        console.print(Text(f"{number}  {trial.momdp.action_label(action)}", "bold"))
        headed = _print_values(console, trial, number, headed)
        facts = {"warning": step.warning} if step.warning else {}
        if action >= momdp.n_behaviors:
            print_facts(console, facts)
            continue
        outcome = {"outcome": outcome_text(momdp, step)}
        if step.observation is not None:
            percepts = percept_labels(momdp, action, step.observation)
            pairs = zip(query.questions, percepts, strict=True)
            outcome["percept"] = ", ".join(f"{name}: {word}" for (name, _), word in pairs)
        print_facts(console, outcome | facts, warning="yellow")
        _print_belief(console, trial, step.belief)
        print_facts(console, {"cost": f"{step.cost:g} s, in all {spent:{AMOUNT}} s"})
    console.print()
    _print_end(console, trial)


def _print_values(console: Console, trial: "Trial", number: int, headed: str) -> str:
    """Print the possible actions and their expected rewards, the chosen one marked, if any.

    Heads of columns stand where they first appear; returned are those that stand by now.
    """
    momdp = trial.momdp
    step = trial.steps[number - 1]
    decision = step.decision
    possible = momdp.legal[step.x].nonzero()[0]
    if len(possible) == 1:
        only = momdp.behavior_names[possible[0]]
        state = momdp.state_label(step.x)
        print_facts(console, {"possible": f"{state}: only {only}, or an answer"})
    compared = compared_actions(momdp, decision, belief_before(trial, number), _OPTIONS)
    if not compared:
        print_facts(console, {"why": RULE})
        return headed
    width = max(len(action.name) for action in compared)
    rows = []
    titles = [*decision.value_heads, "simulations"]
    heads = "   ".join(titles if decision.simulations > 0 else titles[:-1])
    if not headed.startswith(heads):
        rows.append(Text(f"{'':<{width + 4}}{heads}", "dim"))
        headed = heads
    for action in sorted(compared, key=lambda action: action.is_answer):  # the answer last
        sign = "►" if action.chosen else ""
        line = f"{sign:<2}{action.name:<{width}}  {action.value:8{AMOUNT}} {action.error:<7}"
        if action.bonus is not None:
            line += f"  {action.bonus:12{AMOUNT}}"
        if action.visits is not None:
            line += f"  {action.visits:12d}"
        rows.append(Text(line.rstrip(), "bold" if action.chosen else ""))
    if gap := gap_text(decision):
        rows.append(Text(f"  {gap}", "dim"))
    print_rows(console, "why", rows, cut=True)
    return headed


def _print_belief(console: Console, trial: "Trial", belief: "Belief") -> None:
    named = believed(trial, belief)
    width = max(len(name) for name, _ in named)
    rows = []
    for name, p in named:
        full = round(p * _BAR)
        line = Text(f"{name:<{width}}  ")
        line.append("".ljust(full, "█"), "green" if p > 0.5 else "yellow")  # green is reported
        line.append("".ljust(_BAR - full, "░"), "dim")
        rows.append(line.append(f" {percent(p):>7}"))
    print_rows(console, "belief", rows, cut=True)


def print_answer(console: Console, trial: "Trial") -> None:
    """Print what a finished trial did and believed in the end, and its answer."""
    _, facts = trial._facts()
    task_facts = {"question": trial.task.question, "object": trial.task.object_name}
    names = ("together", "steps", "belief", "warnings")
    trial_facts = {name: facts[name] for name in names if name in facts}
    print_facts(console, task_facts | trial_facts, warnings="yellow")
    _print_end(console, trial)


def note_reasons(log: "Path") -> None:
    """Say how a trial is shown again from its log, or the first of a folder."""
    first = ("--trial", "0") if log.is_dir() else ()
    command = command_line("meal-bayes log show", log, *first)
    note(f"every decision and its reasons: {command}")


def _print_end(console: Console, trial: "Trial") -> None:
    """Print the report, whether it is right, and the cost of a trial."""
    style = VERDICT_STYLES[trial.success]
    print_facts(console, final_facts(trial), answer="bold", verdict=style)


def trial_json(trial: "Trial") -> dict[str, object]:
    """Return a trial as JSON values."""
    query = trial.task.query
    truth = [None if value < 0 else value == 1 for value in trial.truth.tolist()]
    return {
        "object": trial.task.object_name,
        "attributes": list(query.attributes),
        "question": query.text,
        "probability": trial.probability,
        "agent": trial.agent,
        "report": _by_question(query, trial.report),
        "truth": query.by_question(truth),
        "success": trial.success,
        "ended": trial.ended,
        "cost_s": trial.cost,
        "reward": None if math.isnan(trial.reward) else trial.reward,
        "belief": _by_question(query, trial.last_belief.positive),
        "steps": [
            {
                "x": trial.momdp.x_names[step.x],
                "action": trial.momdp.action_name(step.decision.action),
                "next_x": trial.momdp.x_names[step.next_x],
                "percept": _percept(query, step.observation),
                "warning": step.warning,
                "cost_s": step.cost,
                "belief": _by_question(query, step.belief.positive),
            }
            for step in trial.steps
        ],
    }


def _percept(query: "Query", levels: "NDArray[Any] | None") -> dict[str, object] | None:
    """Return percept levels by question; None where nothing came of an attribute."""
    if levels is None:
        return None
    return query.by_question([None if level < 0 else level for level in levels.tolist()])


def _by_question(query: "Query", values: "NDArray[Any] | None") -> dict[str, object] | None:
    """Return values by question; a report of yes or no by the event."""
    if values is not None and len(values) < len(query):
        return {query.text.removesuffix("?"): values.tolist()[0]}
    return None if values is None else query.by_question(values.tolist())

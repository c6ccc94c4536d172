"""A trial told step by step: beliefs as bars, the choice and why, what happened, what it cost."""

import math
import textwrap
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table
from rich.text import Text

from meal_bayes.cli.screen import Signs, signs_of

if TYPE_CHECKING:
    from collections.abc import Mapping

    import numpy as np
    from numpy.typing import NDArray

    from meal_bayes.agents import Step, Task, Trial
    from meal_bayes.momdp import MOMDP
    from meal_bayes.planners import Decision

_LABEL = 10  # characters
_BAR = 30  # characters
_NARROW = 20  # characters that a text always gets
_OPTIONS = 3  # behaviors that are compared
_ROUNDED = 0.0005  # probabilities nearer to 0 or 1 would print as certain
_SHOWN_ERROR = 0.05  # errors below it would print as 0.0
_SHORT_LEVELS = {2: ("no", "yes"), 4: ("no!", "no", "yes", "yes!")}
_SILENT = "~"  # a percept that says nothing, where there is little room
_UNBOUNDED = 10_000  # characters


class Story:
    """Tells one trial on a console as it happens."""

    def __init__(self, console: Console, task: "Task", momdp: "MOMDP") -> None:
        self._console, self._momdp = console, momdp
        self._names = task.query.attributes
        self._signs = signs_of(console)
        self._spent, self._steps = 0.0, 0
        self._explained = False  # has it been said what the numbers are?
        self._heading("before any behavior")
        self._belief(momdp.prior)

    def step(self, step: "Step") -> None:
        """Tell one step."""
        self._steps += 1
        self._spent += step.cost
        momdp, action = self._momdp, step.decision.action
        name = momdp.behavior_names[action] if action < momdp.n_behaviors else "report"
        self._console.print()
        self._heading(f"{self._steps}  {name}")
        self._why(step.decision, step.x)
        if action >= momdp.n_behaviors:
            return
        facts = {"outcome": happened(momdp, step, self._signs.arrow)}
        if step.observation is not None:
            facts["percept"] = percept(momdp, action, step.observation)
        if step.warning:
            facts["warning"] = step.warning
        print_facts(self._console, facts, {"warning": "yellow"})
        self._belief(step.belief.positive)
        print_facts(self._console, {"cost": f"{step.cost:g} s, in all {self._spent:.1f} s"})

    def end(self, trial: "Trial") -> None:
        """Tell the report, whether it is right, and what the trial cost."""
        self._console.print()
        print_facts(self._console, ending(trial), verdict_style(trial))

    def _why(self, decision: "Decision", x: int) -> None:
        possible = self._momdp.legal[x].nonzero()[0]
        if len(possible) == 1:
            only, here = self._momdp.behavior_names[possible[0]], self._momdp.x_names[x]
            print_facts(self._console, {"possible": f"in {here} only {only}, or a report"})
        options = best_options(decision)
        if not options:
            print_facts(self._console, {"why": "this agent follows a rule and compares nothing"})
            return
        names = {e: self._action(e) for e in options}
        width = max(map(len, names.values()))
        label = "why"
        if not self._explained:
            self._explained = True
            heads = "expected reward" + "   simulations" * (decision.simulations > 0)
            self._row(label, Text(f"{'':<{width + 4}}{heads}", "dim"))
            label = ""
        for option, name in names.items():
            chosen = option == min(decision.action, self._momdp.n_behaviors)
            sign = self._signs.chosen if chosen else " "
            line = f"{sign:<2}{name:<{width}}  {self._value(decision, option)}"
            self._row(label, Text(line.rstrip(), "bold" if chosen else ""))
            label = ""

    def _value(self, decision: "Decision", option: int) -> str:
        error = decision.value_se[option]
        spread = f"{self._signs.spread}{error:.1f}" if error >= _SHOWN_ERROR else ""
        value = f"{decision.values[option]:8.1f} {spread:<7}"
        simulated = option < self._momdp.n_behaviors and decision.simulations > 0
        return f"{value}  {decision.visits[option]:12d}" if simulated else value

    def _action(self, option: int) -> str:
        names = self._momdp.behavior_names
        return names[option] if option < len(names) else "report now"

    def _belief(self, positive: "NDArray[np.float64]") -> None:
        width = max(map(len, self._names))
        label = "belief"
        for name, p in zip(self._names, positive, strict=True):
            line = Text(f"{name:<{width}}  ").append_text(bar(p, self._signs))
            self._row(label, line.append(f" {_percent(p)}"))
            label = ""

    def _heading(self, text: str) -> None:
        self._console.print(Text(text, "bold"))

    def _row(self, label: str, text: Text) -> None:
        self._console.print(_label(label).append_text(text), no_wrap=True, overflow="ellipsis")


def tell_trial(console: Console, trial: "Trial") -> None:
    """Tell a finished trial from beginning to end."""
    story = Story(console, trial.task, trial.momdp)
    for step in trial.steps:
        story.step(step)
    story.end(trial)


def tell_briefly(console: Console, trial: "Trial") -> None:
    """Tell a finished trial in a line a step: percept and belief of each attribute, in percent.

    With more attributes than the console is wide for, tell it as `tell_trial` does.
    """
    from meal_bayes.trial_log.words import level_words, percept_words

    names, momdp = trial.task.query.attributes, trial.momdp
    table = Table(box=None, padding=(0, 1, 0, 0), header_style="dim")
    table.add_column("", justify="right")
    table.add_column("behavior")
    table.add_column("s", justify="right")
    words = _SHORT_LEVELS.get(momdp.levels) or level_words(momdp.levels)
    width = max(map(len, words))
    silent = False
    for name in names:
        table.add_column(f"{name} %")
    first = [_cell("", p, width) for p in trial.first_belief.positive]
    table.add_row("", Text("before any", "dim"), "", *first)
    for number, step in enumerate(trial.steps, start=1):
        action = step.decision.action
        if action >= momdp.n_behaviors:
            continue
        nothing = "-" if momdp.informative[action].max() > 0 else ""
        told = [nothing] * len(names)
        if step.observation is not None:
            told = percept_words(momdp, action, step.observation, words, _SILENT)
        silent |= _SILENT in told
        pairs = zip(told, step.belief.positive, strict=True)
        cells = [_cell(word, p, width) for word, p in pairs]
        table.add_row(str(number), momdp.behavior_names[action], f"{step.cost:.1f}", *cells)
    whole = console.measure(table, options=console.options.update(max_width=_UNBOUNDED))
    if whole.maximum > console.width:
        tell_trial(console, trial)
        return
    console.print(table)
    if silent:
        console.print(Text(f"  {_SILENT} a percept that says nothing of this attribute", "dim"))
    console.print()
    for number, step in enumerate(trial.steps, start=1):
        if step.warning:
            print_facts(console, {"warning": f"step {number}: {step.warning}"})
    print_facts(console, ending(trial), verdict_style(trial))


def _cell(word: str, p: float, width: int) -> str:
    return f"{word:<{width}} {_percent(p).removesuffix(' %')}"


def print_facts(
    console: Console, facts: "Mapping[str, str]", styles: "Mapping[str, str] | None" = None
) -> None:
    """Print labels and what they stand for; long texts wrap beside their label."""
    for label, value in facts.items():
        head, style = _label(label), (styles or {}).get(label, "")
        room = max(console.width - len(head), _NARROW)
        for line in value.splitlines():
            for part in textwrap.wrap(line, room, break_long_words=False) or [""]:
                console.print(head.append_text(Text(part, style)), soft_wrap=True)
                head = _label("")


def ending(trial: "Trial") -> dict[str, str]:
    """Say in words what was reported, whether it is right, and what it cost."""
    from meal_bayes.trial_log.words import truth_words, verdict_word

    facts = {
        "answer": "none; every report was too risky",
        "truth": truth_words(trial.task.query.attributes, trial.truth),
    }
    if trial.ended:
        facts["answer"] = f"none; {trial.ended}"
    if trial.report is not None:
        facts["answer"] = trial.task.query.report_name(trial.report)
        if trial.success is not None:
            facts["verdict"] = verdict_word(trial)
    reward = "" if math.isnan(trial.reward) else f", reward {trial.reward:.1f}"
    facts["cost"] = f"{trial.cost:.1f} s{reward}"
    return facts


def verdict_style(trial: "Trial") -> dict[str, str]:
    """Style the answer and the verdict."""
    return {"answer": "bold", "verdict": "bold green" if trial.success else "bold red"}


def bar(p: float, signs: Signs) -> Text:
    """Draw a probability; green where the attribute would be reported."""
    full = round(p * _BAR)
    line = Text(signs.full * full, "green" if p > 0.5 else "yellow")  # noqa: PLR2004
    return line.append(signs.empty * (_BAR - full), "dim")


def happened(momdp: "MOMDP", step: "Step", arrow: str = "->") -> str:
    """Say in words what a behavior did."""
    action, x, next_x = step.decision.action, step.x, step.next_x
    way = f"{momdp.x_names[x]} {arrow} {momdp.x_names[next_x]}"
    if not momdp.legal[x, action]:
        return f"not legal here{', which ends the trial' * (next_x == momdp.terminal)}: {way}"
    if step.observation is not None:
        return f"succeeded, {way}"
    if step.warning:
        return f"{way}; what was felt is no percept"
    if momdp.informative[action].max() <= 0:
        return f"succeeded, {way}; it shows nothing" if x != next_x else f"failed, {way}"
    if step.belief.seen[0, action].sum() >= momdp.limit[action]:
        return f"{way}, but no recording is left to replay"
    return f"failed, {way}; nothing perceived"


def percept(momdp: "MOMDP", behavior: int, observation: "NDArray[np.int8]") -> str:
    """Say in words what was perceived."""
    from meal_bayes.trial_log.words import percept_words

    words = percept_words(momdp, behavior, observation)
    pairs = zip(momdp.query.attributes, words, strict=True)
    return ", ".join(f"{name}: {word}" for name, word in pairs)


def best_options(decision: "Decision") -> list[int]:
    """Positions in `values` worth showing: the best behaviors, the chosen one, the report."""
    values, end = decision.values, len(decision.values) - 1
    valued = [e for e in range(end) if not math.isnan(values[e])]
    best = sorted(valued, key=lambda e: -values[e])[:_OPTIONS]
    chosen = min(decision.action, end)
    if chosen in valued and chosen not in best:
        best[-1] = chosen
    return [*best, end] if not math.isnan(values[end]) else best


def _percent(p: float) -> str:
    """Round a probability, but never to certainty."""
    if 0 < p < _ROUNDED or 1 - _ROUNDED < p < 1:
        return " <0.1 %" if p < _ROUNDED else ">99.9 %"
    return f"{100 * p:5.1f} %"


def _label(text: str) -> Text:
    return Text(f"  {text:<{_LABEL}} ", "dim")

"""A step in words, as Markdown: the question, what was done and why, what the answer is."""

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from meal_bayes.agents.trial import Step, Trial
from meal_bayes.momdp import MOMDP
from meal_bayes.trial_log.words import percent, percept_words, truth_words, verdict_word
from meal_bayes.viewer.moments import Moment

_OPTIONS = 8  # actions that are compared
_ATTRIBUTES = 12  # that are listed
_SHOWN_ERROR = 0.05  # errors below it would print as 0.0


@lru_cache(maxsize=4096)
def plain(text: str) -> str:
    """Take from a name what Markdown would read as a sign of its own."""
    return "".join(" " if sign in "\\`*<>[]()|#!\n\r\t$" else sign for sign in text).strip()


def question(trial: Trial) -> str:
    """Ask in words."""
    return " and ".join(plain(name) for name in trial.task.query.attributes) + "?"


def action_word(momdp: MOMDP, action: int) -> str:
    """Name a behavior, or say that it is a report."""
    return plain(momdp.behavior_names[action]) if action < momdp.n_behaviors else "report"


def story(moment: Moment) -> str:
    """Tell a moment: question, step, outcome, beliefs, compared actions."""
    trial, momdp = moment.trial, moment.trial.momdp
    lines = [f"### {question(trial)}", _about(trial), "", *_done(moment), ""]
    lines += ["|attribute|belief|percept|", "|---|---|---|"]
    positive, words = moment.positive.tolist(), [""] * len(trial.task.query)
    if moment.step is not None and moment.step.observation is not None:
        action = moment.step.decision.action
        words = percept_words(momdp, action, moment.step.observation)
    for i, name in enumerate(trial.task.query.attributes[:_ATTRIBUTES]):
        lines.append(f"|{plain(name)}|{percent(positive[i])}|{words[i]}|")
    return "\n".join([*lines, "", *_answer(moment)])


def why(moment: Moment) -> str:
    """Tell what the actions were worth when the step was chosen."""
    step, momdp = moment.step, moment.trial.momdp
    if step is None:
        return "*Nothing is decided yet.*"
    decision, end = step.decision, momdp.n_behaviors
    options = best_options(decision.values, min(decision.action, end))
    if not options:
        return "*This agent follows a rule and compares nothing.*"
    rows = ["|action|expected reward|visits|cost, s|", "|---|---|---|---|"]
    for option in options:
        name = action_word(momdp, option)
        error = decision.value_se[option]
        spread = f" ± {error:.1f}" if error >= _SHOWN_ERROR else ""
        value = f"{decision.values[option]:.1f}{spread}"
        visits = f"{decision.visits[option]}" if option < end and decision.simulations else ""
        cost = f"{momdp.cost[option]:g}" if option < end else "0"
        chosen = option == min(decision.action, end)
        cells = [f"**{cell}**" if chosen and cell else cell for cell in (name, value, visits, cost)]
        rows.append(f"|{'|'.join(cells)}|")
    searched = f"\n\n{decision.simulations} simulations" if decision.simulations else ""
    return "\n".join(rows) + searched


def best_options(values: np.ndarray, chosen: int, count: int = _OPTIONS) -> list[int]:
    """Positions of the best actions, best first; the chosen one and the report are among them."""
    end = len(values) - 1
    valued = [e for e in range(end) if not math.isnan(values[e])]
    best = sorted(valued, key=lambda e: -values[e])[: count - 1]
    if chosen in valued and chosen not in best:
        best[-1] = chosen
    if not math.isnan(values[end]):
        best.append(end)
    return sorted(best, key=lambda e: -values[e])


def log_line(moment: Moment) -> str:
    """Tell a moment in one line."""
    trial, step, momdp = moment.trial, moment.step, moment.trial.momdp
    if step is None:
        return f"trial {moment.trial_number}: {question(trial)} {plain(trial.task.object_name)}"
    action = step.decision.action
    if action >= momdp.n_behaviors:
        verdict = verdict_word(trial).replace("wrong", "WRONG")
        return f"answers {_said(trial, trial.report)}: {verdict}, {trial.cost:g} s"
    seen = "nothing"
    if step.observation is not None:
        seen = ", ".join(percept_words(momdp, action, step.observation))
    way = f"{momdp.x_names[step.x]} → {momdp.x_names[step.next_x]}"
    return f"{momdp.behavior_names[action]}, {way}, percept {seen}, H {moment.entropy:.2f}"


def _about(trial: Trial) -> str:
    return f"{plain(trial.task.object_name)} · agent {plain(trial.agent)}"


def _done(moment: Moment) -> Sequence[str]:
    step, momdp, number = moment.step, moment.trial.momdp, moment.trial_number
    if step is None:
        return [f"**trial {number}, before any behavior**"]
    action = step.decision.action
    title = f"**trial {number}, step {moment.number}: {action_word(momdp, action)}**"
    if action >= momdp.n_behaviors:
        return [title, "", f"cost in all {moment.spent:g} s"]
    way = f"{plain(momdp.x_names[step.x])} → {plain(momdp.x_names[step.next_x])}"
    return [
        title,
        "",
        f"{way}, {_outcome(step, momdp)}, {step.cost:g} s ({moment.spent:g} s so far)",
        *([f"**{plain(step.warning)}**"] if step.warning else []),
    ]


def _outcome(step: Step, momdp: MOMDP) -> str:
    action = step.decision.action
    if not momdp.legal[step.x, action]:
        return "**not legal here**"
    if step.observation is not None or (
        momdp.informative[action].max() <= 0 and step.x != step.next_x
    ):
        return "succeeded"
    if step.warning:
        return "**no percept**"
    if step.belief.seen[0, action].sum() >= momdp.limit[action]:
        return "no recording left"
    return "**failed**, nothing perceived"


def _answer(moment: Moment) -> Sequence[str]:
    trial = moment.trial
    if not moment.last:
        best = _said(trial, moment.positive > 0.5)  # noqa: PLR2004
        sure = float(np.maximum(moment.positive, 1 - moment.positive).prod())
        return [f"now it would answer **{best}** ({percent(sure)} sure)"]
    truth = plain(truth_words(trial.task.query.attributes, trial.truth))
    if trial.ended:
        return ["### broken off", f"{plain(trial.ended)}; truth: {truth}"]
    if trial.report is None:
        return ["### no answer", f"every report was too risky; truth: {truth}"]
    answer = f"### answer: {_said(trial, trial.report)}"
    if trial.success is None:
        return [answer, f"truth: {truth}"]
    verdict = "right" if trial.success else f"WRONG; truth: {truth}"
    return [answer, f"**{verdict}**, reward {trial.reward:.1f}"]


def _said(trial: Trial, values: np.ndarray | None) -> str:
    if values is None:
        return "nothing"
    shown = trial.task.query.report_name(values)
    return plain(shown)

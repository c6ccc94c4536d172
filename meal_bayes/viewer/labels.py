"""The texts of the viewer, as Markdown: question, decision, outcome, answer."""

from functools import lru_cache

from meal_bayes.look import AMOUNT, percent
from meal_bayes.momdp import MOMDP, best_report, report_certainty
from meal_bayes.planners import RULE, Decision
from meal_bayes.trials import percept_labels
from meal_bayes.trials.text import (
    WRONG,
    belief_before,
    believed,
    compared_actions,
    final_facts,
    gap_text,
    outcome_text,
)
from meal_bayes.viewer.recorder import TrialFrame

_OPTIONS = 8  # actions that are compared
_ATTRIBUTES = 12  # that are listed
_NAME = 30  # letters of an action; the answer to many questions would fill the view
_HEADED = 3  # questions, of more a heading would fill the view


@lru_cache(maxsize=4096)
def plain_text(text: str) -> str:
    """Remove from a name the characters that Markdown would interpret."""
    return "".join(" " if sign in "\\`*<>[]()|#!\n\r\t$" else sign for sign in text).strip()


def action_label(momdp: MOMDP, action: int) -> str:
    """Return the name of a behavior, "answer" or "abstain"."""
    return plain_text(momdp.action_label(action))


def option_label(momdp: MOMDP, decision: Decision, option: int) -> str:
    """Return the label of one of the E + 1 compared actions, of which the last answers."""
    chosen = option == min(decision.action, momdp.n_behaviors)
    return action_label(momdp, decision.action if chosen else option)


def narrate(frame: TrialFrame) -> str:
    """Return the text of a frame: question, step, outcome, beliefs, answer."""
    trial = frame.trial
    momdp = frame.trial.momdp
    step = frame.step
    query = trial.task.query
    about = f"{plain_text(trial.task.object_name)} · agent {plain_text(trial.agent)}"
    question = " and ".join(plain_text(name) for name, _ in query.questions)
    if query.event is not None:
        question = plain_text(query.text.removesuffix("?"))
    mark = "### " if len(query.questions) <= _HEADED else "**"
    lines = [f"{mark}{question}?{mark.strip('# ')}", "", about, ""]
    percepts = [""] * len(query)
    if step is None:
        lines.append(f"**trial {frame.time.trial}, before any behavior**")
    else:
        action = step.decision.action
        spent = f"cost in all {frame.spent:g} s"
        name = f"step {frame.number}: {plain_text(trial.momdp.action_label(action))}"
        if action < momdp.n_behaviors:
            outcome = plain_text(outcome_text(momdp, step))
            spent = f"{outcome}, {step.cost:g} s ({frame.spent:g} s so far)"
        lines += [f"**trial {frame.time.trial}, {name}**", "", spent]
        lines += [f"**{plain_text(step.warning)}**"] if step.warning else []
        if step.observation is not None:
            words = percept_labels(momdp, action, step.observation)
            for (_, indices), word in zip(query.questions, words, strict=True):
                percepts[indices[0]] = word
    lines += ["", "|attribute|before|belief|percept|", "|---|---|---|---|"]
    beliefs = believed(trial, frame.belief)
    before = believed(trial, belief_before(trial, max(frame.number, 1)))
    words = [""] * (len(beliefs) - len(percepts)) + percepts
    rows = list(zip(beliefs, before, words, strict=True))[:_ATTRIBUTES]
    lines += [
        f"|{plain_text(name)}|{percent(old)}|{percent(p)}|{word}|"
        for (name, p), (_, old), word in rows
    ]
    if frame.number < len(trial.steps):
        report = momdp.reported(best_report(momdp, frame.belief))
        assert report is not None
        best = plain_text(query.report_name(report))
        sure = percent(report_certainty(momdp, frame.belief, report))
        return "\n".join([*lines, "", f"now it would answer **{best}** ({sure} sure)"])
    facts = {name: plain_text(text) for name, text in final_facts(trial).items()}
    verdict = facts.get("verdict", "")
    if verdict:
        verdict = f"**{verdict.upper() if verdict == WRONG else verdict}**; "
    end = [f"### answer: {facts['answer']}", f"{verdict}truth: {facts['truth']}", facts["cost"]]
    return "\n".join([*lines, "", *end])


def explain_decision(frame: TrialFrame) -> str:
    """Return a table of the expected rewards of the actions when the step was chosen."""
    step = frame.step
    momdp = frame.trial.momdp
    if step is None:
        return "*Nothing is decided yet.*"
    decision = step.decision
    compared = compared_actions(momdp, decision, belief_before(frame.trial, frame.number), _OPTIONS)
    if not compared:
        return f"*{RULE}*"
    heads = ["action", *decision.value_heads, "simulations", "cost, s"]
    lines = [f"|{'|'.join(heads)}|", "|".join(["", *("---" for _ in heads), ""])]
    for action in compared:
        cells = [
            plain_text(action.name if len(action.name) <= _NAME else "answer"),
            f"{action.value:{AMOUNT}} {action.error}".rstrip(),
            *([] if action.bonus is None else [f"{action.bonus:{AMOUNT}}"]),
            "" if action.visits is None else f"{action.visits}",
            f"{action.cost:g}",
        ]
        if action.chosen:
            cells = [f"**{cell}**" if cell else cell for cell in cells]
        lines.append(f"|{'|'.join(cells)}|")
    searched = f"{decision.simulations} simulations" if decision.simulations else ""
    notes = ", ".join(filter(None, (searched, gap_text(decision))))
    if notes:
        lines += ["", notes]
    return "\n".join(lines)

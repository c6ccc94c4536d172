"""The trials with the lowest reward, as sections of a page."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from meal_bayes.display import percent
from meal_bayes.evaluation import plots
from meal_bayes.trial_log import Group
from meal_bayes.trials import Trial, TrialOutcomes, percept_labels
from meal_bayes.trials.text import outcome_facts

WORST = 10  # trials that are kept whole

Section = dict[str, Any]


class Worst(NamedTuple):
    """A trial with one of the lowest rewards, its number in its file, its outcome as one row.

    `trial` is None of a compact log; `badness` is the belief in the report less the reward.
    """

    file: Path
    number: int
    outcome: TrialOutcomes
    trial: Trial | None
    badness: float


def worst_of(worst: Sequence[Worst], group: Group) -> list[Worst]:
    """Return the worst of some trials and of a group: those with the lowest reward.

    Of equals, those that were surest come first, then the earliest.
    """
    outcomes, judged = group.outcomes, np.flatnonzero(group.outcomes.judged)
    badness = outcomes.certainty - outcomes.reward
    entries = [
        Worst(group.file, group.places[row], outcomes.rows([row]),
              group.trials[row] if group.trials else None, badness[row])
        for row in judged[np.argsort(-badness[judged], kind="stable")[:WORST]].tolist()
    ]  # fmt: skip
    return sorted([*worst, *entries], key=lambda entry: -entry.badness)[:WORST]


def trial_section(worst: Worst) -> Section:
    """Return a trial as a part of a section, its verdict before its title."""
    file, number, outcome, trial, _ = worst
    facts, verdict = outcome_facts(outcome, 0), "abstained"
    if outcome.answered[0]:
        verdict = "right" if outcome.success[0] else "wrong"
    title = "trial {}: {question} {object}, {agent}: {answer}; {cost}".format(number, **facts)
    text = f"truth: {facts['truth']}"
    if trial is None:
        return {"title": title, "verdict": verdict, "text": f"{text}; {file} holds no steps"}
    caption = (
        "Behaviors, beliefs, and the worth of one more percept; circles at the end are the truth."
    )
    head = ["", "behavior", "s", "percept", "belief", "gap"]
    return {
        "title": title,
        "verdict": verdict,
        "text": text,
        "command": f"meal-bayes view {file} --trial {number}",
        "tables": [{"head": head, "rows": list(_steps(trial)), "texts": (1, 3, 4)}],
        "figures": [(plots.trial_strip(trial), caption)] if trial.steps else [],
    }


def _steps(trial: Trial) -> Iterator[list[str]]:
    momdp = trial.momdp
    for number, step in enumerate(trial.steps, start=1):
        action, percept = step.decision.action, step.warning or "-"
        if action >= momdp.n_behaviors:
            percept = step.warning
        elif step.observation is not None:
            percept = ", ".join(percept_labels(momdp, action, step.observation))
        belief = ", ".join(map(percent, step.belief.positive.tolist()))
        gap = "" if step.decision.gap is None else f"{step.decision.gap:.1f}"
        label = momdp.action_label(action)
        yield [str(number), label, f"{step.cost:g}", percept, belief, gap]

"""What must fit together in a trial; asked before writing and again after reading."""

from collections.abc import Iterator

import numpy as np

from meal_bayes.agents.trial import Step, Trial
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.trial_log.schema import NAME_LIMIT


def misfit(trial: Trial) -> str | None:
    """Say what in a trial does not fit its MOMDP, or None when all does."""
    found = start_misfit(trial) or report_misfit(trial)
    steps = (
        step_misfit(step, trial.momdp, f"step {index}") for index, step in enumerate(trial.steps)
    )
    return found or next((problem for problem in steps if problem is not None), None)


def start_misfit(trial: Trial) -> str | None:
    """Say what does not fit before the first step."""
    return next(_start_misfits(trial), None)


def report_misfit(trial: Trial) -> str | None:
    """Say what does not fit of a trial's report."""
    n = len(trial.momdp.query)
    if trial.report is not None and trial.report.shape != (n,):
        return f"report has shape {trial.report.shape}, expected {(n,)}"
    return None


def step_misfit(step: Step, momdp: MOMDP, where: str) -> str | None:
    """Say what in a step does not fit its MOMDP."""
    return next(_step_misfits(step, momdp, where), None)


def _start_misfits(trial: Trial) -> Iterator[str]:
    momdp = trial.momdp
    n = len(momdp.query)
    for kind, names in (
        ("attributes", momdp.query.attributes),
        ("behaviors", momdp.behavior_names),
        ("x", momdp.x_names),
    ):
        if len(names) > NAME_LIMIT:
            yield f"the MOMDP has {len(names)} {kind}, a log holds at most {NAME_LIMIT}"
    if trial.task.query != momdp.query:
        yield f"the task asks {trial.task.query}, its MOMDP {momdp.query}"
    if trial.truth.shape != (n,) or not np.isin(trial.truth, (-1, 0, 1)).all():
        yield f"truth is {trial.truth.tolist()}, expected {n} of 1, 0 and -1"
    yield from _belief_misfits(trial.first_belief, momdp, "the first belief")


def _belief_misfits(belief: Belief, momdp: MOMDP, where: str) -> Iterator[str]:
    n, e = len(momdp.query), momdp.n_behaviors
    if not 0 <= belief.x < len(momdp.x_names):
        yield f"{where} is in x {belief.x}, expected 0 to {momdp.terminal}"
    if belief.weight.shape != (n, momdp.n_kinds):
        found = belief.weight.shape
        yield f"{where} has weight of shape {found}, expected {(n, momdp.n_kinds)}"
    shared = belief.log_share is momdp.log_share
    if not (shared or np.array_equal(belief.log_share, momdp.log_share)):
        yield f"{where} has other truths of the kinds than the MOMDP"
    if belief.seen.shape != (n, e, momdp.levels):
        found = belief.seen.shape
        yield f"{where} has seen percepts of shape {found}, expected {(n, e, momdp.levels)}"


def _step_misfits(step: Step, momdp: MOMDP, where: str) -> Iterator[str]:
    n, e = len(momdp.query), momdp.n_behaviors
    decision = step.decision
    if not 0 <= decision.action < momdp.n_actions:
        yield f"{where} has action {decision.action}, expected a number below {e} + 2^{n}"
    for name in ("values", "value_se", "visits"):
        found = getattr(decision, name).shape
        if found != (e + 1,):
            yield f"{where} has {name} of shape {found}, expected {(e + 1,)}"
    if not (0 <= step.x < len(momdp.x_names) and 0 <= step.next_x < len(momdp.x_names)):
        yield f"{where} goes from x {step.x} to {step.next_x}, expected 0 to {momdp.terminal}"
    if step.observation is not None:
        if np.shape(step.observation) != (n,):
            yield f"{where} has percepts of shape {np.shape(step.observation)}, expected {(n,)}"
        levels = step.observation.ravel().tolist()
        if levels and not 0 <= min(levels) <= max(levels) < momdp.levels:
            yield f"{where} has percepts {levels}, expected levels 0 to {momdp.levels - 1}"
    yield from _belief_misfits(step.belief, momdp, where)

"""What must fit together in a trial; asked before writing and again after reading."""

from collections.abc import Iterator

import numpy as np

from meal_bayes.agents.trial import Step, Trial
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.trial_log.schema import EDGE_LIMIT, NAME_LIMIT, SEEN_LIMIT


def misfit(trial: Trial) -> str | None:
    """Say what in a trial does not fit its MOMDP, or None when all does."""
    return next(_misfits(trial), None)


def _misfits(trial: Trial) -> Iterator[str]:
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
    if trial.truth.shape != (n,):
        yield f"truth has shape {trial.truth.shape}, expected {(n,)}"
    if trial.report is not None and trial.report.shape != (n,):
        yield f"report has shape {trial.report.shape}, expected {(n,)}"
    edges = sum(len(step.decision.tree) for step in trial.steps)
    if edges > EDGE_LIMIT:
        yield f"its search trees have {edges} edges, a log holds at most {EDGE_LIMIT} of a trial"
    if (1 + len(trial.steps)) * trial.first_belief.seen.size > SEEN_LIMIT:
        yield f"its beliefs count more than {SEEN_LIMIT} percepts, which no log holds of a trial"
    for name in ("cost", "bonus", "correct", "incorrect", "counts"):
        if not np.isfinite(getattr(momdp, name)).all():
            yield f"the MOMDP's {name} is not finite"
    yield from _belief_misfits(trial.first_belief, momdp, "the first belief")
    for index, step in enumerate(trial.steps):
        yield from _step_misfits(step, momdp, f"step {index}")


def _belief_misfits(belief: Belief, momdp: MOMDP, where: str) -> Iterator[str]:
    n, e = len(momdp.query), momdp.n_behaviors
    if not 0 <= belief.x < len(momdp.x_names):
        yield f"{where} is in x {belief.x}, expected 0 to {momdp.terminal}"
    if belief.weight.shape != (n, momdp.n_kinds):
        found = belief.weight.shape
        yield f"{where} has weight of shape {found}, expected {(n, momdp.n_kinds)}"
    elif np.isnan(belief.weight).any() or not np.isfinite(belief.weight.max(axis=1)).all():
        yield f"{where} has weights that are no logarithms of probabilities"
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
    if not np.isfinite([step.cost, step.reward]).all():
        yield f"{where} costs {step.cost} and earns {step.reward}, expected finite numbers"
    if not (0 <= step.x < len(momdp.x_names) and 0 <= step.next_x < len(momdp.x_names)):
        yield f"{where} goes from x {step.x} to {step.next_x}, expected 0 to {momdp.terminal}"
    if step.observation is not None:
        if np.shape(step.observation) != (n,):
            yield f"{where} has percepts of shape {np.shape(step.observation)}, expected {(n,)}"
        levels = step.observation.ravel().tolist()
        if levels and not 0 <= min(levels) <= max(levels) < momdp.levels:
            yield f"{where} has percepts {levels}, expected levels 0 to {momdp.levels - 1}"
    yield from _belief_misfits(step.belief, momdp, where)

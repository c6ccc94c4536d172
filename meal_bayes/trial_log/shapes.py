"""Consistency of a trial, checked before writing and again after reading."""

from collections.abc import Iterator

import numpy as np

from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.momdp.belief import log_odds
from meal_bayes.trial_log.schema import COUNT_LIMIT, EDGE_LIMIT, NAME_LIMIT
from meal_bayes.trials import Step, Trial


def misfits(trial: Trial) -> Iterator[str]:
    """Yield what in a trial does not fit its MOMDP."""
    yield from start_misfits(trial)
    yield from report_misfits(trial)
    for index, step in enumerate(trial.steps):
        yield from step_misfits(step, trial.momdp, index)


def report_misfits(trial: Trial) -> Iterator[str]:
    """Yield what does not fit of a trial's report."""
    n = len(trial.momdp.query)
    if trial.report is not None and trial.report.shape != (n,):
        yield f"report has shape {trial.report.shape}, expected {(n,)}"


def size_misfits(steps: int, edges: int, counts: int) -> Iterator[str]:
    """Yield which limits of the format a trial exceeds.

    Parameters
    ----------
    steps, edges : int
        How many, of the search trees.
    counts : int
        Percept counts of one belief.
    """
    if edges > EDGE_LIMIT:
        yield f"its search trees have {edges} edges, a log holds at most {EDGE_LIMIT} of a trial"
    if (1 + steps) * counts > COUNT_LIMIT:
        yield f"its beliefs count more than {COUNT_LIMIT} percepts, which no log holds of a trial"


def start_misfits(trial: Trial) -> Iterator[str]:
    """Yield what does not fit before the first step."""
    momdp = trial.momdp
    n = len(momdp.query)
    for noun, names in (
        ("attributes", momdp.query.attributes),
        ("behaviors", momdp.behavior_names),
        ("x", momdp.x_names),
    ):
        if len(names) > NAME_LIMIT:
            yield f"the MOMDP has {len(names)} {noun}, a log holds at most {NAME_LIMIT}"
    if trial.task.query != momdp.query:
        yield f"the task asks {trial.task.query}, its MOMDP {momdp.query}"
    if trial.truth.shape != (n,):  # of which there may be millions
        yield f"truth has shape {trial.truth.shape}, expected {(n,)}"
    elif not np.isin(trial.truth, (-1, 0, 1)).all():
        yield f"truth is {trial.truth.tolist()}, expected {n} of 1, 0 and -1"
    expected = (n, momdp.n_behaviors, 2, momdp.levels)
    if trial.counts is not None and trial.counts.shape != expected:
        yield f"counts have shape {trial.counts.shape}, expected {expected}"
    elif trial.counts is not None and not np.isfinite(trial.counts).all():
        yield "counts are not finite"
    yield from _belief_misfits(trial.first_belief, momdp, "the first belief")


def _belief_misfits(belief: Belief, momdp: MOMDP, where: str) -> Iterator[str]:
    n, e = len(momdp.query), momdp.n_behaviors
    if not 0 <= belief.x < len(momdp.x_names):
        yield f"{where} is in x {belief.x}, expected 0 to {momdp.terminal}"
    if belief.log_prob.shape != (n, momdp.n_classes):
        found = belief.log_prob.shape
        yield f"{where} has log_prob of shape {found}, expected {(n, momdp.n_classes)}"
    elif np.isnan(belief.log_prob).any() or not np.isfinite(belief.log_prob.max(axis=1)).all():
        yield f"{where} has weights that are no logarithms of probabilities"
    if belief.percept_counts.shape != (n, e, momdp.levels):
        found = belief.percept_counts.shape
        yield f"{where} has percept counts of shape {found}, expected {(n, e, momdp.levels)}"


def odds_misfits(belief: Belief, momdp: MOMDP) -> Iterator[str]:
    """Yield whether a belief has other log-odds than a reader computes."""
    if not np.array_equal(belief.log_odds, log_odds(momdp, belief.log_prob), equal_nan=True):
        yield "a belief has other log-odds than its MOMDP makes of its log-probabilities"


def step_misfits(step: Step, momdp: MOMDP, index: int) -> Iterator[str]:
    """Yield what in the step of this index does not fit its MOMDP."""
    where, n, e = f"step {index}", len(momdp.query), momdp.n_behaviors
    decision = step.decision
    if not 0 <= decision.action < momdp.n_actions:
        answers = f"2^{n}{' + 1' * momdp.abstain}"  # which may be a number of many digits
        yield f"{where} has action {decision.action}, expected a number below {e} + {answers}"
    for name in ("values", "value_se", "visits"):
        found = getattr(decision, name).shape
        if found != (e + 1,):
            yield f"{where} has {name} of shape {found}, expected {(e + 1,)}"
    rows = decision.sampled_rows
    if rows is not None and rows.shape[1:] != (n, momdp.levels):
        yield f"{where} has sampled rows of shape {rows.shape}, expected (M,{n},{momdp.levels})"
    if not np.isfinite(step.cost) or np.isinf(step.reward):  # nan where the truth is not known
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

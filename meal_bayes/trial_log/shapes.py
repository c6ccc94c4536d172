"""Consistency of a trial, checked before writing and again after reading."""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.trial_log.schema import NAME_LIMIT
from meal_bayes.trials import Step, Trial


def misfits(trial: Trial) -> Iterator[str]:
    """Yield what in a trial does not fit its MOMDP."""
    yield from start_misfits(trial)
    yield from report_misfits(trial)
    for index, step in enumerate(trial.steps):
        yield from step_misfits(step, trial.momdp, index)


def report_misfits(trial: Trial) -> Iterator[str]:
    """Yield what does not fit of a trial's report."""
    return _shape_misfits(report=(trial.report, (len(trial.momdp.query),)))


def start_misfits(trial: Trial) -> Iterator[str]:
    """Yield what does not fit before the first step."""
    momdp = trial.momdp
    n, e = len(momdp.query), momdp.n_behaviors
    if (most := max(n, e, len(momdp.x_names))) > NAME_LIMIT:
        yield f"the MOMDP has {most} attributes, behaviors or x, a log holds at most {NAME_LIMIT}"
    if trial.task.query != momdp.query:
        yield f"the task asks {trial.task.query}, its MOMDP {momdp.query}"
    yield from _shape_misfits(truth=(trial.truth, (n,)))  # there may be millions
    if not np.isin(trial.truth, (-1, 0, 1)).all():
        yield f"truth is {trial.truth.tolist()}, expected {n} of 1, 0 and -1"
    yield from _shape_misfits(counts=(trial.counts, (n, e, 2, momdp.levels)))
    if trial.counts is not None and not np.isfinite(trial.counts).all():
        yield "counts are not finite"
    yield from _belief_misfits(trial.first_belief, momdp)


def step_misfits(step: Step, momdp: MOMDP, index: int) -> Iterator[str]:
    """Yield what in the step of this index does not fit its MOMDP."""
    n, e, k, decision = len(momdp.query), momdp.n_behaviors, momdp.levels, step.decision
    problems = list[str]()
    if not 0 <= decision.action < momdp.n_actions:
        answers = f"2^{n}{' + 1' * momdp.abstain}"  # which may be a number of many digits
        problems += [f"action {decision.action}, expected a number below {e} + {answers}"]
    percepts, rows = step.observation, decision.sampled_rows
    if percepts is not None and not ((percepts >= 0) & (percepts < k)).all():
        problems += [f"percepts {percepts.tolist()}, expected levels 0 to {k - 1}"]
    if not np.isfinite(step.cost) or np.isinf(step.reward):  # nan where the truth is not known
        problems += [f"cost {step.cost} and reward {step.reward}, expected finite numbers"]
    if not (0 <= step.x < len(momdp.x_names) and 0 <= step.next_x < len(momdp.x_names)):
        problems += [f"x {step.x} and {step.next_x}, expected 0 to {momdp.terminal}"]
    problems += _shape_misfits(
        values=(decision.values, (e + 1,)),
        value_se=(decision.value_se, (e + 1,)),
        visits=(decision.visits, (e + 1,)),
        sampled_rows=(rows, (0 if rows is None else len(rows), n, k)),
        percepts=(percepts, (n,)),
    )
    problems += _belief_misfits(step.belief, momdp)
    yield from (f"step {index}: {problem}" for problem in problems)


def _belief_misfits(belief: Belief, momdp: MOMDP) -> Iterator[str]:
    n, log_prob = len(momdp.query), belief.log_prob
    yield from _shape_misfits(
        log_prob=(log_prob, (n, momdp.n_classes)),
        percept_counts=(belief.percept_counts, (n, momdp.n_behaviors, momdp.levels)),
    )
    if not 0 <= belief.x < len(momdp.x_names):
        yield f"a belief in x {belief.x}, expected 0 to {momdp.terminal}"
    if np.isnan(log_prob).any() or not np.isfinite(log_prob.max(axis=1)).all():
        yield "weights of a belief that are no logarithms of probabilities"


def _shape_misfits(**arrays: tuple[NDArray[Any] | None, tuple[int, ...]]) -> Iterator[str]:
    for name, (array, expected) in arrays.items():
        if array is not None and array.shape != expected:
            yield f"{name} has shape {array.shape}, expected {expected}"

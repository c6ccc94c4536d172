"""Trial -> message bytes: one start, the steps with a line of text each, one outcome."""

from collections.abc import Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np

from meal_bayes.errors import LogError
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.planners import TreeEdge
from meal_bayes.trial_log.schema import (
    LINES,
    MESSAGE_LIMIT,
    OUTCOME,
    STEP,
    TRIAL,
    TRIAL_LIMIT,
    LogMessage,
    MomdpMessage,
    OutcomeMessage,
    StepMessage,
    TrialMessage,
    log_time,
)
from meal_bayes.trial_log.shapes import (
    odds_misfits,
    report_misfits,
    size_misfits,
    start_misfits,
    step_misfits,
)
from meal_bayes.trials import Step, Trial, task_key

_SHOWN = 6  # attributes in a line of text
_INFO, _WARNING = 2, 3  # levels of foxglove.Log
_ARRAYS = (  # of a MOMDP, by the same names in the log
    "transition", "observation_probability", "legal", "confusion", "precision", "prior",
    "latent_classes", "cost", "bonus", "limit",
)  # fmt: skip


class Packed(NamedTuple):
    """One message, ready for the file."""

    topic: str
    time: int  # ns on the log's clock
    data: bytes


def encode_momdp(trial: Trial) -> bytes:
    """Pack a trial's MOMDP and the counts behind it, without its number in the file."""
    momdp = trial.momdp
    fields = {name: getattr(momdp, name).ravel().tolist() for name in _ARRAYS}
    return _bytes(
        MomdpMessage(
            attributes=momdp.query.attributes,
            x_names=momdp.x_names,
            behavior_names=momdp.behavior_names,
            start=momdp.start,
            correct=momdp.correct,
            incorrect=momdp.incorrect,
            discount=momdp.discount,
            abstain=momdp.abstain,
            row_counts=() if trial.counts is None else trial.counts.ravel().tolist(),
            **fields,
        )
    )


def numbered(number: int, momdp: bytes) -> bytes:
    """Add to a packed MOMDP its number in the file (protobuf messages join by concatenation)."""
    prefix: bytes = MomdpMessage(id=number).SerializeToString()
    return prefix + momdp


class TrialEncoder:
    """Packs one trial: its start, its steps one by one, its outcome.

    Parameters
    ----------
    number : int
        Of the trial in the file.
    momdp : int
        Number of its MOMDP in the file.

    Raises
    ------
    LogError
        The arrays do not fit each other, or the trial is beyond the format's limits.
    """

    def __init__(self, number: int, momdp: int) -> None:
        self._number, self._momdp = number, momdp
        self._steps = self._edges = self._size = 0

    def begin(self, trial: Trial) -> list[Packed]:
        """Pack the start of a trial; its steps come later."""
        self._check(start_misfits(trial))
        self._check(odds_misfits(trial.first_belief, trial.momdp))
        self._check(size_misfits(0, 0, trial.first_belief.percept_counts.size))
        self._trial, self._before = trial, trial.first_belief
        start = _bytes(_start(trial, self._number, self._momdp))
        return self._counted([Packed(TRIAL, log_time(self._number, 0), start)])

    def step(self, step: Step) -> list[Packed]:
        """Pack the next step with a line of text."""
        momdp, index = self._trial.momdp, self._steps
        self._edges += len(step.decision.tree)
        self._check(size_misfits(index + 1, self._edges, step.belief.percept_counts.size))
        self._check(step_misfits(step, momdp, index))
        self._check(odds_misfits(step.belief, momdp))
        positive = step.belief.positive.tolist()
        replayed = _replays(self._before, step, momdp)
        counts = [] if replayed else step.belief.percept_counts.ravel().tolist()
        data = _bytes(_step(step, momdp, self._number, index, positive, counts))
        time = log_time(self._number, index + 1)
        self._steps, self._before = index + 1, step.belief
        line = _line(self._trial, step, self._number, index, positive, time)
        return self._counted([Packed(STEP, time, data), Packed(LINES, time, line)])

    def end(self, trial: Trial) -> list[Packed]:
        """Pack the outcome."""
        self._check(report_misfits(trial))
        time = log_time(self._number, self._steps + 1)
        return self._counted([Packed(OUTCOME, time, _bytes(_outcome(trial, self._number)))])

    def whole(self, trial: Trial) -> list[Packed]:
        """Pack a trial that is whole."""
        packed = self.begin(trial)
        for step in trial.steps:
            packed += self.step(step)
        return packed + self.end(trial)

    def _check(self, problems: Iterator[str]) -> None:
        for problem in problems:
            raise LogError(f"Trial {self._number} cannot be logged: {problem}.")

    def _counted(self, packed: list[Packed]) -> list[Packed]:
        self._size += sum(len(message.data) for message in packed)
        if self._size > TRIAL_LIMIT:
            raise LogError(
                f"Trial {self._number} takes {self._size} bytes; a log holds at most {TRIAL_LIMIT}."
            )
        return packed


def _bytes(message: Any) -> bytes:
    data: bytes = message.SerializeToString()
    if len(data) > MESSAGE_LIMIT:
        raise LogError(
            f"A {type(message).__name__} message takes {len(data)} bytes; a log holds at most "
            f"{MESSAGE_LIMIT} in one message (log fewer edges of the search tree)."
        )
    return data


def _start(trial: Trial, number: int, momdp: int) -> Any:
    task, first = trial.task, trial.first_belief
    return TrialMessage(
        trial=number,
        momdp=momdp,
        agent=trial.agent,
        name=task.name,
        attributes=task.query.attributes,
        object_index=task.object_index,
        object_name=task.object_name,
        key=task_key(task.key),
        truth=trial.truth.tolist(),
        belief_x=first.x,
        log_prob=first.log_prob.ravel().tolist(),
        positive=first.positive.tolist(),
        percept_counts=first.percept_counts.ravel().tolist() if first.percept_counts.any() else [],
    )


def _replays(before: Belief, step: Step, momdp: MOMDP) -> bool:
    """Return whether the percept counts after a step follow from action and percept."""
    change = step.belief.percept_counts - before.percept_counts
    action = step.decision.action
    if step.observation is not None and action < momdp.n_behaviors:
        change[np.arange(len(change)), action, step.observation] -= 1
    return not change.any()


def _step(
    step: Step, momdp: MOMDP, trial: int, index: int, positive: list[float], counts: list[int]
) -> Any:
    decision, e = step.decision, momdp.n_behaviors
    report = momdp.reported(decision.action) if decision.action >= e else None
    return StepMessage(
        trial=trial,
        step=index,
        x=step.x,
        action=min(decision.action, e),
        action_name=momdp.action_name(decision.action),
        report=() if report is None else report.tolist(),
        legal=momdp.legal[step.x].tolist(),
        next_x=step.next_x,
        observation=() if step.observation is None else step.observation.tolist(),
        cost=step.cost,
        reward=step.reward,
        values=decision.values.tolist(),
        value_se=decision.value_se.tolist(),
        visits=decision.visits.tolist(),
        simulations=decision.simulations,
        sampled_rows=() if decision.sampled_rows is None else decision.sampled_rows.ravel(),
        gap=() if decision.gap is None else (decision.gap,),
        belief_x=step.belief.x,
        log_prob=step.belief.log_prob.ravel().tolist(),
        positive=positive,
        percept_counts=counts,
        warning=step.warning,
        **_tree(decision.tree),
    )


def _tree(tree: tuple[TreeEdge, ...]) -> dict[str, Any]:
    if not tree:
        return {}
    level, parent, action, observation, visits, value = zip(*tree, strict=True)
    return {
        "tree_level": level,
        "tree_parent": parent,
        "tree_action": action,
        "tree_visits": visits,
        "tree_value": value,
        "tree_observation_size": list(map(len, observation)),
        "tree_observation": list(chain.from_iterable(observation)),
    }


def _outcome(trial: Trial, number: int) -> Any:
    return OutcomeMessage(
        trial=number,
        steps=len(trial.steps),
        report=() if trial.report is None else trial.report.tolist(),
        success=judgment(trial),
        cost=trial.cost,
        reward=trial.reward,
        ended=trial.ended,
    )


def judgment(trial: Trial) -> int:
    """Return 1 where a trial's report is right, 0, or -1 where that is unknown."""
    return -1 if trial.success is None else int(trial.success)


def _line(
    trial: Trial, step: Step, number: int, index: int, positive: list[float], time: int
) -> bytes:
    momdp = trial.momdp
    percepts = "none" if step.observation is None else " ".join(map(str, step.observation.tolist()))
    names = momdp.query.attributes[:_SHOWN]
    belief = ", ".join(f"{name} {p:.3f}" for name, p in zip(names, positive, strict=False))
    more = ", ..." if len(positive) > _SHOWN else ""
    text = (
        f"trial {number} step {index}: {momdp.action_name(step.decision.action)}, "
        f"{momdp.x_names[step.x]} -> {momdp.x_names[step.next_x]}, {step.cost:g} s, "
        f"percept {percepts}, belief {belief}{more}, reward {step.reward:g}"
    )
    if step.warning:
        text += f"; {step.warning}"
    line = LogMessage(level=_WARNING if step.warning else _INFO, message=text, name=trial.agent)
    line.timestamp.seconds = time // 1_000_000_000
    return _bytes(line)

"""Trial -> message bytes: one start, the steps with a line of text each, one outcome.

In the compact form, columns of many trials are one message. Whether the parts of a trial fit each
other is checked before writing, and again after reading.
"""

import hashlib
import math
from collections.abc import Iterator
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import LogError
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.sensed import sensed_fields, within_limits
from meal_bayes.trials import Step, Trial, TrialOutcomes, task_key
from meal_bayes.trials.outcomes import INTEGERS, REALS, TEXTS

_SHOWN = 6  # attributes in a line of text
# Levels of foxglove.Log.
_INFO = 2
_WARNING = 3


class Packed(NamedTuple):
    """One message, ready for the file."""

    topic: str
    time: int  # ns on the log's clock
    data: bytes
    momdp: tuple[bytes, int] | None = None  # digest and number of a new one


class End(NamedTuple):
    """The closing record: contents of a file, as its writer counted them."""

    trials: int = 0
    steps: int = 0
    cost: float = 0.0  # s, of all trials

    def after(self, added: Trial | TrialOutcomes) -> "End":
        """Count what comes next."""
        if isinstance(added, Trial):
            return End(self.trials + 1, self.steps + len(added.steps), self.cost + added.cost)
        steps = int(added.steps.sum())
        cost = math.fsum(added.cost.tolist())
        return End(self.trials + len(added), self.steps + steps, self.cost + cost)


def _momdp(trial: Trial) -> Any:
    """Return a message of a trial's MOMDP and the counts behind it, but for its number."""
    momdp = trial.momdp
    query = trial.momdp.query
    number_of = {i: number for number, group in enumerate(query.groups, start=1) for i in group}
    return schema.MomdpMessage(
        attributes=query.attributes,
        x_names=momdp.x_names,
        x_labels=momdp.x_labels,
        behavior_names=momdp.behavior_names,
        row_counts=_values(trial.counts),
        group=[number_of.get(i, 0) for i in range(len(query))] if query.groups else [],
        group_name=query.group_names,
        payoffs=momdp.payoffs or (),
        own_payoffs=query.payoffs is not None,
        literal=() if query.event is None else query.event.allowed,
        complement=query.event is not None and query.event.complement,
        **{name: getattr(momdp, name) for name in schema.MOMDP_NUMBERS},
        **{name: _values(getattr(momdp, name)) for name in schema.MOMDP_ARRAYS},
        bonus_limit=_values(momdp.bonus_limit),
        joint=() if momdp.joint is None else _values(momdp.joint),
    )


def encode_outcomes(outcomes: TrialOutcomes, first: int) -> bytes:
    """Pack outcomes; `first` is the number of their first trial in the file."""
    numbers: dict[str, int] = {}
    columns: dict[str, Any] = {
        name: [numbers.setdefault(text, len(numbers)) for text in getattr(outcomes, name).flat]
        for name in TEXTS
    }
    columns |= {name: _values(getattr(outcomes, name)) for name in INTEGERS | REALS}
    return _bytes(
        schema.OutcomesMessage(
            first=first,
            trials=len(outcomes),
            queried=outcomes.attribute.shape[1],
            texts=list(numbers),
            behaviors=outcomes.behaviors,
            **columns,
        )
    )


class TrialEncoder:
    """Packs one trial, by its number in the file: its start, its steps one by one, its outcome.

    `momdps` are the numbers of those in the file, by digest. It raises a `LogError` of arrays that
    do not fit each other, or are beyond the format's limits.
    """

    def __init__(self, number: int, momdps: schema.Momdps) -> None:
        self._number = number
        self._momdps = momdps
        self._steps = self._edges = self._size = 0
        self._features = 0  # that are logged

    def begin(self, trial: Trial) -> Iterator[Packed]:
        """Pack the start of a trial, after its MOMDP where that is new; its steps come later."""
        task = trial.task
        first = trial.first_belief
        self._trial = trial
        self._before = first
        self._check(start_misfits(trial), first)
        # Many trials share a MOMDP: it is written once, and named by its number from then on.
        message = _momdp(trial)
        digest = hashlib.blake2b(_bytes(message), digest_size=16).digest()
        last = max((number for number, _ in self._momdps.values()), default=-1)
        message.id, _ = self._momdps.get(digest, (last + 1, 0))
        if message.id > last:
            time = schema.log_time(self._number, 0)
            data = message.SerializeToString()
            yield Packed(schema.MOMDPS, time, data, (digest, message.id))
        start = schema.TrialMessage(
            trial=self._number,
            momdp=message.id,
            agent=trial.agent,
            attributes=task.query.attributes,
            key=task_key(task.key),
            truth=trial.truth.tolist(),
            test=not task.learn,
            **{name: getattr(task, name) for name in schema.TASK_VALUES},
            **_belief(first, replayed=not first.percept_counts.any()),
        )
        yield self._packed(schema.TRIAL, 0, start)

    def step(self, step: Step) -> Iterator[Packed]:
        """Pack the next step with a line of text."""
        momdp = self._trial.momdp
        index = self._steps
        decision = step.decision
        self._steps = index + 1
        self._edges = self._edges + len(decision.tree)
        self._check(step_misfits(step, momdp, index), step.belief)
        # Percept counts stand in the file only where they do not follow from action and percept.
        change = step.belief.percept_counts - self._before.percept_counts
        action = decision.action
        if step.observation is not None and action < momdp.n_behaviors:
            change[np.arange(len(change)), action, step.observation] -= 1
        self._before = step.belief
        report = momdp.reported(action) if action >= momdp.n_behaviors else None
        sensed, self._features = within_limits(step.sensed, self._features)
        message = schema.StepMessage(
            trial=self._number,
            step=index,
            action=min(action, momdp.n_behaviors),
            action_name=momdp.action_name(action),
            report=_values(report),
            legal=momdp.legal[step.x].tolist(),
            observation=_values(step.observation),
            simulations=decision.simulations,
            sampled_rows=_values(decision.sampled_rows),
            gap=() if decision.gap is None else (decision.gap,),
            bonus=_values(decision.bonus),
            **{name: getattr(step, name) for name in schema.STEP_VALUES},
            **{name: _values(getattr(decision, name)) for name in schema.DECISION_ARRAYS},
            **{
                f"tree_{name}": [getattr(edge, name) for edge in decision.tree]
                for name in schema.EDGE_VALUES
            },
            tree_observation_size=[len(edge.observation) for edge in decision.tree],
            tree_observation=[z for edge in decision.tree for z in edge.observation],
            **_belief(step.belief, replayed=not change.any()),
            **sensed_fields(sensed),
        )
        # The same in a line of text, for viewers of MCAP files that do not know our messages.
        line = schema.LogMessage(
            level=_WARNING if step.warning else _INFO,
            message=self._line(step, index),
            name=self._trial.agent,
        )
        line.timestamp.seconds = schema.log_time(self._number, index + 1) // 1_000_000_000
        yield self._packed(schema.STEP, index + 1, message)
        yield self._packed(schema.LINES, index + 1, line)

    def end(self, trial: Trial) -> Iterator[Packed]:
        """Pack the outcome."""
        report = _shape_misfits(report=(trial.report, (trial.momdp.query.report_size,)))
        self._check(report, trial.last_belief)
        outcome = schema.OutcomeMessage(
            trial=self._number,
            steps=len(trial.steps),
            report=_values(trial.report),
            success=judgment(trial),
            cost=trial.cost,
            reward=trial.reward,
            ended=trial.ended,
        )
        yield self._packed(schema.OUTCOME, self._steps + 1, outcome)

    def whole(self, trial: Trial) -> Iterator[Packed]:
        """Pack a trial that is whole."""
        return chain(self.begin(trial), *map(self.step, trial.steps), self.end(trial))

    def _check(self, problems: Iterator[str], belief: Belief) -> None:
        """Raise the first problem, or what is beyond the limits."""
        percepts = (1 + self._steps) * belief.percept_counts.size
        for problem in chain(problems, limit_misfits(percepts, self._edges)):
            raise LogError(f"Trial {self._number} cannot be logged: {problem}.")

    def _packed(self, topic: str, step: int, message: Any) -> Packed:
        """Pack a message, by its topic and the number of its step on the clock."""
        packed = Packed(topic, schema.log_time(self._number, step), _bytes(message))
        self._size += len(packed.data)
        if self._size > schema.TRIAL_LIMIT:
            raise LogError(
                f"Trial {self._number} takes {self._size} bytes; a log holds at most "
                f"{schema.TRIAL_LIMIT}."
            )
        return packed

    def _line(self, step: Step, index: int) -> str:
        momdp = self._trial.momdp
        percept = "none"
        if step.observation is not None:
            percept = " ".join(map(str, step.observation.tolist()))
        names = momdp.query.value_names[:_SHOWN]
        positive = step.belief.positive.tolist()
        belief = ", ".join(f"{name} {p:.3f}" for name, p in zip(names, positive, strict=False))
        more = ", ..." if len(positive) > _SHOWN else ""
        warning = f"; {step.warning}" if step.warning else ""
        return (
            f"trial {self._number} step {index}: {momdp.action_name(step.decision.action)}, "
            f"{momdp.x_names[step.x]} -> {momdp.x_names[step.next_x]}, {step.cost:g} s, "
            f"percept {percept}, belief {belief}{more}, reward {step.reward:g}{warning}"
        )


def _bytes(message: Any) -> bytes:
    data: bytes = message.SerializeToString()
    if len(data) > schema.MESSAGE_LIMIT:
        raise LogError(
            f"A {type(message).__name__} message takes {len(data)} bytes; a log holds at most "
            f"{schema.MESSAGE_LIMIT} in one (ask fewer attributes, or log fewer tree edges)."
        )
    return data


def _values(array: NDArray[Any] | None) -> list[Any]:
    return [] if array is None else array.ravel().tolist()


def _belief(belief: Belief, *, replayed: bool) -> dict[str, Any]:
    return {
        "belief_x": belief.x,
        "log_prob": _values(belief.log_prob),
        "positive": belief.positive.tolist(),
        "percept_counts": [] if replayed else _values(belief.percept_counts),
    }


def judgment(trial: Trial) -> int:
    """Return 1 where a trial's report is right, 0, or -1 where that is unknown."""
    return -1 if trial.success is None else int(trial.success)


def limit_misfits(percepts: int, edges: int) -> Iterator[str]:
    """Yield what is beyond the limits of a trial."""
    if percepts > schema.COUNT_LIMIT:
        yield f"its beliefs count more than {schema.COUNT_LIMIT} percepts"
    if edges > schema.EDGE_LIMIT:
        yield f"its search trees have more than {schema.EDGE_LIMIT} edges"


def start_misfits(trial: Trial) -> Iterator[str]:
    """Yield what does not fit in a trial, but for its steps."""
    momdp = trial.momdp
    n = len(momdp.query)
    e = momdp.n_behaviors
    most = max(n, e, len(momdp.x_names))
    if most > schema.NAME_LIMIT:
        yield f"the MOMDP has {most} attributes, behaviors or x, more than {schema.NAME_LIMIT}"
    if trial.task.query != momdp.query:
        yield f"the task asks {trial.task.query}, its MOMDP {momdp.query}"
    yield from _shape_misfits(
        truth=(trial.truth, (n,)),
        counts=(trial.counts, (n, e, 2, momdp.levels)),
        report=(trial.report, (momdp.query.report_size,)),
    )
    if not np.isin(trial.truth, (-1, 0, 1)).all():
        yield f"truth is {trial.truth.tolist()}, expected {n} of 1, 0 and -1"
    yield from _belief_misfits(trial.first_belief, momdp)


def step_misfits(step: Step, momdp: MOMDP, index: int) -> Iterator[str]:
    """Yield what in the step of this index does not fit its MOMDP."""
    n = len(momdp.query)
    e = momdp.n_behaviors
    k = momdp.levels
    decision = step.decision
    problems = list[str]()
    if not 0 <= decision.action < momdp.n_actions:
        answers = f"2^{n}"  # which may be a number of many digits
        if momdp.abstain:
            answers += " + 1"
        problems += [f"action {decision.action}, expected a number below {e} + {answers}"]
    percepts = step.observation
    rows = decision.sampled_rows
    # A reader would index arrays by these numbers: out of range they must not get in, or out.
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
        bonus=(decision.bonus, (e + 1,)),
        sampled_rows=(rows, (0 if rows is None else len(rows), n, k)),
        percepts=(percepts, (n,)),
    )
    problems += _belief_misfits(step.belief, momdp)
    yield from (f"step {index}: {problem}" for problem in problems)


def _belief_misfits(belief: Belief, momdp: MOMDP) -> Iterator[str]:
    n = len(momdp.query)
    log_prob = belief.log_prob
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

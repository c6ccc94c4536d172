"""Message bytes -> trials, each checked against its digest before it is believed."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Step, Task, Trial
from meal_bayes.arrays import freeze
from meal_bayes.domain import Query
from meal_bayes.errors import LogCorruptError, LogVersionError
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.trial_log.encode import digest, trial_digest
from meal_bayes.trial_log.schema import (
    FORMAT_VERSION,
    MOMDP_MEMORY,
    MOMDPS,
    NAME_LIMIT,
    OUTCOME,
    RUN,
    STEP,
    TRIAL,
    TRIAL_LIMIT,
    MomdpMessage,
    OutcomeMessage,
    RunMessage,
    StepMessage,
    TrialMessage,
)
from meal_bayes.trial_log.shapes import misfit

UNFINISHED = "the log ends here"  # why a trial without an outcome was broken off


class _Known(NamedTuple):
    momdp: MOMDP
    digest: bytes


@dataclass
class TrialBuilder:
    """Puts the messages of a file together again; what it has counted stays to be asked."""

    header: dict[str, object] | None = None
    trials: int = 0
    steps: int = 0
    chain: bytes = b""  # digest over all trials so far
    _momdps: dict[int, _Known] = field(default_factory=dict)
    _open: list[bytes] = field(default_factory=list)  # start and steps of the trial under way
    _size: int = 0  # their bytes

    def add(self, topic: str, data: bytes) -> Trial | None:
        """Take the next message; give the trial that it completes."""
        if topic == RUN:
            self.header = decode_header(data)
        elif topic == MOMDPS:
            message = _parse(MomdpMessage, data)
            self._momdps[message.id] = _Known(_momdp(message), digest((data,)))
            self._momdps.pop(message.id - MOMDP_MEMORY, None)
        elif topic == TRIAL:
            self._check_closed()
            self._keep(data)
        elif topic == STEP:
            if not self._open:
                raise LogCorruptError("a step has no trial")
            self._keep(data)
        elif topic == OUTCOME:
            return self._finish(data)
        return None

    def check_end(self, end: Mapping[str, str]) -> None:
        """Compare with what the writer said when it had written the last trial."""
        if self._open:
            steps = len(self._open) - 1
            raise LogCorruptError(f"a trial has no outcome; {steps} of its steps can be recovered")
        if not end:
            raise LogCorruptError("the closing record of the writer is missing")
        found = {"trials": str(self.trials), "steps": str(self.steps), "digest": self.chain.hex()}
        if found != end:
            raise LogCorruptError(f"the trials are not those that were written ({found}, {end})")

    def _check_closed(self) -> None:
        if self._open:
            raise LogCorruptError("a trial has no outcome")

    def unfinished(self) -> Trial | None:
        """Return the trial under way as far as it went, with `ended`; None where there is none."""
        if not self._open:
            return None
        start, *steps = self._open
        begin = _parse(TrialMessage, start)
        known = self._momdps.get(begin.momdp)
        if known is None:
            raise LogCorruptError(f"trial {begin.trial} refers to a MOMDP that is not there")
        outcome = OutcomeMessage(trial=begin.trial, steps=len(steps), ended=UNFINISHED)
        return _trial(begin, [_parse(StepMessage, step) for step in steps], outcome, known.momdp)

    def drop(self) -> None:
        """Forget the trial under way."""
        self._open, self._size = [], 0

    def _keep(self, data: bytes) -> None:
        self._open.append(data)
        self._size += len(data)
        if self._size > TRIAL_LIMIT:
            raise LogCorruptError(f"a trial is longer than {TRIAL_LIMIT} bytes")

    def _finish(self, data: bytes) -> Trial:
        if not self._open:
            raise LogCorruptError("an outcome has no trial")
        start, *steps = self._open
        self.drop()
        begin, outcome = _parse(TrialMessage, start), _parse(OutcomeMessage, data)
        known = self._momdps.get(begin.momdp)
        if known is None:
            raise LogCorruptError(f"trial {begin.trial} refers to a MOMDP that is not there")
        if trial_digest(known.digest, start, steps, outcome) != outcome.digest:
            raise LogCorruptError(f"trial {begin.trial} was changed (its digest differs)")
        trial = _trial(begin, [_parse(StepMessage, step) for step in steps], outcome, known.momdp)
        self.trials += 1
        self.steps += len(steps)
        self.chain = digest((self.chain, data))
        return trial


def decode_header(data: bytes) -> dict[str, object]:
    """Read the run message.

    Raises
    ------
    LogVersionError : the file was written in another format version.
    """
    message = _parse(RunMessage, data)
    header = json.loads(message.header)
    if not isinstance(header, dict):
        raise LogCorruptError("the header is no table of names and values")
    if message.format_version != FORMAT_VERSION:
        versions = header.get("versions")
        writer = versions.get("meal_bayes") if isinstance(versions, dict) else None
        wanted = f"=={writer}" if writer else ""
        raise LogVersionError(
            f"written in log format {message.format_version}, this meal_bayes reads format "
            f"{FORMAT_VERSION}; read it with the version that wrote it (pip install "
            f"'meal-bayes{wanted}') or run its configuration again"
        )
    return header


def _parse(kind: Any, data: bytes) -> Any:
    message = kind()
    message.ParseFromString(data)
    return message


def _array(values: Iterable[Any], shape: Sequence[int], dtype: Any = np.float64) -> NDArray[Any]:
    return np.array(list(values), dtype=dtype).reshape(shape)


def _momdp(message: Any) -> MOMDP:
    names = (message.attributes, message.behavior_names, message.x_names)
    n, e, x = (len(column) for column in names)
    if not all(0 < count <= NAME_LIMIT for count in (n, e, x)):
        raise LogCorruptError(f"a MOMDP has {n} attributes, {e} behaviors and {x} x")
    counts = _array(message.counts, (n, e, 2, -1)) if message.counts else None
    kinds = _array(message.kinds, (n, 2, -1))
    c = kinds.shape[2]
    return MOMDP(
        query=Query(tuple(message.attributes)),
        x_names=tuple(message.x_names),
        behavior_names=tuple(message.behavior_names),
        start=message.start,
        transition=_array(message.transition, (e, x, x)),
        informative=_array(message.informative, (e, x, x)),
        legal=_array(message.legal, (x, e), np.bool_),
        confusion=_array(message.confusion, (n, e, c, -1)),
        precision=_array(message.precision, (n, e, c)),
        prior=_array(message.prior, (n,)),
        cost=_array(message.cost, (e,)),
        correct=message.correct,
        incorrect=message.incorrect,
        bonus=_array(message.bonus, (n, e, 2)),
        limit=_array(message.limit, (e,)),
        kinds=kinds,
        discount=message.discount,
        abstain=message.abstain,
        additive=message.additive,
        counts=counts,  # type: ignore[arg-type]  # zeros by default
    )


def _trial(begin: Any, messages: list[Any], outcome: Any, momdp: MOMDP) -> Trial:
    order = [(message.trial, message.step) for message in messages]
    if order != [(begin.trial, index) for index in range(outcome.steps)]:
        raise LogCorruptError(f"the steps of trial {begin.trial} are not in order")
    nothing = np.zeros((len(momdp.query), momdp.n_behaviors, momdp.levels), int)
    belief = _belief(begin, nothing, momdp)
    first, steps = belief, list[Step]()
    for message in messages:
        steps.append(_step(message, momdp, belief))
        belief = steps[-1].belief
    trial = Trial(
        task=Task(
            name=begin.name,
            query=Query(tuple(begin.attributes)),
            object_index=begin.object_index,
            object_name=begin.object_name,
            key=tuple(json.loads(begin.key)),
        ),
        agent=begin.agent,
        momdp=momdp,
        first_belief=first,
        steps=tuple(steps),
        truth=np.array(list(begin.truth), dtype=np.int8),
        report=np.array(list(outcome.report), dtype=np.bool_) if outcome.report else None,
        ended=outcome.ended,
    )
    problem = misfit(trial)
    if problem is not None:
        raise LogCorruptError(f"trial {begin.trial}: {problem}")
    return trial


def _belief(message: Any, replayed: NDArray[Any], momdp: MOMDP) -> Belief:
    """Read a belief; percept counts stand in the file only where replay does not give them."""
    seen = _array(message.seen, replayed.shape, np.int64) if message.seen else replayed
    weight = _array(message.weight, (len(replayed), -1))
    return Belief(message.belief_x, weight, seen, momdp.log_share)


def _step(message: Any, momdp: MOMDP, before: Belief) -> Step:
    n, e, k = before.seen.shape
    levels = list(message.observation)
    if levels and not (len(levels) == n and 0 <= min(levels) <= max(levels) < k <= 127):  # noqa: PLR2004  int8
        raise LogCorruptError(f"percepts {levels}, expected {n} levels below {k}")
    action = message.action
    seen = before.seen
    if action >= e:
        if len(message.report) != n:
            raise LogCorruptError(f"a report of {len(message.report)} values, expected {n}")
        action = e + momdp.query.index_of(message.report)
    elif levels:
        seen = seen.copy()
        seen[np.arange(n), action, levels] += 1
    return Step(
        x=message.x,
        decision=Decision(
            action=action,
            values=np.array(list(message.values), dtype=np.float64),
            value_se=np.array(list(message.value_se), dtype=np.float64),
            visits=np.array(list(message.visits), dtype=np.int64),
            tree=_tree(message),
            simulations=message.simulations,
        ),
        next_x=message.next_x,
        observation=freeze(levels, np.int8) if levels else None,
        cost=message.cost,
        reward=message.reward,
        belief=_belief(message, seen, momdp),
        warning=message.warning,
    )


def _tree(message: Any) -> tuple[TreeEdge, ...]:
    levels, edges, at = list(message.tree_observation), list[TreeEdge](), 0
    columns = zip(
        message.tree_level,
        message.tree_parent,
        message.tree_action,
        message.tree_observation_size,
        message.tree_visits,
        message.tree_value,
        strict=True,
    )
    for level, parent, action, size, visits, value in columns:
        observation = tuple(levels[at : at + size])
        at += size
        edges.append(TreeEdge(level, parent, action, observation, visits, value))
    if at != len(levels):
        raise LogCorruptError("a search tree's percepts do not fit its edges")
    return tuple(edges)

"""Trial -> message bytes: one start, the steps with a line of text each, one outcome."""

import hashlib
import json
import struct
from collections.abc import Iterable
from itertools import chain
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Step, Trial
from meal_bayes.errors import LogError
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.planners import TreeEdge
from meal_bayes.trial_log.picture import ConfusionPictures
from meal_bayes.trial_log.schema import (
    FORMAT_VERSION,
    LINES,
    MESSAGE_LIMIT,
    OUTCOME,
    PICTURES,
    STEP,
    TRIAL,
    TRIAL_LIMIT,
    ImageMessage,
    LogMessage,
    MomdpMessage,
    OutcomeMessage,
    StepMessage,
    TrialMessage,
    log_time,
)
from meal_bayes.trial_log.shapes import misfit

_SHOWN = 6  # attributes in a line of text
_INFO = 2  # the level of foxglove.Log
_ARRAYS = ("transition", "informative", "legal", "confusion", "precision")
_VECTORS = ("prior", "kinds", "cost", "bonus", "limit")


class Packed(NamedTuple):
    """One message, ready for the file."""

    topic: str
    time: int  # ns on the log's clock
    data: bytes


def digest(parts: Iterable[bytes]) -> bytes:
    """Digest of byte strings; it names the format version, so no other version's can pass."""
    state = hashlib.blake2b(digest_size=16, person=f"meal_bayes/{FORMAT_VERSION}".encode())
    for part in parts:
        state.update(struct.pack("<Q", len(part)))
        state.update(part)
    return state.digest()


def trial_digest(momdp: bytes, start: bytes, steps: Iterable[bytes], outcome: Any) -> bytes:
    """Digest of a trial: its MOMDP's digest, its messages, and what its outcome says."""
    numbers = struct.pack(
        "<qq?dd", outcome.trial, outcome.steps, outcome.success, outcome.cost, outcome.reward
    )
    return digest((momdp, start, *steps, bytes(outcome.report), numbers))


def encode_momdp(momdp: MOMDP) -> bytes:
    """Pack a MOMDP, without its number in the file."""
    fields = {name: getattr(momdp, name).ravel().tolist() for name in (*_ARRAYS, *_VECTORS)}
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
            additive=momdp.additive,
            counts=_counts(momdp),
            **fields,
        )
    )


def _counts(momdp: MOMDP) -> list[float]:
    """Percepts behind the rows; nothing is written where there are none."""
    return momdp.counts.ravel().tolist() if momdp.counts.any() else []


def numbered(number: int, momdp: bytes) -> bytes:
    """Give a packed MOMDP its number in the file (protobuf messages join by concatenation)."""
    prefix: bytes = MomdpMessage(id=number).SerializeToString()
    return prefix + momdp


def encode_trial(
    trial: Trial,
    number: int,
    momdp: int,
    momdp_digest: bytes,
    pictures: ConfusionPictures | None = None,
) -> list[Packed]:
    """Pack a trial; its MOMDP is the file's number `momdp`.

    Where another behavior is done than the step before, its picture comes along, for other tools.

    Raises
    ------
    LogError : the arrays do not fit each other, or the trial is beyond the format's limits.
    """
    problem = misfit(trial)
    if problem is not None:
        raise LogError(f"Trial {number} cannot be logged: {problem}.")
    start = _bytes(_start(trial, number, momdp))
    seen = _seen_beside_replay(trial)
    positive = _positive([step.belief for step in trial.steps], trial.momdp)
    packed, steps, shown = [Packed(TRIAL, log_time(number, 0), start)], list[bytes](), -1
    for index, step in enumerate(trial.steps):
        belief = positive[index].tolist()
        data = _bytes(_step(step, trial.momdp, number, index, belief, seen.get(index, [])))
        time = log_time(number, index + 1)
        steps.append(data)
        packed.append(Packed(STEP, time, data))
        packed.append(Packed(LINES, time, _line(trial, step, number, index, belief, time)))
        action = step.decision.action
        if pictures is not None and action != shown and action < trial.momdp.n_behaviors:
            picture = pictures.of(trial.momdp, momdp, action)
            packed.append(Packed(PICTURES, time, _timed(picture, time)))
            shown = action
    outcome = _outcome(trial, number)
    outcome.digest = trial_digest(momdp_digest, start, steps, outcome)
    packed.append(Packed(OUTCOME, log_time(number, len(steps) + 1), _bytes(outcome)))
    size = sum(len(message.data) for message in packed)
    if size > TRIAL_LIMIT:
        raise LogError(f"Trial {number} takes {size} bytes; a log holds at most {TRIAL_LIMIT}.")
    return packed


def _bytes(message: Any) -> bytes:
    data: bytes = message.SerializeToString()
    if len(data) > MESSAGE_LIMIT:
        raise LogError(
            f"A {type(message).__name__} message takes {len(data)} bytes; a log holds at most "
            f"{MESSAGE_LIMIT} in one message (log fewer edges of the search tree)."
        )
    return data


def _positive(beliefs: list[Belief], momdp: MOMDP) -> NDArray[np.float64]:
    """Pr(attribute is true) of all beliefs at once, (T,N)."""
    if not beliefs:
        return np.zeros((0, 0))
    weight = np.array([belief.weight for belief in beliefs])[:, :, None]  # (T,N,1,C)
    with np.errstate(over="ignore", invalid="ignore"):
        of_truth = np.logaddexp.reduce(weight + momdp.log_share, axis=3)  # (T,N,2)
        return np.asarray(1.0 / (1.0 + np.exp(of_truth[..., 0] - of_truth[..., 1])))


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
        key=json.dumps([part if isinstance(part, str) else int(part) for part in task.key]),
        truth=trial.truth.tolist(),
        belief_x=first.x,
        weight=first.weight.ravel().tolist(),
        positive=_positive([first], trial.momdp)[0].tolist(),
        seen=first.seen.ravel().tolist() if first.seen.any() else [],
    )


def _seen_beside_replay(trial: Trial) -> dict[int, list[int]]:
    """Percept counts of the steps where actions and percepts do not already tell them."""
    beliefs = (trial.first_belief, *(step.belief for step in trial.steps))
    change = np.diff(np.array([belief.seen for belief in beliefs]), axis=0)  # (T,N,E,K)
    told_by = [
        (index, step.decision.action, step.observation)
        for index, step in enumerate(trial.steps)
        if step.observation is not None and step.decision.action < trial.momdp.n_behaviors
    ]
    if told_by:
        at, action, levels = (np.array(column) for column in zip(*told_by, strict=True))
        change[at[:, None], np.arange(len(trial.truth)), action[:, None], levels] -= 1
    told = change.any(axis=(1, 2, 3))
    return {int(i): trial.steps[i].belief.seen.ravel().tolist() for i in np.flatnonzero(told)}


def _step(
    step: Step, momdp: MOMDP, trial: int, index: int, positive: list[float], seen: list[int]
) -> Any:
    decision, e = step.decision, momdp.n_behaviors
    report = momdp.query.values_of(decision.action - e).tolist() if decision.action >= e else ()
    return StepMessage(
        trial=trial,
        step=index,
        x=step.x,
        action=min(decision.action, e),
        action_name=momdp.action_name(decision.action),
        report=report,
        legal=momdp.legal[step.x].tolist(),
        next_x=step.next_x,
        observation=() if step.observation is None else step.observation.tolist(),
        cost=step.cost,
        reward=step.reward,
        values=decision.values.tolist(),
        value_se=decision.value_se.tolist(),
        visits=decision.visits.tolist(),
        simulations=decision.simulations,
        belief_x=step.belief.x,
        weight=step.belief.weight.ravel().tolist(),
        positive=positive,
        seen=seen,
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
        success=trial.success,
        cost=trial.cost,
        reward=trial.reward,
    )


def _timed(picture: bytes, time: int) -> bytes:
    """Give a packed picture its time (protobuf messages join by concatenation)."""
    stamp = ImageMessage()
    stamp.timestamp.seconds = time // 1_000_000_000
    prefix: bytes = stamp.SerializeToString()
    return prefix + picture


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
    line = LogMessage(level=_INFO, message=text, name=trial.agent)
    line.timestamp.seconds = time // 1_000_000_000
    return _bytes(line)

"""The messages of a log: a frozen dataclass for each, written as JSON with a JSON schema.

To log one more thing, add a field to the dataclass of its message. A field with the name of an
attribute of the object (`Step`, `Decision`, `MOMDP`, `Task`, `TrialOutcomes`) is filled in from
that attribute and read back into it. Raise `FORMAT_VERSION` where a reader of the version before
would go wrong.

Numbers are JSON numbers of full precision, with two exceptions, as JSON has no others: NaN is
`null`, and infinity is `"Infinity"` or `"-Infinity"`. An array of one axis is a list; an array of
more axes is its `shape` and its `values` in C order.
"""

import hashlib
import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import chain
from operator import attrgetter
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, get_args

import msgspec
import numpy as np
from msgspec import UNSET, Meta, UnsetType
from numpy.typing import NDArray

from meal_bayes import untrusted
from meal_bayes.arrays import freeze
from meal_bayes.datasets import Instance
from meal_bayes.domain import Event, Payoffs, Query
from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.momdp import MOMDP, Belief, belief_of
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.seeds import Key
from meal_bayes.trials import Step, Task, Trial, TrialOutcomes, task_key

FORMAT_VERSION = 7

# Both sides keep to these limits, so that a damaged length can never ask for much memory.
FEATURE_LIMIT = 1_000_000  # features of one step; of a step that has more none are logged
TRIAL_FEATURES = 8_000_000  # of a trial; of the steps beyond so many none are logged
_FEATURE_BYTES = 16  # at most, in JSON


def _room(features: int) -> int:
    """Return bytes that hold features, and as much beside them; a power of two.

    >>> _room(1_000_000) == 32 << 20
    True
    """
    return 2 << (_FEATURE_BYTES * features - 1).bit_length()


MESSAGE_LIMIT = _room(FEATURE_LIMIT)  # bytes of one message, such as a step
RECORD_LIMIT = 2 * MESSAGE_LIMIT  # bytes of one MCAP record, packed or unpacked
TRIAL_LIMIT = _room(TRIAL_FEATURES)  # bytes of one trial
NAME_LIMIT = untrusted.NAME_LIMIT  # attributes, behaviors, or x of one MOMDP; labels of a telling
EDGE_LIMIT = 250_000  # edges of the search trees of one trial
COUNT_LIMIT = 4_000_000  # percept counts (N,E,K) of all beliefs of one trial

MOMDP_MEMORY = 256  # a trial may refer to this many of the newest MOMDPs,
MOMDP_BYTES = 64 << 20  # as far as their messages have this many bytes

_SECOND = 1_000_000_000  # ns
_TRIAL_SPAN = 1000  # s between the starts of two trials on the log's clock
_SHOWN = 6  # attributes in a line of text

RUN = "/run"
MOMDPS = "/momdp"
TRIAL = "/trial"
STEP = "/step"
OUTCOME = "/outcome"
OUTCOMES = "/outcomes"  # of the compact form: columns of many trials in one message
FEEDBACK = "/feedback"  # of the form of that name: one message, of this topic or the next
CHANGE = "/change"
LINES = "/log"  # for other tools; reading takes nothing from it

_INFINITE = {math.inf: "Infinity", -math.inf: "-Infinity"}

# Foxglove looks at "type" alone; a validator of this draft looks at "$ref" alone.
_DRAFT = "http://json-schema.org/draft-07/schema#"
_NUMBER = {"$ref": "#/definitions/number", "type": "number"}
_DEFINITIONS = {
    "number": {
        "description": "NaN is null.",
        "anyOf": [{"type": "number"}, {"type": "null"}, {"enum": sorted(_INFINITE.values())}],
    }
}
_WHOLE = {"type": "integer"}


def _list_of(items: dict[str, Any]) -> Meta:
    return Meta(extra_json_schema={"type": "array", "items": items})


def _grid_of(items: dict[str, Any]) -> Meta:
    properties = {
        "shape": {"type": "array", "items": _WHOLE},
        "values": {"type": "array", "items": items},
    }
    required = list(properties)
    return Meta(
        extra_json_schema={"type": "object", "properties": properties, "required": required}
    )


_FloatArray = np.ndarray[Any, np.dtype[np.float64]]
_IntArray = np.ndarray[Any, np.dtype[np.int64]]
_SmallArray = np.ndarray[Any, np.dtype[np.int8]]
_BoolArray = np.ndarray[Any, np.dtype[np.bool_]]
_TextArray = np.ndarray[Any, np.dtype[np.object_]]
# Types of fields: a list has one axis, a grid more.
Floats = Annotated[_FloatArray, _list_of(_NUMBER)]
FloatGrid = Annotated[_FloatArray, _grid_of(_NUMBER)]
Features = Annotated[np.ndarray[Any, np.dtype[np.float32]], _list_of(_NUMBER)]
Ints = Annotated[_IntArray, _list_of(_WHOLE)]
IntGrid = Annotated[_IntArray, _grid_of(_WHOLE)]
Labels = Annotated[_SmallArray, _list_of(_WHOLE)]
LabelGrid = Annotated[_SmallArray, _grid_of(_WHOLE)]
Bools = Annotated[_BoolArray, _list_of({"type": "boolean"})]
BoolGrid = Annotated[_BoolArray, _grid_of({"type": "boolean"})]
Texts = Annotated[_TextArray, _list_of({"type": "string"})]
TextGrid = Annotated[_TextArray, _grid_of({"type": "string"})]
Real = Annotated[
    float | Literal["Infinity", "-Infinity"] | None, Meta(extra_json_schema=_NUMBER)
]  # fmt: skip
Header = Annotated[dict[str, Any], Meta(extra_json_schema={"properties": {}})]
_KINDS = {np.int64: "i", np.int8: "i", np.bool_: "b"}  # of arrays of whole numbers and of truths


@dataclass(frozen=True, slots=True)
class RunMessage:
    """What the run was: settings, seed, versions."""

    format_version: int
    header: Header


@dataclass(frozen=True, slots=True)
class GroupPart:
    """Attributes of which exactly one is true, by their places in the query."""

    name: str
    indices: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class MomdpMessage:
    """A decision problem, once for all trials that share it; the fields are those of `MOMDP`."""

    id: int
    attributes: tuple[str, ...]
    groups: tuple[GroupPart, ...]
    x_names: tuple[str, ...]
    x_labels: tuple[str, ...]
    behavior_names: tuple[str, ...]
    start: int
    transition: FloatGrid
    observation_probability: FloatGrid
    legal: BoolGrid
    confusion: FloatGrid
    precision: FloatGrid
    prior: Floats
    latent_classes: FloatGrid
    cost: Floats
    correct: float
    incorrect: float
    bonus: FloatGrid
    bonus_limit: Floats
    limit: Floats
    discount: float
    abstain: bool
    own_payoffs: bool  # whether the question itself says what its answers earn
    payoffs: tuple[float, ...] | UnsetType = UNSET
    joint: Floats | UnsetType = UNSET
    event: Event | UnsetType = UNSET
    row_counts: FloatGrid | UnsetType = UNSET  # `Trial.counts`

    @classmethod
    def of(cls, trial: Trial, number: int) -> "MomdpMessage":
        """Return the message of a trial's problem and the counts behind it."""
        query = trial.momdp.query
        values = {
            **_values_for(cls, trial.momdp),
            **_values_for(cls, query),
            "groups": tuple(map(GroupPart, query.group_names, query.groups)),
            "payoffs": UNSET if trial.momdp.payoffs is None else trial.momdp.payoffs,
            "own_payoffs": query.payoffs is not None,
            "row_counts": UNSET if trial.counts is None else trial.counts,
        }
        return cls(id=number, **values)

    def read(self) -> tuple[MOMDP, NDArray[np.float64] | None]:
        """Return the problem, and the counts behind it."""
        n, e, x = map(len, (self.attributes, self.behavior_names, self.x_names))
        if not all(0 < count <= NAME_LIMIT for count in (n, e, x)):
            raise LogCorruptError(f"a MOMDP has {n} attributes, {e} behaviors and {x} x")
        payoffs = None if isinstance(self.payoffs, UnsetType) else Payoffs.of(self.payoffs)
        query = Query(
            self.attributes,
            tuple(group.indices for group in self.groups),
            tuple(group.name for group in self.groups),
            None if isinstance(self.event, UnsetType) else self.event,
            payoffs if self.own_payoffs else None,
        )
        momdp = MOMDP(**{**_values_of(self, MOMDP), "query": query, "payoffs": payoffs})
        return momdp, None if isinstance(self.row_counts, UnsetType) else self.row_counts


@dataclass(frozen=True, slots=True)
class BeliefPart:
    """A belief. Percept counts are there where they do not follow from action and percept."""

    x: int
    log_prob: FloatGrid
    positive: Floats
    percept_counts: IntGrid | UnsetType = UNSET

    @classmethod
    def of(cls, belief: Belief, *, replayed: bool) -> "BeliefPart":
        """Return the message of a belief, without percept counts where a reader replays them."""
        values = _values_for(cls, belief)
        return cls(**(values | {"percept_counts": UNSET} if replayed else values))

    def read(self, replayed: NDArray[np.int64], momdp: MOMDP) -> Belief:
        """Return the belief; `replayed` are the percept counts (N,E,K) where none are written."""
        counts = replayed if isinstance(self.percept_counts, UnsetType) else self.percept_counts
        shape = (len(momdp.query), momdp.n_classes)
        if self.log_prob.shape != shape or counts.shape != replayed.shape:
            raise LogCorruptError(
                f"a belief of shapes {self.log_prob.shape} and {counts.shape}, expected {shape} "
                f"and {replayed.shape}"
            )
        return belief_of(momdp, self.x, self.log_prob, counts)


@dataclass(frozen=True, slots=True)
class TrialMessage:
    """The start of a trial: question, object, agent, truth if known, first belief."""

    trial: int
    momdp: int
    agent: str
    name: str
    attributes: tuple[str, ...]
    object_index: int
    object_name: str
    key: str  # of the task, in JSON
    truth: Labels
    belief: BeliefPart
    test: bool

    @classmethod
    def of(cls, trial: Trial, number: int, momdp: int) -> "TrialMessage":
        """Return the message of a trial by its number, and that of its problem."""
        first = trial.first_belief
        values = _values_for(cls, trial.task) | {"key": task_key(trial.task.key)}
        return cls(
            trial=number,
            momdp=momdp,
            agent=trial.agent,
            attributes=trial.task.query.attributes,
            truth=trial.truth,
            belief=BeliefPart.of(first, replayed=not first.percept_counts.any()),
            test=not trial.task.learn,
            **values,
        )

    def read_task(self, query: Query) -> Task:
        """Return the task; of the query it has the attributes."""
        query = replace(query, attributes=self.attributes)
        values = _values_of(self, Task) | {"query": query, "key": read_key(self.key)}
        return Task(**values, learn=not self.test)


@dataclass(frozen=True, slots=True)
class EdgePart:
    """An edge of the search tree; the fields are those of `TreeEdge`, in their order."""

    level: int
    parent: int
    action: int
    observation: tuple[int, ...]
    visits: int
    value: Real
    bonus: Real


@dataclass(frozen=True, slots=True)
class FeaturePart:
    """Features of one modality."""

    modality: str
    values: Features


@dataclass(frozen=True, slots=True)
class PerceptPart:
    """What a detector says of one attribute: a score, or from -1 (surely no) to 1 (surely yes)."""

    attribute: str
    value: float


@dataclass(frozen=True, slots=True)
class SensedPart:
    """What a robot sensed in a step, of which nothing is recorded elsewhere."""

    recording: int
    features: tuple[FeaturePart, ...]
    percepts: tuple[PerceptPart, ...]
    scores: tuple[PerceptPart, ...]

    @classmethod
    def of(cls, sensed: Instance | None) -> "SensedPart | UnsetType":
        """Return the message of what was sensed; nothing of a replay."""
        if sensed is None:
            return UNSET
        features = (sensed.features or {}).items()
        percepts = (sensed.percepts or {}).items()
        scores = (sensed.scores or {}).items()
        return cls(
            sensed.recording,
            tuple(FeaturePart(name, values) for name, values in features),
            tuple(PerceptPart(name, value) for name, value in percepts),
            tuple(PerceptPart(name, value) for name, value in scores),
        )

    def read(self, behavior: str) -> Instance:
        """Return what was sensed by a behavior."""
        features = {part.modality: freeze(part.values, np.float32) for part in self.features}
        percepts = {part.attribute: part.value for part in self.percepts}
        scores = {part.attribute: part.value for part in self.scores}
        finite = all(values.size and np.isfinite(values).all() for values in features.values())
        finite &= all(map(math.isfinite, scores.values()))
        if not finite or not all(-1 <= sure <= 1 for sure in percepts.values()):
            raise LogCorruptError(f"what {behavior} sensed is empty, or beyond its range")
        return Instance(
            -1, behavior, self.recording, features or None, percepts or None, scores or None
        )


@dataclass(frozen=True, slots=True)
class StepMessage:
    """An executed action; other fields than below are those of `Step` and of `Decision`."""

    trial: int
    step: int
    x: int
    next_x: int
    action: int  # the number of behaviors where it is an answer
    action_name: str
    legal: Bools
    cost: float
    reward: Real
    values: Floats
    value_se: Floats
    visits: Ints
    simulations: int
    tree: tuple[EdgePart, ...]
    belief: BeliefPart
    warning: str
    observation: Labels | UnsetType = UNSET
    report: Bools | UnsetType = UNSET  # of an answer; none where it abstains
    bonus: Floats | UnsetType = UNSET
    gap: Real | UnsetType = UNSET
    sampled_rows: FloatGrid | UnsetType = UNSET
    sensed: SensedPart | UnsetType = UNSET

    @classmethod
    def of(
        cls, step: Step, momdp: MOMDP, *, trial: int, number: int, replayed: bool
    ) -> "StepMessage":
        """Return the message of a step by its number in a trial; `replayed` as in `BeliefPart`."""
        decision = step.decision
        action = decision.action
        report = momdp.reported(action) if action >= momdp.n_behaviors else None
        values = {
            **_values_for(cls, step),
            **_values_for(cls, decision),
            "action": min(action, momdp.n_behaviors),
            "action_name": momdp.action_name(action),
            "report": UNSET if report is None else report,
            "legal": momdp.legal[step.x],
            "tree": tuple(EdgePart(*map(_as_real, edge)) for edge in decision.tree),
            "belief": BeliefPart.of(step.belief, replayed=replayed),
            "sensed": SensedPart.of(step.sensed),
        }
        return cls(trial=trial, step=number, **values)

    def read(self, momdp: MOMDP, before: Belief) -> Step:
        """Return the step after a belief."""
        e = momdp.n_behaviors
        counts = before.percept_counts
        action = self.action
        if action >= e:
            action = momdp.abstention
            if not isinstance(self.report, UnsetType):
                if self.report.shape != (momdp.query.report_size,):
                    raise LogCorruptError(f"a report of {self.report.size} values")
                action = e + momdp.query.report_index(self.report)
            elif not momdp.abstain:
                raise LogCorruptError("an answer without a report")
        elif not isinstance(self.observation, UnsetType):
            counts = counts + _counted(counts.shape, action, self.observation)
        sensed = None
        if not isinstance(self.sensed, UnsetType):
            if action >= e:
                raise LogCorruptError("an answer has sensed something")
            sensed = self.sensed.read(momdp.action_name(action))
        decision = Decision(
            **_values_of(self, Decision)
            | {"action": action, "tree": tuple(map(_edge, self.tree)), "momdp": momdp}
        )
        return Step(
            **_values_of(self, Step)
            | {
                "decision": decision,
                "belief": self.belief.read(counts, momdp),
                "sensed": sensed,
            }
        )


@dataclass(frozen=True, slots=True)
class OutcomeMessage:
    """What came of a trial."""

    trial: int
    steps: int
    success: int  # 1, 0, or -1 where it is not known
    cost: float
    reward: Real
    ended: str
    report: Bools | UnsetType = UNSET

    @classmethod
    def of(cls, trial: Trial, number: int) -> "OutcomeMessage":
        """Return the message of a trial by its number."""
        values = _values_for(cls, trial) | {"steps": len(trial.steps), "success": judgment(trial)}
        return cls(trial=number, **values)


@dataclass(frozen=True, slots=True)
class OutcomesMessage:
    """Outcomes of many trials, a row for each trial; the columns are those of `TrialOutcomes`."""

    first: int  # number of the first trial in the file
    behaviors: tuple[str, ...]
    agent: Texts
    key: Texts
    object_index: Ints
    object_name: Texts
    attribute: TextGrid
    truth: LabelGrid
    report: LabelGrid
    positive: FloatGrid
    cost: Floats
    reward: Floats
    ended: Texts
    steps: Ints
    executed: IntGrid
    failed: IntGrid
    certainty: Floats

    @classmethod
    def of(cls, outcomes: TrialOutcomes, first: int) -> "OutcomesMessage":
        """Return the message of outcomes by the number of their first trial."""
        return cls(first=first, **_values_for(cls, outcomes))

    def read(self) -> TrialOutcomes:
        """Return the outcomes."""
        if self.first < 0 or max(self.attribute.shape[-1], len(self.behaviors)) > NAME_LIMIT:
            raise LogCorruptError(f"outcomes {self.first} of shape {self.attribute.shape}")
        return TrialOutcomes(**_values_of(self, TrialOutcomes))


@dataclass(frozen=True, slots=True)
class LabelPart:
    """What was told of one attribute: 1 true, 0 false, -1 taken back."""

    attribute: str
    label: int


@dataclass(frozen=True, slots=True)
class UnderWayPart:
    """A trial that was under way when something was told, and how far it was."""

    key: str  # of the trial's task, in JSON
    steps: int


@dataclass(frozen=True, slots=True)
class FeedbackMessage:
    """What a person told of a trial when that was over, or of an object by its name."""

    object_name: str
    key: str  # of the trial's task, in JSON; "" where the object was named
    labels: tuple[LabelPart, ...]
    recordings: bool  # whether what the trial recorded was forgotten
    under_way: tuple[UnderWayPart, ...] = ()


@dataclass(frozen=True, slots=True)
class ChangeMessage:
    """A change of a learner that no trial shows; the fields are those of `Change`."""

    agent: str  # name of the agent that decides from now on
    digest: str  # of that agent
    before: str  # digest of the agent that decided until then
    used: bool  # whether anything was learned for that one
    refit: bool
    added: str = ""  # the attribute, or group, that was added
    values: tuple[str, ...] = ()  # of the group
    under_way: tuple[UnderWayPart, ...] = ()


@dataclass(frozen=True, slots=True)
class TimePart:
    """A time on the log's clock."""

    sec: int
    nsec: int


_LEVELS = ("UNKNOWN", "DEBUG", "INFO", "WARNING", "ERROR", "FATAL")  # of foxglove.Log
_Level = Annotated[
    int,
    Meta(
        extra_json_schema={
            "oneOf": [{"title": word, "const": value} for value, word in enumerate(_LEVELS)]
        }
    ),
]


@dataclass(frozen=True, slots=True)
class LineMessage:
    """A step as a line of text (foxglove.Log), which viewers show; readers of ours skip it."""

    timestamp: TimePart
    level: _Level
    message: str
    name: str
    file: str = ""
    line: int = 0


Message = (
    RunMessage | MomdpMessage | TrialMessage | StepMessage | OutcomeMessage | OutcomesMessage
    | FeedbackMessage | ChangeMessage | LineMessage
)  # fmt: skip
Kind = TypeVar("Kind", bound=Message)
MESSAGES: dict[str, type[Message]] = {  # by topic
    RUN: RunMessage, MOMDPS: MomdpMessage, TRIAL: TrialMessage, STEP: StepMessage,
    OUTCOME: OutcomeMessage, OUTCOMES: OutcomesMessage, FEEDBACK: FeedbackMessage,
    CHANGE: ChangeMessage, LINES: LineMessage,
}  # fmt: skip


def encode(message: Message) -> bytes:
    """Write a message as JSON.

    Raises
    ------
    LogError
        It is longer than a log may hold.
    """
    data = msgspec.json.encode(message, enc_hook=_plain)
    if len(data) > MESSAGE_LIMIT:
        raise LogError(
            f"A {type(message).__name__} takes {len(data)} bytes; a log holds at most "
            f"{MESSAGE_LIMIT} in one (ask fewer attributes, or log fewer tree edges)."
        )
    return data


def decode(data: bytes, kind: type[Kind]) -> Kind:
    """Read a message; raises a `ValueError` where the JSON is not that of its dataclass."""
    return msgspec.json.decode(data, type=kind, dec_hook=_array)


@cache
def schema_of(topic: str) -> bytes:
    """Return the JSON schema of a topic's messages.

    It has no references but those to a number, no alternatives and no lists in lists, as viewers
    read schemas.
    """
    kind = MESSAGES[topic]
    _, parts = msgspec.json.schema_components(
        [kind], schema_hook=lambda _: {}, ref_template="{name}"
    )

    def whole(node: Any) -> Any:
        if isinstance(node, list):
            return list(map(whole, node))
        if not isinstance(node, dict):
            return node
        if node.get("$ref") in parts:
            return whole(parts[node["$ref"]])
        if "$ref" in node:
            return _NUMBER
        return {name: whole(entry) for name, entry in node.items()}

    schema = {"$schema": _DRAFT, **whole(parts[kind.__name__]), "definitions": _DEFINITIONS}
    return json.dumps(schema).encode()


def _plain(value: Any) -> Any:
    """Return an array as lists of JSON values."""
    if isinstance(value, np.generic):
        return value.item()
    if not isinstance(value, np.ndarray):
        raise TypeError(f"a message cannot hold {value!r:.60}")
    numbers: list[Any] = value.ravel().tolist()
    if value.dtype == np.float32:  # the shortest text of a number that is read back as the same
        numbers = [float(text) for text in map(str, value.ravel())]
    if value.dtype.kind == "f" and np.isinf(value).any():
        numbers = [_INFINITE.get(number, number) for number in numbers]
    return numbers if value.ndim == 1 else {"shape": value.shape, "values": numbers}


def _array(kind: Any, data: Any) -> NDArray[Any]:
    """Read an array of a type such as `Floats`; it cannot be written to."""
    (dtype,) = get_args(get_args(kind)[1])
    values, shape = (data["values"], data["shape"]) if isinstance(data, dict) else (data, None)
    if not isinstance(values, list):
        raise TypeError(f"{type(values).__name__} in place of a list")
    if dtype in _KINDS and values:
        given = np.array(values)
        array = given.astype(dtype)
        if given.dtype.kind != _KINDS[dtype] or not np.array_equal(array, given):
            raise TypeError(f"a list of {dtype.__name__} has other values")
    else:
        array = np.array(values, dtype)
    if array.ndim != 1 or (dtype is np.object_ and not all(type(text) is str for text in values)):
        raise TypeError(f"a list of {dtype.__name__} has other values")
    array = array if shape is None else array.reshape(shape)
    array.setflags(write=False)
    return array


def _as_real(value: Any) -> Any:
    """Return a number as a message holds it: infinity is a text."""
    return _INFINITE.get(value, value) if isinstance(value, float) else value


def as_float(value: Any) -> float:
    """Return the number that a message holds."""
    return math.nan if value is None else float(value)


@cache
def _shared(message: Any, kind: Any) -> list[tuple[str, bool]]:
    """Return the fields of a message that a class has too, and whether each is a `Real`."""
    shared = [field for field in fields(message) if hasattr(kind, field.name)]
    return [(field.name, field.type in (Real, Real | UnsetType)) for field in shared]


@cache
def _arguments(kind: Any) -> set[str]:
    """Return the names of a dataclass's fields that its constructor takes."""
    return {field.name for field in fields(kind) if field.init}


def _values_for(kind: Any, source: object) -> dict[str, Any]:
    """Return the values that a message takes over from an object, by their names."""
    values = dict[str, Any]()
    class_: Any = type(source)
    for name, _ in _shared(kind, class_):
        value = getattr(source, name)
        values[name] = UNSET if value is None else _as_real(value)
    return values


def _values_of(message: Any, kind: Any) -> dict[str, Any]:
    """Return the values that an object takes over from a message, by their names."""
    values = dict[str, Any]()
    class_: Any = type(message)
    for name, is_real in _shared(class_, kind):
        if name in _arguments(kind):
            value = getattr(message, name)
            if value is UNSET:
                values[name] = None
            else:
                values[name] = as_float(value) if is_real else value
    return values


def _counted(
    shape: tuple[int, ...], action: int, levels: NDArray[np.integer[Any]]
) -> NDArray[np.int64]:
    """Return the percept counts (N,E,K) that a percept adds; level -1 is none of an attribute."""
    counts = np.zeros(shape, np.int64)
    attributes = np.flatnonzero(levels >= 0)
    counts[attributes, action, levels[attributes]] = 1
    return counts


_edge_values = attrgetter(*TreeEdge._fields)


def _edge(edge: EdgePart) -> TreeEdge:
    *whole, value, bonus = _edge_values(edge)
    return TreeEdge._make((*whole, as_float(value), as_float(bonus)))


def read_key(text: str) -> Key:
    """Read the key of a task."""
    key = untrusted.read_json(text)
    if not isinstance(key, list) or not all(type(part) in (int, str) for part in key):
        raise LogCorruptError(f"a trial's key is {text[:40]!r}, expected names and numbers")
    return tuple(key)


def judgment(trial: Trial) -> int:
    """Return 1 where a trial's report is right, 0, or -1 where that is unknown."""
    return -1 if trial.success is None else int(trial.success)


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


class Packed(NamedTuple):
    """One message, ready for the file."""

    topic: str
    time: int  # ns on the log's clock
    data: bytes
    momdp: tuple[bytes, int] | None = None  # digest and number of a new one


def log_time(trial: int, step: int) -> int:
    """Compute the time on the log's clock, ns; it counts steps, so that equal runs are equal files.

    >>> log_time(2, 3)
    2003000000000
    """
    return (trial * _TRIAL_SPAN + min(step, _TRIAL_SPAN - 1)) * _SECOND


class Momdps(dict[Any, tuple[Any, int]]):
    """What reader or writer knows of the MOMDPs in a file, with the bytes of their messages."""

    def add(self, key: Any, value: Any, size: int) -> None:
        """Add the next MOMDP; forget the oldest, beyond what a trial may refer back to."""
        self[key] = value, size
        sizes = [size for _, size in self.values()]
        while len(sizes) > 1 and (len(sizes) > MOMDP_MEMORY or sum(sizes) > MOMDP_BYTES):
            del self[next(iter(self))], sizes[0]


class TrialEncoder:
    """Packs one trial, by its number in the file: its start, its steps one by one, its outcome.

    `momdps` are the numbers of those in the file, by digest. It raises a `LogError` of arrays that
    do not fit each other, or are beyond the format's limits.
    """

    def __init__(self, number: int, momdps: Momdps) -> None:
        self._number = number
        self._momdps = momdps
        self._steps = self._edges = self._size = 0
        self._features = 0  # that are logged

    def begin(self, trial: Trial) -> Iterator[Packed]:
        """Pack the start of a trial, after its MOMDP where that is new; its steps come later."""
        self._trial = trial
        self._before = trial.first_belief
        self._check(start_misfits(trial), trial.first_belief)
        # Many trials share a MOMDP: it is written once, and named by its number from then on.
        message = MomdpMessage.of(trial, 0)
        data = encode(message)
        digest = hashlib.blake2b(data, digest_size=16).digest()
        last = max((number for number, _ in self._momdps.values()), default=-1)
        number, _ = self._momdps.get(digest, (last + 1, 0))
        if number > last:
            data = encode(replace(message, id=number)) if number else data
            yield Packed(MOMDPS, log_time(self._number, 0), data, (digest, number))
        yield self._packed(TRIAL, 0, TrialMessage.of(trial, self._number, number))

    def step(self, step: Step) -> Iterator[Packed]:
        """Pack the next step with a line of text."""
        momdp = self._trial.momdp
        index = self._steps
        action = step.decision.action
        self._steps = index + 1
        self._edges = self._edges + len(step.decision.tree)
        self._check(step_misfits(step, momdp, index), step.belief)
        # Percept counts stand in the file only where they do not follow from action and percept.
        change = step.belief.percept_counts - self._before.percept_counts
        if step.observation is not None and action < momdp.n_behaviors:
            change = change - _counted(change.shape, action, step.observation)
        self._before = step.belief
        sensed, self._features = within_limits(step.sensed, self._features)
        message = StepMessage.of(
            replace(step, sensed=sensed),
            momdp,
            trial=self._number,
            number=index,
            replayed=not change.any(),
        )
        yield self._packed(STEP, index + 1, message)
        # The same in a line of text, for viewers of MCAP files that do not know our messages.
        line = LineMessage(
            timestamp=TimePart(log_time(self._number, index + 1) // _SECOND, 0),
            level=_LEVELS.index("WARNING" if step.warning else "INFO"),
            message=self._line(step, index),
            name=self._trial.agent,
        )
        yield self._packed(LINES, index + 1, line)

    def end(self, trial: Trial) -> Iterator[Packed]:
        """Pack the outcome."""
        report = _shape_misfits(report=(trial.report, (trial.momdp.query.report_size,)))
        self._check(report, trial.last_belief)
        yield self._packed(OUTCOME, self._steps + 1, OutcomeMessage.of(trial, self._number))

    def whole(self, trial: Trial) -> Iterator[Packed]:
        """Pack a trial that is whole."""
        return chain(self.begin(trial), *map(self.step, trial.steps), self.end(trial))

    def _check(self, problems: Iterator[str], belief: Belief) -> None:
        """Raise the first problem, or what is beyond the limits."""
        percepts = (1 + self._steps) * belief.percept_counts.size
        for problem in chain(problems, limit_misfits(percepts, self._edges)):
            raise LogError(f"Trial {self._number} cannot be logged: {problem}.")

    def _packed(self, topic: str, step: int, message: Message) -> Packed:
        """Pack a message, by its topic and the number of its step on the clock."""
        packed = Packed(topic, log_time(self._number, step), encode(message))
        self._size += len(packed.data)
        if self._size > TRIAL_LIMIT:
            raise LogError(
                f"Trial {self._number} takes {self._size} bytes; a log holds at most {TRIAL_LIMIT}."
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


def read_trial(
    parts: Sequence[bytes],
    outcome: OutcomeMessage | None,
    momdps: Momdps,
    ended: str = "",
) -> Trial:
    """Read a trial: its start, its steps, its outcome, and the problems by their numbers.

    One without an outcome has `ended`.
    """
    begin = decode(parts[0], TrialMessage)
    if begin.momdp not in momdps:
        raise LogCorruptError(f"trial {begin.trial} refers to a MOMDP that is not there")
    (momdp, row_counts), _ = momdps[begin.momdp]
    counts = np.zeros((len(momdp.query), momdp.n_behaviors, momdp.levels), int)
    for problem in limit_misfits(counts.size * len(parts), 0):
        raise LogCorruptError(f"trial {begin.trial}: {problem}")
    first = belief = begin.belief.read(counts, momdp)
    steps = list[Step]()
    edges = 0
    for index, part in enumerate(parts[1:]):
        message = decode(part, StepMessage)
        if (message.trial, message.step) != (begin.trial, index):
            raise LogCorruptError(f"the steps of trial {begin.trial} are not in order")
        edges += len(message.tree)
        for problem in limit_misfits(0, edges):
            raise LogCorruptError(f"trial {begin.trial}: {problem}")
        steps.append(message.read(momdp, belief))
        belief = steps[-1].belief
    report = None if outcome is None else outcome.report
    trial = Trial(
        task=begin.read_task(momdp.query),
        agent=begin.agent,
        momdp=momdp,
        first_belief=first,
        steps=tuple(steps),
        truth=begin.truth,
        report=None if isinstance(report, UnsetType) else report,
        ended=ended if outcome is None else outcome.ended,
        counts=row_counts,
    )
    of_steps = (step_misfits(step, momdp, index) for index, step in enumerate(steps))
    for problem in chain(start_misfits(trial), *of_steps):
        raise LogCorruptError(f"trial {begin.trial}: {problem}")
    return trial


def within_limits(sensed: Instance | None, before: int) -> tuple[Instance | None, int]:
    """Return what of an instance is logged, and how many features of the trial are then.

    Features beyond the limits are left out, as a step without them is worth more than none.
    """
    features = {} if sensed is None else sensed.features or {}
    count = sum(map(len, features.values()))
    if sensed is None or count <= min(FEATURE_LIMIT, TRIAL_FEATURES - before):
        return sensed, before + count
    brought = sensed.percepts or sensed.scores
    return (replace(sensed, features=None) if brought else None), before


def limit_misfits(percepts: int, edges: int) -> Iterator[str]:
    """Yield what is beyond the limits of a trial."""
    if percepts > COUNT_LIMIT:
        yield f"its beliefs count more than {COUNT_LIMIT} percepts"
    if edges > EDGE_LIMIT:
        yield f"its search trees have more than {EDGE_LIMIT} edges"


def start_misfits(trial: Trial) -> Iterator[str]:
    """Yield what does not fit in a trial, but for its steps."""
    momdp = trial.momdp
    n = len(momdp.query)
    e = momdp.n_behaviors
    most = max(n, e, len(momdp.x_names))
    if most > NAME_LIMIT:
        yield f"the MOMDP has {most} attributes, behaviors or x, more than {NAME_LIMIT}"
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
    if percepts is not None and not ((percepts >= -1) & (percepts < k)).all():
        problems += [f"percepts {percepts.tolist()}, expected levels -1 to {k - 1}"]
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

"""Message bytes -> trials or outcomes; what does not fit together is refused."""

from collections import ChainMap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain, islice, repeat, starmap
from typing import Any

import numpy as np
from mcap.records import Attachment, Channel, Chunk, Header, McapRecord, Message
from numpy.typing import NDArray

from meal_bayes.arrays import freeze
from meal_bayes.domain import Event, Payoffs, Query
from meal_bayes.errors import LogCorruptError
from meal_bayes.momdp import MOMDP, Belief, belief_of
from meal_bayes.planners import Decision, TreeEdge
from meal_bayes.trial_log import schema
from meal_bayes.trial_log.container import FAULTS, chunk_messages, message_of
from meal_bayes.trial_log.encode import End, judgment, limit_misfits, start_misfits, step_misfits
from meal_bayes.trial_log.feedback import Feedback, read_key
from meal_bayes.trial_log.foreign import check_topics, form_of, run_header
from meal_bayes.trial_log.sensed import read_sensed
from meal_bayes.trials import Step, Task, Trial, TrialOutcomes
from meal_bayes.trials.outcomes import INTEGERS, REALS, TEXTS
from meal_bayes.trials.text import UNFINISHED
from meal_bayes.untrusted import read_json

NO_END = "the closing record is missing"
MERGED = (
    "the messages of two logs are mixed by time, as `mcap merge` does; read the logs that were "
    "merged (`cat` leaves each whole, and `meal-bayes log recover` reads all of them)"
)


@dataclass
class TrialBuilder:
    """Assembles trials from the records of a file, and counts what they hold."""

    limit: float = np.inf  # bytes that all chunks may unpack to
    form: str = schema.FULL
    header: dict[str, object] | None = None
    read: End = End()  # noqa: RUF009  immutable
    end: End | None = None  # as the writer counted
    feedback: list[Feedback] = field(default_factory=list)  # of a log of that form
    ours: bool = False  # whether a profile says so
    _channels: ChainMap[int, str] = field(default_factory=ChainMap)  # as declared, then as usual
    _runs: int = 0  # headers of runs
    _next: int = 0  # number of the next trial
    _momdps: schema.Momdps = field(default_factory=schema.Momdps)  # by number
    _open: list[bytes] = field(default_factory=list)  # start and steps of the trial under way

    def records(self, record: McapRecord) -> Iterator[Trial | TrialOutcomes]:
        """Read the next record; yield the trials, or the outcomes, that it completes."""
        if isinstance(record, Header):
            form = form_of(record.profile)
            self.ours = form is not None
            self.form = form or schema.FULL
            # Without its first chunk the others still mean what this format says.
            usual = dict(enumerate(schema.TOPICS[self.form], start=1))
            self._channels = ChainMap({}, usual)
        elif isinstance(record, Attachment) and record.name == schema.END:
            counts: Any = read_json(record.data)
            self.end = End(**counts)
        elif isinstance(record, Channel):
            self._channels[record.id] = record.topic
        elif isinstance(record, Chunk | Message):
            try:
                for topic, data in self._messages(record):
                    entry = self.add(topic, data)
                    if entry is not None:
                        yield entry
            except FAULTS:
                self._open = []
                raise

    def _messages(self, record: Chunk | Message) -> Iterable[tuple[str, bytes]]:
        """Return topics and data of a chunk's messages, or of a message outside of chunks."""
        if isinstance(record, Message):
            return [message_of(record, self._channels)]
        self.limit -= record.uncompressed_size
        if self.limit < 0:
            raise LogCorruptError("it unpacks to far more than a log of its size holds")
        return chunk_messages(record, self._channels)

    def add(self, topic: str, data: bytes) -> Trial | TrialOutcomes | None:
        """Add the next message; return the trial, or the outcomes, that it completes."""
        if topic == schema.RUN:
            self._runs += 1
            self.header = self.header or run_header(data)
        if self._runs > 1:
            raise LogCorruptError(MERGED)
        if topic == schema.MOMDPS:
            message = schema.MomdpMessage.FromString(data)
            self._momdps.add(message.id, _momdp(message), len(data))
        elif topic in (schema.TRIAL, schema.STEP):
            if bool(self._open) == (topic == schema.TRIAL):
                problem = "a trial has no outcome" if self._open else "a step has no trial"
                raise LogCorruptError(problem)
            self._open.append(data)
            if sum(map(len, self._open)) > schema.TRIAL_LIMIT:
                raise LogCorruptError(f"a trial is longer than {schema.TRIAL_LIMIT} bytes")
        elif topic == schema.FEEDBACK:
            self.feedback.append(Feedback.unpacked(data))
        elif topic in (schema.OUTCOME, schema.OUTCOMES):
            entry: Trial | TrialOutcomes
            first, entry = self._finish(data) if topic == schema.OUTCOME else decode_outcomes(data)
            if first < self._next:
                raise LogCorruptError(f"trial {first} is there twice, or not in order")
            self.read = self.read.after(entry)
            self._next = first + (1 if isinstance(entry, Trial) else len(entry))
            return entry
        return None

    def check_topics(self) -> None:
        """Refuse a file of another program, as far as it was read: it declares no topic of ours."""
        if not self.ours:
            check_topics(list(self._channels.maps[0].values()))

    def check_header(self) -> dict[str, object]:
        """Return the header of the run; refuse a file that was read, and has none."""
        if self.header is None:
            self.check_topics()
            raise LogCorruptError("the header of the run is missing")
        return self.header

    def check_end(self) -> None:
        """Compare with what the writer counted when it had written the last trial."""
        self.check_header()
        if self._open:
            steps = len(self._open) - 1
            raise LogCorruptError(f"a trial has no outcome; {steps} of its steps can be recovered")
        if self.end is None:
            raise LogCorruptError(NO_END)
        if self.form == schema.FEEDBACK_FORM and len(self.feedback) != 1:
            raise LogCorruptError(
                f"it holds {len(self.feedback)} messages of feedback, expected one"
            )
        if self.read != self.end:
            raise LogCorruptError(
                f"the trials are not those that were written ({self.read}, {self.end})"
            )

    def unfinished(self) -> Trial | None:
        """Return the trial under way as far as it went, with `ended`; None where there is none."""
        if not self._open:
            return None
        return self._trial(self._open, schema.OutcomeMessage(ended=UNFINISHED))

    def _finish(self, data: bytes) -> tuple[int, Trial]:
        if not self._open:
            raise LogCorruptError("an outcome has no trial")
        outcome = schema.OutcomeMessage.FromString(data)
        number = schema.TrialMessage.FromString(self._open[0]).trial
        steps = len(self._open) - 1
        if (steps, number) != (outcome.steps, outcome.trial):
            raise LogCorruptError(f"trial {number} has {steps} steps, not all of them")
        trial = self._trial(self._open, outcome)
        self._open = []
        written = (outcome.success, outcome.cost, outcome.reward)
        computed = (judgment(trial), trial.cost, trial.reward)
        if not np.array_equal(computed, written, equal_nan=True):
            raise LogCorruptError(f"the outcome of trial {number} is not that of its steps")
        return number, trial

    def _trial(self, parts: Sequence[bytes], outcome: Any) -> Trial:
        """Read a trial: its start, its steps, its outcome."""
        begin = schema.TrialMessage.FromString(parts[0])
        if begin.momdp not in self._momdps:
            raise LogCorruptError(f"trial {begin.trial} refers to a MOMDP that is not there")
        (momdp, row_counts), _ = self._momdps[begin.momdp]
        counts = np.zeros((len(momdp.query), momdp.n_behaviors, momdp.levels), int)
        messages = list(map(schema.StepMessage.FromString, parts[1:]))
        edges = sum(len(message.tree_level) for message in messages)
        for problem in limit_misfits(counts.size * len(parts), edges):
            raise LogCorruptError(f"trial {begin.trial}: {problem}")
        first = belief = _belief(begin, counts, momdp)
        steps = list[Step]()
        for index, message in enumerate(messages):
            if (message.trial, message.step) != (begin.trial, index):
                raise LogCorruptError(f"the steps of trial {begin.trial} are not in order")
            steps.append(_step(message, momdp, belief))
            belief = steps[-1].belief
        trial = Trial(
            task=Task(
                query=replace(momdp.query, attributes=tuple(begin.attributes)),
                key=read_key(begin.key),
                learn=not begin.test,
                **{name: getattr(begin, name) for name in schema.TASK_VALUES},
            ),
            agent=begin.agent,
            momdp=momdp,
            first_belief=first,
            steps=tuple(steps),
            truth=begin.truth,
            report=outcome.report or None,
            ended=outcome.ended,
            counts=row_counts,
        )
        of_steps = (step_misfits(step, momdp, index) for index, step in enumerate(steps))
        for problem in chain(start_misfits(trial), *of_steps):
            raise LogCorruptError(f"trial {begin.trial}: {problem}")
        return trial


def decode_outcomes(data: bytes) -> tuple[int, TrialOutcomes]:
    """Read outcomes, and the number of their first trial in the file."""
    message = schema.OutcomesMessage.FromString(data)
    size = {"n": message.trials, "q": message.queried, "e": len(message.behaviors)}
    if min(message.first, *size.values()) < 0 or max(size["q"], size["e"]) > schema.NAME_LIMIT:
        raise LogCorruptError(f"outcomes {message.first} of sizes {size}")
    shapes = TEXTS | INTEGERS | REALS
    if not message.certainty:  # older logs have none
        shapes = {name: shape for name, shape in shapes.items() if name != "certainty"}
    columns = _arrays(message, shapes, size)
    texts = np.array(message.texts, object)
    for name in TEXTS:
        numbers = columns[name].astype(int)
        if numbers.size and not 0 <= numbers.min() <= numbers.max() < len(texts):
            raise LogCorruptError(f"outcomes name a text that is not there ({name})")
        columns[name] = texts[numbers]
    return message.first, TrialOutcomes(tuple(message.behaviors), **columns)


def _arrays(message: Any, axes: Mapping[str, str], size: Mapping[str, int]) -> dict[str, Any]:
    """Read arrays by the letters of their axes, which have these sizes."""
    return {
        name: _array(getattr(message, name), [size[letter] for letter in letters])
        for name, letters in axes.items()
    }


def _array(values: Iterable[Any], shape: Sequence[int]) -> NDArray[Any]:
    return np.array(list(values)).reshape(shape)


def _momdp(message: Any) -> tuple[MOMDP, NDArray[np.float64] | None]:
    """Read a MOMDP and the counts behind it."""
    n, e, x = map(len, (message.attributes, message.behavior_names, message.x_names))
    if not all(0 < count <= schema.NAME_LIMIT for count in (n, e, x)):
        raise LogCorruptError(f"a MOMDP has {n} attributes, {e} behaviors and {x} x")
    counts = _array(message.row_counts, (n, e, 2, -1)) if message.row_counts else None
    of_group = list(message.group) or [0 for _ in range(n)]
    groups = tuple(
        tuple(i for i in range(n) if of_group[i] == number) for number in sorted({*of_group} - {0})
    )
    payoffs = Payoffs.of(message.payoffs) if message.payoffs else None
    query = Query(
        tuple(message.attributes),
        groups,
        tuple(message.group_name),
        Event(tuple(message.literal), message.complement) if message.literal else None,
        payoffs if message.own_payoffs else None,
    )
    classes = len(message.latent_classes) // (2 * n)
    size = {"n": n, "e": e, "x": x, "c": classes, "k": -1, "2": 2}
    momdp = MOMDP(
        query=query,
        payoffs=payoffs,
        x_names=tuple(message.x_names),
        x_labels=tuple(message.x_labels),
        behavior_names=tuple(message.behavior_names),
        **{name: getattr(message, name) for name in schema.MOMDP_NUMBERS},
        **_arrays(message, schema.MOMDP_ARRAYS, size),
        joint=_array(message.joint, (-1,)) if message.joint else None,
        # Older logs have no limit: their bonus is paid for all percepts.
        bonus_limit=(
            _array(message.bonus_limit, (e,)) if message.bonus_limit else np.full(e, np.inf)
        ),
    )
    return momdp, counts


def _belief(message: Any, replayed: NDArray[Any], momdp: MOMDP) -> Belief:
    """Read a belief; percept counts stand in the file only where replay does not give them."""
    counts = message.percept_counts
    counted = _array(counts, replayed.shape) if counts else replayed
    log_prob = _array(message.log_prob, (len(replayed), -1))
    return belief_of(momdp, message.belief_x, log_prob, counted)


def _step(message: Any, momdp: MOMDP, before: Belief) -> Step:
    n, e, k = before.percept_counts.shape
    action = message.action
    counts = before.percept_counts
    levels = list(message.observation)
    if action >= e:
        size = momdp.query.report_size
        if len(message.report) not in (size, 0 if momdp.abstain else size):
            raise LogCorruptError(f"a report of {len(message.report)} values, expected {size}")
        action = momdp.abstention
        if message.report:
            action = e + momdp.query.report_index(message.report)
    elif levels:
        counts = counts.copy()
        counts[np.arange(n), action, levels] += 1
    sensed = read_sensed(message, momdp.action_name(action))
    if sensed is not None and action >= e:
        raise LogCorruptError("an answer has sensed something")
    rows = message.sampled_rows  # (M,N,K) of the sampled MOMDPs that the decision kept, if any
    return Step(
        decision=Decision(
            action=action,
            tree=_tree(message),
            simulations=message.simulations,
            sampled_rows=_array(rows, (-1, n, k)) if rows else None,
            gap=message.gap[0] if message.gap else None,
            bonus=_array(message.bonus, (e + 1,)) if message.bonus else None,
            momdp=momdp,
            **{name: getattr(message, name) for name in schema.DECISION_ARRAYS},
        ),
        observation=freeze(levels, np.int8) if levels else None,
        belief=_belief(message, counts, momdp),
        sensed=sensed,
        **{name: getattr(message, name) for name in schema.STEP_VALUES},
    )


def _tree(message: Any) -> tuple[TreeEdge, ...]:
    percepts = message.tree_observation
    sizes = message.tree_observation_size
    if sum(sizes) != len(percepts):
        raise LogCorruptError("a search tree's percepts do not fit its edges")
    rest = iter(percepts)
    observations = [tuple(islice(rest, size)) for size in sizes]
    columns = (  # in the order of `TreeEdge`
        message.tree_level,
        message.tree_parent,
        message.tree_action,
        observations,
        message.tree_visits,
        message.tree_value,
        message.tree_bonus or repeat(0.0, len(sizes)),  # none in older logs
    )
    return tuple(starmap(TreeEdge, zip(*columns, strict=True)))

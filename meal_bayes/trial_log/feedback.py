"""What a person told of a trial when that was over: the truth that its own log cannot hold.

A trial's log is whole when the trial ends. What is told later is a log of its own beside it, one a
telling, so that nothing that was written is ever changed; readers of the trials put both together.
Other changes of a learner between its trials, which decide what it has learned since, are logged in
the same place.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields

import numpy as np

from meal_bayes.errors import LogCorruptError, LogError
from meal_bayes.seeds import Key
from meal_bayes.trial_log.messages import (
    NAME_LIMIT,
    ChangeMessage,
    FeedbackMessage,
    LabelPart,
    UnderWayPart,
    decode,
    encode,
    read_key,
)
from meal_bayes.trials import Trial, task_key
from meal_bayes.trials.record import truth_of
from meal_bayes.untrusted import name_fault

_WITHDRAWN = -1


@dataclass(frozen=True, slots=True)
class Feedback:
    """Labels that a person gave for a trial, or for an object by its name.

    Attributes
    ----------
    object_name : str
        Name of the object.
    labels : Mapping[str, int]
        Label of each attribute: 1 true, 0 false, or -1 if an earlier label was taken back. If the
        label of a group's value implies labels of the other values, these are included.
    key : Key | None
        Key of the trial's task. None if the labels are for an object by its name; they then apply
        to all trials of the object.
    recordings : bool
        Whether the recordings of the trial were forgotten, together with all its labels.
    under_way : Mapping[Key, int]
        Number of steps so far of each trial that was in progress at that time, by the key of the
        trial.

    Raises
    ------
    LogError
        A value is not a label, or the name of the object is not valid.
    """

    object_name: str
    labels: Mapping[str, int | bool]
    key: Key | None = None
    recordings: bool = False
    under_way: Mapping[Key, int] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if fault := name_fault(self.object_name):
            raise LogError(f"The object's name {self.object_name!a:.60} {fault}.")
        if self.recordings and (self.key is None or {*self.labels.values()} - {_WITHDRAWN}):
            raise LogError("Recordings are forgotten for a trial, together with its labels.")
        if not 0 < len(self.labels) + self.recordings <= NAME_LIMIT:
            raise LogError(f"{len(self.labels)} labels; expected 1 to {NAME_LIMIT}.")
        for name, label in self.labels.items():
            if label not in (_WITHDRAWN, 0, 1):
                raise LogError(f"The label of {name!r:.60} is {label!r:.60}; expected 1, 0 or -1.")

    @property
    def text(self) -> str:
        """The labels in words, such as "heavy, not beans, full taken back"."""
        words = {_WITHDRAWN: "{} taken back", 0: "not {}", 1: "{}"}
        labels = [words[int(label)].format(name) for name, label in self.labels.items()]
        return ", ".join([*labels, "recordings forgotten"] if self.recordings else labels)

    def packed(self) -> bytes:
        """Return the feedback as a message."""
        key = "" if self.key is None else task_key(self.key)
        labels = (LabelPart(name, int(label)) for name, label in self.labels.items())
        under_way = _under_way_parts(self.under_way)
        message = FeedbackMessage(
            self.object_name, key, tuple(labels), self.recordings, under_way=under_way
        )
        return encode(message)

    @classmethod
    def unpacked(cls, data: bytes) -> "Feedback":
        """Read feedback from a message."""
        message = decode(data, FeedbackMessage)
        labels = {part.attribute: part.label for part in message.labels}
        if len(labels) != len(message.labels):
            raise LogCorruptError("an attribute has two labels")
        key = read_key(message.key) if message.key else None
        under_way = _steps_under_way(message.under_way)
        return cls(message.object_name, labels, key, message.recordings, under_way)


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a learner that is not in the log of a trial.

    The learner was refitted, another agent decides, or the domain has one more attribute.

    Attributes
    ----------
    agent : str
        Name of the agent that decides after the change.
    digest, before : str
        Digest of this agent, and digest of the agent that decided before the change.
    used : bool
        Whether the learner had learned anything for the agent that decided before the change.
    refit : bool
        Whether the change is a refit by `Learner.refit`.
    added : str
        Attribute or group that was added to the domain; "" if none was added.
    values : tuple[str, ...]
        Values of the group that was added; empty if no group was added.
    under_way : Mapping[Key, int]
        As for `Feedback`.
    """

    agent: str
    digest: str
    before: str
    used: bool
    refit: bool
    added: str = ""
    values: tuple[str, ...] = ()
    under_way: Mapping[Key, int] = field(default_factory=dict)

    @property
    def text(self) -> str:
        """The change in words, such as "all was learned anew"."""
        if self.added:
            return f"{', '.join(self.values or [self.added])} added to what can be asked"
        if self.refit:
            return "all was learned anew"
        return f"the agent {self.agent} decides from then on"

    def packed(self) -> bytes:
        """Return the change as a message."""
        values = {name.name: getattr(self, name.name) for name in fields(self)}
        values["under_way"] = _under_way_parts(self.under_way)
        return encode(ChangeMessage(**values))

    @classmethod
    def unpacked(cls, data: bytes) -> "Change":
        """Read a change from a message."""
        message = decode(data, ChangeMessage)
        values = {name.name: getattr(message, name.name) for name in fields(message)}
        return cls(**{**values, "under_way": _steps_under_way(message.under_way)})


def _under_way_parts(under_way: Mapping[Key, int]) -> tuple[UnderWayPart, ...]:
    return tuple(UnderWayPart(task_key(key), steps) for key, steps in under_way.items())


def _steps_under_way(parts: Iterable[UnderWayPart]) -> dict[Key, int]:
    return {read_key(part.key): part.steps for part in parts}


class FeedbackIndex:
    """The feedback of one folder, by trial and object; a later label replaces an earlier one.

    Parameters
    ----------
    entries : Iterable[Feedback | Change]
        In the order in which they were told; changes of a learner are passed over.
    """

    def __init__(self, entries: Iterable[Feedback | Change]) -> None:
        # By the trial, or by the object where that was named: (number of the entry, label).
        self._labels: dict[Key | str, dict[str, tuple[int, int]]] = {}
        told = (entry for entry in entries if isinstance(entry, Feedback))
        for number, entry in enumerate(told):
            whose = entry.object_name if entry.key is None else entry.key
            labels = self._labels.setdefault(whose, {})
            labels |= {name: (number, label) for name, label in entry.labels.items()}

    def truth(self, trial: Trial) -> dict[str, int]:
        """Return the labels that hold of a trial's object when it was shown, by attribute."""
        latest = dict[str, tuple[int, int]]()
        for whose in (trial.task.key, trial.task.object_name):
            for name, entry in self._labels.get(whose, {}).items():
                if entry[1] != _WITHDRAWN:
                    latest[name] = max(entry, latest.get(name, entry))
        return {name: label for name, (_, label) in latest.items()}

    def judged(self, trial: Trial) -> Trial:
        """Return a trial with the truth as told, and its report rewarded by that.

        Raises
        ------
        QueryError
            Labels of a group of which not exactly one can be true.
        """
        labels = self.truth(trial)
        truth = trial.truth.copy()
        for index, name in enumerate(trial.task.query.attributes):
            truth[index] = labels.get(name, truth[index])
        if np.array_equal(truth, trial.truth):
            return trial
        return trial.with_truth(truth_of(trial.task.query, truth))

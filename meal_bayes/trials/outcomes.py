"""Outcomes of many trials in columns, a row for each trial: all that measures need."""

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from typing import Any, NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, check_kind, freeze_arrays, is_whole, set_frozen
from meal_bayes.errors import SettingsError
from meal_bayes.trials.record import TrialRecord

Texts = NDArray[np.object_]
_Part = tuple[tuple[str, ...], Mapping[str, Any]]  # behaviors and columns by name

TEXTS = {"agent": "n", "key": "n", "object_name": "n", "attribute": "nq", "ended": "n"}
INTEGERS = {
    "object_index": "n", "truth": "nq", "report": "nq", "steps": "n", "executed": "ne",
    "failed": "ne",
}  # fmt: skip
REALS = {"positive": "nq", "cost": "n", "reward": "n", "certainty": "n"}
HOUR = 3600.0  # s, the unit of exploration in `BatchOutcomes`
_ROUNDING = 1e-9  # of a sum of probabilities
_SHAPES = TEXTS | INTEGERS | REALS
_PADDING: dict[str, Any] = {  # in the types of the columns
    "attribute": np.array("", object), "truth": np.int8(-1), "report": np.int8(-1),
    "positive": np.nan,
}  # fmt: skip


@runtime_checkable
class Run(Protocol):
    """Many trials, whose outcomes are kept."""

    def outcomes(self) -> "TrialOutcomes":
        """Return the outcomes of all trials."""


@dataclass(frozen=True, slots=True, eq=False)
class TrialOutcomes:
    """Outcomes of n trials; N is the largest number of attributes in a question.

    A row with fewer attributes is padded with attribute "", truth -1, report -1 and belief NaN.

    Attributes
    ----------
    behaviors : tuple[str, ...]
        Names of the E behaviors.
    agent, key, object_name, ended : Texts
        (n,) four texts for each trial: the name of the agent; the key of the task in JSON, by which
        trials of two agents are paired; the name of the object, which is the cluster of standard
        errors; and why the trial was broken off, or "".
    object_index : NDArray[np.int64]
        (n,) index of each trial's object in the data set; -1 for an object without recordings.
    attribute : Texts
        (n,N) name of each queried attribute; a value of a group is named as in "fill: half". For a
        yes-or-no question it is the event, as in "red and not empty".
    truth, report : NDArray[np.int8]
        (n,N) true and reported value of each attribute: 1 true, 0 false, -1 if the truth is unknown
        or there is no report.
    positive : NDArray[np.float64]
        (n,N) probability that each attribute is true, by the final belief.
    cost, reward : NDArray[np.float64]
        (n,) cost of each trial in seconds (Eq. 6), and its reward without exploration bonus and
        discount. The reward is NaN if it is unknown.
    steps : NDArray[np.int64]
        (n,) number of actions in each trial, including the report.
    executed, failed : NDArray[np.int64]
        (n,E) number of executions of each behavior, and number of these executions that gave no
        percept (all of them, if the behavior never senses).
    certainty : NDArray[np.float64]
        (n,) probability of the most probable values, by the agent's final belief. By default, as
        for logs without this column, it is computed as if attributes were independent.

    Raises
    ------
    SettingsError
        Shapes of columns do not agree, or a column has a value that no trial can have.
    """

    behaviors: tuple[str, ...]
    agent: Texts
    key: Texts
    object_index: NDArray[np.int64]
    object_name: Texts
    attribute: Texts
    truth: NDArray[np.int8]
    report: NDArray[np.int8]
    positive: NDArray[np.float64]
    cost: NDArray[np.float64]
    reward: NDArray[np.float64]
    ended: Texts
    steps: NDArray[np.int64]
    executed: NDArray[np.int64]
    failed: NDArray[np.int64]
    certainty: NDArray[np.float64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        if self.certainty is None:
            likelier = np.maximum(self.positive, 1 - self.positive)  # type: ignore[unreachable]
            set_frozen(self, certainty=np.nanprod(likelier, axis=1))
        freeze_arrays(self)
        size = {"n": len(self), "e": len(self.behaviors)}
        size["q"] = self.attribute.shape[1] if self.attribute.ndim == 2 else -1
        for name, shape in _SHAPES.items():
            expected = tuple(size[letter] for letter in shape)
            actual = getattr(self, name).shape
            if actual != expected:
                raise SettingsError(f"{name} has shape {actual}, expected {expected}.")
        # Rows of fewer attributes than the widest query are padded with "".
        asked = self.attribute != ""
        answered = self.report >= 0
        wrong = {
            "truth": ~np.isin(self.truth, (-1, 0, 1)) | ((self.truth >= 0) & ~asked),
            "report": ~np.isin(self.report, (-1, 0, 1))
            | (answered != (asked & answered.any(axis=1, keepdims=True))),
            "positive": np.where(
                asked, ~((self.positive >= 0) & (self.positive <= 1)), ~np.isnan(self.positive)
            ),
            "cost": ~np.isfinite(self.cost),
            "certainty": ~((self.certainty >= 0) & (self.certainty <= 1 + _ROUNDING)),
            "reward": np.isinf(self.reward),
            "steps": self.steps < self.executed.sum(axis=1),
            "executed": self.executed < self.failed,
            "failed": self.failed < 0,
            "object_index": self.object_index < -1,
        }
        for name, misfits in wrong.items():
            for row in np.argwhere(misfits)[:1, 0]:
                raise SettingsError(f"{name} of row {row} is {getattr(self, name)[row]}.")

    def __len__(self) -> int:
        return len(self.agent)

    @classmethod
    def of(cls, trials: "Trials") -> "TrialOutcomes":
        """Return outcomes: computed from trials, read from a run, or passed on unchanged."""
        if isinstance(trials, TrialOutcomes):
            return trials
        if isinstance(trials, Run):
            return trials.outcomes()
        check_trials(trials)
        return cls._stack([_columns(trial) for trial in trials])

    @classmethod
    def join(cls, parts: Sequence["TrialOutcomes"]) -> "TrialOutcomes":
        """Join rows of several outcomes; pad missing attributes, and match behaviors by name."""
        return cls._stack(
            [(part.behaviors, {name: getattr(part, name) for name in _SHAPES}) for part in parts]
        )

    @classmethod
    def _stack(cls, parts: Sequence[_Part]) -> "TrialOutcomes":
        # Agents of one run may have other behaviors: columns are matched by name.
        behaviors = tuple(dict.fromkeys(name for names, _ in parts for name in names))
        sizes = [np.shape(columns["attribute"]) for _, columns in parts]
        n = sum(rows for rows, _ in sizes)
        q = max((width for _, width in sizes), default=0)
        whole: dict[str, Any] = {}
        for name, shape in _SHAPES.items():
            if shape == "n":
                whole[name] = list(chain.from_iterable(columns[name] for _, columns in parts))
                continue
            fill = _PADDING.get(name, 0)
            whole[name] = np.full((n, q if shape == "nq" else len(behaviors)), fill)
            row = 0
            for (names, columns), (rows, width) in zip(parts, sizes, strict=True):
                target = [behaviors.index(b) for b in names] if shape == "ne" else slice(width)
                whole[name][row : row + rows, target] = columns[name]
                row += rows
        return cls(behaviors=behaviors, **whole)

    def rows(self, chosen: Any) -> "TrialOutcomes":
        """Return the rows that a mask (n,), a slice or indices select."""
        columns = {name: getattr(self, name)[chosen] for name in _SHAPES}
        return TrialOutcomes(self.behaviors, **columns)

    def of_agent(self, name: str) -> "TrialOutcomes":
        """Return the rows of one agent."""
        return self.rows(self.agent == name)

    @property
    def agents(self) -> tuple[str, ...]:
        """Names of the agents, in the order of their first trials."""
        return tuple(dict.fromkeys(self.agent.tolist()))

    @property
    def answered(self) -> Bools:
        """Whether there is a report, (n,)."""
        return np.asarray((self.report >= 0).any(axis=1))

    @property
    def judged(self) -> Bools:
        """Whether the trial was not broken off and its truth is known, (n,)."""
        truths_known = (self.truth >= 0) | (self.attribute == "")
        return np.asarray((self.ended == "") & truths_known.all(axis=1))

    @property
    def success(self) -> NDArray[np.int8]:
        """Success by Eq. 5, (n,): 1 if the whole report is right, 0 if not, -1 if not `judged`."""
        right = self.answered & (self.report == self.truth).all(axis=1)
        return np.where(self.judged, right, -1).astype(np.int8)

    def beliefs(self) -> tuple[NDArray[np.float64], Bools]:
        """Return final beliefs and known truths of trials that were not broken off, (M,) each."""
        rows = (self.truth >= 0) & (self.ended == "")[:, None]
        return self.positive[rows], self.truth[rows] == 1


class BatchOutcomes(NamedTuple):
    """Test trials after a batch of an online run; batch 0 is before any training.

    `hours` is the time of exploration before these tests: the summed cost of training trials.
    """

    agent: str
    repeat: int
    batch: int
    hours: float
    outcomes: TrialOutcomes


def check_trials(trials: object) -> None:
    """Refuse what cannot be gone through, one trial after the other."""
    if not isinstance(trials, Iterable):
        raise SettingsError(f"trials is {trials!r:.60}; give trials, or the outcomes of some.")


def _columns(trial: TrialRecord) -> _Part:
    """Return the behaviors and the columns of one trial."""
    check_kind("trial", trial, TrialRecord)
    task = trial.task
    names = trial.momdp.behavior_names
    executed = [step for step in trial.steps if step.decision.action < len(names)]
    actions = [step.decision.action for step in executed]
    empty = [step.decision.action for step in executed if step.observation is None]
    query = task.query
    positive = trial.last_belief.positive
    truth = query.report_truth(trial.truth)
    report = np.full(len(truth), -1) if trial.report is None else trial.report
    attributes = query.value_names
    if query.event is not None and trial.probability is not None:  # one question
        attributes = (query.text.removesuffix("?"),)
        positive = np.array([trial.probability])
    return names, {
        "agent": [trial.agent],
        "key": [task_key(task.key)],
        "object_index": [task.object_index],
        "object_name": [task.object_name],
        "attribute": [attributes],
        "truth": [truth],
        "report": [report],
        "positive": [positive],
        "cost": [trial.cost],
        "reward": [trial.reward],
        "certainty": [trial.certainty],
        "ended": [trial.ended],
        "steps": [len(trial.steps)],
        "executed": [np.bincount(actions, minlength=len(names))],
        "failed": [np.bincount(empty, minlength=len(names))],
    }


def task_key(key: Iterable[str | int]) -> str:
    """Write a task's key as JSON.

    >>> task_key(("offline", 3))
    '["offline", 3]'
    """
    parts = list(key)
    for part in parts:
        if not (isinstance(part, str) or is_whole(part)):
            raise SettingsError(f"key has {part!r:.60}; give names and whole numbers.")
    return json.dumps([part if isinstance(part, str) else int(part) for part in parts])


Trials = Iterable[TrialRecord] | TrialOutcomes | Run

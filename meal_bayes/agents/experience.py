"""What a robot at work has gathered (Alg. 2): recordings, and what people told of the objects.

The world hands a training object's recordings out in one order, each once; when all are out, they
come again, but hold nothing new. So the trials of a run tell which recordings the robot has, and D
is rebuilt from their log alone.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import SettingsError

_ANSWERS = ("verdict", "all")


@dataclass(frozen=True, slots=True)
class Feedback:
    """What a person tells after a trial.

    Raises
    ------
    SettingsError : unknown answers, an error rate outside [0, 1).
    """

    answers: str = "verdict"  # "right" or "wrong" of the report; "all": every queried attribute
    error: float = 0.0  # Pr(a person errs), for each thing told

    def __post_init__(self) -> None:
        if self.answers not in _ANSWERS:
            raise SettingsError(unknown("feedback", self.answers, _ANSWERS))
        if not 0 <= self.error < 1:
            raise SettingsError(f"A person errs with probability {self.error}; give 0 to below 1.")

    def told(self, trial: Trial, rng: np.random.Generator) -> NDArray[np.int8]:
        """Labels of the queried attributes that a person's words imply, (N,); -1 unknown.

        By a verdict the robot learns v where its report was right, or where it asked for a single
        attribute (Sect. 7.3); an abstention teaches nothing, nor does what the person does not
        know.
        """
        if self.answers == "all":
            errs = rng.random(len(trial.truth)) < self.error
            return np.where(trial.truth < 0, -1, (trial.truth == 1) ^ errs).astype(np.int8)
        if trial.report is None or trial.success is None:
            return np.full(len(trial.truth), -1, np.int8)
        return implied(trial.report, right=trial.success ^ bool(rng.random() < self.error))


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    Of a wrong report of several attributes nobody knows which are wrong.
    """
    if right:
        return report.astype(np.int8)
    return (~report).astype(np.int8) if len(report) == 1 else np.full(len(report), -1, np.int8)


def replayable(dataset: Dataset) -> NDArray[np.int64]:
    """Return how many recordings of each behavior can be replayed, (O,E); R where it has none.

    So behaviors without modalities, such as asking a person, never run out before the others.
    """
    senses = [bool(behavior.modalities) for behavior in dataset.domain.behaviors]
    return np.where(senses, dataset.recording_counts, dataset.recordings)


@dataclass(frozen=True, slots=True)
class Experience:
    """Recordings gathered and labels told, O objects, E behaviors, R recordings, P attributes.

    With `memory` the robot knows an object again: a label told once holds for all recordings of
    the object, earlier and later ones. Without, it labels the recordings of its own trial.
    """

    order: NDArray[np.int64]  # (O,E,R) in which the world hands recordings out, absent ones last
    used: NDArray[np.int64]  # (O,E) handed out so far, again and again
    labels: NDArray[np.int8]  # (O,E,R,P) of the recordings gathered; -1 not labelled
    gathered: NDArray[np.bool_]  # (O,E,R)
    told: NDArray[np.int8]  # (O,P) -1 unknown
    attempts: NDArray[np.int64]  # (E,2) legal executions that failed, and that succeeded
    counts: NDArray[np.int64]  # (O,E) recordings that there are
    memory: bool = False

    def __post_init__(self) -> None:
        for name in ("order", "used", "attempts", "counts"):
            set_frozen(self, **{name: freeze(getattr(self, name), np.int64)})
        for name in ("labels", "told"):
            set_frozen(self, **{name: freeze(getattr(self, name), np.int8)})
        set_frozen(self, gathered=freeze(self.gathered, np.bool_))

    @classmethod
    def none(
        cls, dataset: Dataset, rng: np.random.Generator, *, memory: bool = False
    ) -> "Experience":
        """Start with D empty; `rng` draws the order of recordings."""
        o, p = dataset.labels.shape
        e, r = len(dataset.domain.behaviors), dataset.recordings
        counts = replayable(dataset)
        absent = np.arange(r) >= counts[..., None]
        order = np.where(absent, np.inf, rng.random((o, e, r))).argsort(axis=-1)
        return cls(
            order,
            np.zeros((o, e), np.int64),
            np.full((o, e, r, p), -1, np.int8),
            np.zeros((o, e, r), np.bool_),
            np.full((o, p), -1, np.int8),
            np.zeros((e, 2), np.int64),
            counts,
            memory,
        )

    def pretrain(self, dataset: Dataset, objects: NDArray[np.intp]) -> "Experience":
        """Execute every behavior once on some objects, recording 1, all labels told."""
        labels, gathered, told = self.labels.copy(), self.gathered.copy(), self.told.copy()
        sensing = np.flatnonzero([bool(b.modalities) for b in dataset.domain.behaviors])
        o, e = np.nonzero(self.counts[np.ix_(objects, sensing)] > 0)
        o, e = objects[o], sensing[e]
        labels[o, e, 0] = dataset.labels[o]
        gathered[o, e, 0] = True
        told[objects] = dataset.labels[objects]
        return replace(self, labels=labels, gathered=gathered, told=told)

    def absorb(self, domain: Domain, trial: Trial, told: NDArray[np.int8]) -> "Experience":
        """Add what a training trial showed and what was told of it, (N,) (Alg. 2, l. 18-23)."""
        o = trial.task.object_index
        columns = np.array(domain.columns(trial.task.query.attributes))
        columns, values = columns[told >= 0], told[told >= 0]
        used, labels, gathered = self.used.copy(), self.labels.copy(), self.gathered.copy()
        known, attempts = self.told.copy(), self.attempts.copy()
        known[o, columns] = values
        for step in trial.steps:
            e = step.decision.action
            if e >= len(domain.behaviors):
                continue
            perceived = step.observation is not None
            before = step.belief.percept_counts[0, e].sum() - perceived
            # When all recordings are used, a loop that succeeds looks as one that fails.
            if trial.momdp.legal[step.x, e] and before < trial.momdp.limit[e]:
                attempts[e, int(perceived or step.next_x != step.x)] += 1
            if not perceived or not domain.behaviors[e].modalities:
                continue
            r = self.order[o, e, used[o, e] % self.counts[o, e]]
            used[o, e] += 1
            gathered[o, e, r] = True
            labels[o, e, r, columns] = values
        if self.memory:
            labels[o, gathered[o]] = known[o]
        return replace(
            self, used=used, labels=labels, gathered=gathered, told=known, attempts=attempts
        )

    def supply(self, object_index: int) -> list[list[int]]:
        """List the recordings of an object that come next, (E,) lists, the next one last."""
        o = object_index
        rows = zip(self.order[o], self.counts[o], self.used[o], strict=True)
        return [np.roll(order[:count], -used)[::-1].tolist() for order, count, used in rows]

    def evidence(self, objects: NDArray[np.intp] | None = None) -> NDArray[np.int64]:
        """Count the labelled instances of each attribute and behavior, (P,E), of some objects."""
        labels = self.labels if objects is None else self.labels[objects]
        return np.asarray((labels >= 0).sum(axis=(0, 2)).T)

    def recorded(self) -> NDArray[np.bool_]:
        """Return whether D holds a labelled instance of object, behavior, attribute, (O,E,P)."""
        return np.asarray((self.labels >= 0).any(axis=2))

    def training_set(self) -> TrainingSet:
        """Return D."""
        row = np.argwhere((self.labels >= 0).any(axis=-1))
        o, e, r = row.T.astype(np.int32)
        return TrainingSet(o, e, r, self.labels[o, e, r])

    def recordings(self) -> TrainingSet:
        """Return all recordings gathered, labelled or not."""
        o, e, r = np.argwhere(self.gathered).T.astype(np.int32)
        return TrainingSet(o, e, r, self.labels[o, e, r])

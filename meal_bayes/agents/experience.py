"""The training set D that a robot gathers online (Alg. 2): recordings, and labels by feedback.

Recordings of a training object are replayed in one random order, each once; after the last they
repeat, but add nothing to D. So D can be rebuilt from the log of the trials alone.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, PerceptTable, TrainingSet
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import SettingsError

_ANSWERS = ("verdict", "all")


@dataclass(frozen=True, slots=True)
class Feedback:
    """What a person says after a trial.

    Attributes
    ----------
    answers : "verdict", whether the report was right; or "all", every queried attribute.
    error : probability that a verdict or a label is wrong.

    Raises
    ------
    SettingsError : unknown answers, an error rate outside [0, 1).
    """

    answers: str = "verdict"
    error: float = 0.0

    def __post_init__(self) -> None:
        if self.answers not in _ANSWERS:
            raise SettingsError(unknown("feedback", self.answers, _ANSWERS))
        if not 0 <= self.error < 1:
            raise SettingsError(f"A person errs with probability {self.error}; give 0 to below 1.")

    def labels(self, trial: Trial, rng: np.random.Generator) -> NDArray[np.int8]:
        """Return the labels of the queried attributes that the feedback implies, (N,); -1 unknown.

        A verdict implies all labels where the report was right, or where a single attribute was
        queried (Sect. 7.3). It implies none after an abstention, or where the truth is not known.
        """
        if self.answers == "all":
            errs = rng.random(len(trial.truth)) < self.error
            return np.where(trial.truth < 0, -1, (trial.truth == 1) ^ errs).astype(np.int8)
        if trial.report is None or trial.success is None:
            return np.full(len(trial.truth), -1, np.int8)
        return implied(trial.report, right=trial.success ^ bool(rng.random() < self.error))


def implied(report: NDArray[np.bool_], *, right: bool) -> NDArray[np.int8]:
    """Return the labels (N,) that a verdict on a report (N,) implies; -1 unknown.

    A wrong report of several attributes implies none, as any of them may be wrong.
    """
    if right:
        return report.astype(np.int8)
    return (~report).astype(np.int8) if len(report) == 1 else np.full(len(report), -1, np.int8)


def replayable(dataset: Dataset | PerceptTable) -> NDArray[np.int64]:
    """Return how many recordings of each behavior can be replayed, (O,E); R where it has none.

    Behaviors without modalities, such as asking a person, never run out before the others.
    """
    senses = [bool(behavior.modalities) for behavior in dataset.domain.behaviors]
    return np.where(senses, dataset.recording_counts, dataset.recordings)


@dataclass(frozen=True, slots=True)
class Experience:
    """Recordings and labels gathered, of O objects, E behaviors, R recordings, P attributes.

    Attributes
    ----------
    order : (O,E,R) the order in which recordings are replayed, absent ones last.
    used : (O,E) recordings replayed so far, repeats included.
    labels : (O,E,R,P) of the recordings gathered; -1 unknown.
    gathered : (O,E,R) whether D holds the recording.
    object_labels : (O,P) by feedback; -1 unknown.
    attempts : (E,2) legal executions that failed, and that succeeded.
    counts : (O,E) recordings of the data set.
    memory : whether the robot recognizes objects: then a label holds for all recordings of the
        object, earlier and later ones; otherwise for the recordings of its own trial.
    """

    order: NDArray[np.int64]
    used: NDArray[np.int64]
    labels: NDArray[np.int8]
    gathered: NDArray[np.bool_]
    object_labels: NDArray[np.int8]
    attempts: NDArray[np.int64]
    counts: NDArray[np.int64]
    memory: bool = False

    def __post_init__(self) -> None:
        for name in ("order", "used", "attempts", "counts"):
            set_frozen(self, **{name: freeze(getattr(self, name), np.int64)})
        for name in ("labels", "object_labels"):
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
        """Execute every behavior once on some objects, recording 1, with all labels known."""
        labels, gathered, known = (
            self.labels.copy(),
            self.gathered.copy(),
            self.object_labels.copy(),
        )
        sensing = np.flatnonzero([bool(b.modalities) for b in dataset.domain.behaviors])
        o, e = np.nonzero(self.counts[np.ix_(objects, sensing)] > 0)
        o, e = objects[o], sensing[e]
        labels[o, e, 0] = dataset.labels[o]
        gathered[o, e, 0] = True
        known[objects] = dataset.labels[objects]
        return replace(self, labels=labels, gathered=gathered, object_labels=known)

    def absorb(self, domain: Domain, trial: Trial, feedback: NDArray[np.int8]) -> "Experience":
        """Add the recordings of a training trial, labeled by feedback (N,) (Alg. 2, l. 18-23)."""
        o = trial.task.object_index
        columns = np.array(domain.columns(trial.task.query.attributes))
        columns, values = columns[feedback >= 0], feedback[feedback >= 0]
        used, labels, gathered = self.used.copy(), self.labels.copy(), self.gathered.copy()
        known, attempts = self.object_labels.copy(), self.attempts.copy()
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
            self, used=used, labels=labels, gathered=gathered, object_labels=known,
            attempts=attempts,
        )  # fmt: skip

    def supply(self, object_index: int) -> list[list[int]]:
        """Return the recordings of an object yet to come, (E,) lists, the next one last."""
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

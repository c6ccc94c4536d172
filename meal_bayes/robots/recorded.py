"""A robot that replays recordings: failures from the diagram, percepts from a data set."""

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.domain import Domain
from meal_bayes.errors import SettingsError
from meal_bayes.robots.diagram_simulator import DiagramSimulator
from meal_bayes.robots.robot import Outcome

Order = list[list[int]]  # (E,) lists of the recordings to come, the next one last

ANSWERED = -1  # the recording of a percept that a person answers


class RecordedRobot:
    """A robot that replays an object's recordings in random order, none twice in a trial.

    A failed execution uses no recording; when all are used, behaviors still change x and cost
    time, but sense nothing. The order of recordings and the failures are the same for every agent:
    the k-th execution of a behavior has its own uniform draws.

    Parameters
    ----------
    domain : behaviors and diagram.
    object_index : the object in front of the robot.
    recordings : how many of each behavior there are, (E,) or one number.
    order : generator of the order of recordings at each `start`, or the order itself: (E,) lists
        of the recordings to come, the next one last.
    failures : generator of failures.
    dataset : whose features an outcome has; without it only the recording's number, by which a
        perceiver looks percepts up.
    repeats : recordings never run out, each is drawn anew from all (for percepts that are drawn
        from tables).
    person : answers behaviors that ask, with this accuracy; without one a perceiver does.
    """

    def __init__(
        self,
        domain: Domain,
        object_index: int,
        recordings: ArrayLike,
        order: np.random.Generator | Order,
        failures: np.random.Generator,
        dataset: Dataset | None = None,
        *,
        repeats: bool = False,
        person: Callable[[float], Mapping[str, bool]] | None = None,
    ) -> None:
        counts = np.broadcast_to(np.asarray(recordings, np.int64), (len(domain.behaviors),))
        most = np.inf if dataset is None else dataset.recordings
        if counts.min() < 0 or not 1 <= counts.max() <= most:
            has = "1 or more" if dataset is None else f"1 to {dataset.recordings}"
            raise SettingsError(f"recordings = {counts.max()}; expected {has}.")
        if object_index < 0 or (dataset is not None and object_index >= len(dataset.objects)):
            raise SettingsError(f"Object {object_index} is not in the data set.")
        self._domain, self._dataset, self._object = domain, dataset, object_index
        self._recordings, self._repeats = counts, repeats
        self._order, self._person = order, person
        self._simulator = DiagramSimulator(domain, failures)
        self._left: Order = []

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,)."""
        return np.where(self._repeats, np.inf, self._recordings)

    def start(self) -> str:
        """Start a trial in x0, with all recordings unused."""
        if isinstance(self._order, np.random.Generator):
            size = len(self._recordings), int(self._recordings.max())
            orders = self._order.random(size).argsort(axis=1).tolist()
            self._left = [
                [recording for recording in order if recording < count]
                for order, count in zip(orders, self._recordings.tolist(), strict=True)
            ]
        else:
            self._left = [list(recordings) for recordings in self._order]
        return self._simulator.start()

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior; a success senses its next recording, if one is left."""
        move = self._simulator.move(behavior)
        if not move.perceivable:
            return Outcome(move.state)
        e = self._domain.behavior_index(behavior)
        if not self._domain.behaviors[e].modalities:
            accuracy = self._domain.behaviors[e].answer_accuracy
            if self._person is not None and accuracy is not None:
                return Outcome(move.state, answers=self._person(accuracy))
            return Outcome(move.state, recording=ANSWERED)
        if self._repeats and not isinstance(self._order, np.random.Generator):
            self._left[e].insert(0, recording := self._left[e].pop())  # in their order, for ever
        elif self._repeats:
            recording = int(move.uniform * self._recordings.max())
        elif self._left[e]:
            recording = self._left[e].pop()
        else:
            return Outcome(move.state)
        if self._dataset is None:
            return Outcome(move.state, recording=recording)
        instance = self._dataset.instance(self._object, behavior, recording)
        return Outcome(move.state, instance.features, recording=recording)


def replayable(dataset: Dataset | PerceptTable) -> NDArray[np.int64]:
    """Return how many recordings of each behavior can be replayed, (O,E); R where it has none.

    Behaviors without modalities, such as asking a person, never run out before the others.
    """
    senses = [bool(behavior.modalities) for behavior in dataset.domain.behaviors]
    return np.where(senses, dataset.recording_counts, dataset.recordings)

"""A robot that replays recordings: failures from the diagram, percepts from a data set."""

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.datasets import Dataset
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
        self._order = order
        self._simulator = DiagramSimulator(domain, failures)
        self._left: Order = []

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
            return Outcome(move.state, recording=ANSWERED)
        if self._repeats:
            recording = int(move.uniform * self._recordings.max())
        elif self._left[e]:
            recording = self._left[e].pop()
        else:
            return Outcome(move.state)
        if self._dataset is None:
            return Outcome(move.state, recording=recording)
        instance = self._dataset.instance(self._object, behavior, recording)
        return Outcome(move.state, instance.features, recording=recording)

"""A robot that replays recordings: failures from the diagram, instances from a data set."""

from collections.abc import Callable

import numpy as np

from meal_bayes.datasets import Dataset, Instance
from meal_bayes.domain import Domain
from meal_bayes.errors import SettingsError
from meal_bayes.robots.robot import Execution
from meal_bayes.robots.walk import DiagramWalk

Supply = Callable[[int], list[list[int]]]

ANSWERED = -1  # the recording of an instance that a person answers


class RecordedRobot:
    """Replays each (object, behavior)'s recordings in random order, none twice in a trial.

    A failed execution uses no recording; when all are used, behaviors still move x and cost, but
    give no instance. The order of recordings and the failures are the same for every agent: the
    k-th execution of a behavior has its own luck.

    Parameters
    ----------
    recordings : R, how many each (object, behavior) has.
    order : draws the order of recordings at each `start`, or gives it: from the object to (E,)
        lists of the recordings to come, the next one last.
    dataset : whose features the instances carry; without it they carry none, and the perceiver
        looks percepts up by (object, behavior, recording).
    repeats : recordings never run out, each is drawn anew from all (for percepts that are drawn
        from tables).
    """

    def __init__(
        self,
        domain: Domain,
        recordings: int,
        order: np.random.Generator | Supply,
        dataset: Dataset | None = None,
        *,
        repeats: bool = False,
    ) -> None:
        if recordings < 1 or (dataset is not None and recordings > dataset.recordings):
            has = "1 or more" if dataset is None else f"1 to {dataset.recordings}"
            raise SettingsError(f"recordings = {recordings}; expected {has}.")
        self._domain, self._dataset = domain, dataset
        self._recordings, self._repeats = recordings, repeats
        self._order = order
        self._walk = DiagramWalk(domain)
        self._object = -1
        self._left: list[list[int]] = []  # (E,) recordings to come, the next one last

    def start(self, object_index: int) -> int:
        """Put the object in front of the robot, all recordings fresh, and return x0."""
        if object_index < 0 or (
            self._dataset is not None and object_index >= len(self._dataset.objects)
        ):
            raise SettingsError(f"Object {object_index} is not in the data set.")
        self._object = object_index
        if isinstance(self._order, np.random.Generator):
            luck = self._order.random((len(self._domain.behaviors), self._recordings))
            self._left = luck.argsort(axis=1).tolist()
        else:
            self._left = self._order(object_index)
        return self._walk.start()

    def execute(self, behavior: int, rng: np.random.Generator) -> Execution:
        """Execute a behavior; the instance is the next recording of it, if one is left."""
        move = self._walk.move(behavior, rng)
        if not move.perceivable:
            return Execution(move.next_x, None)
        kind = self._domain.behaviors[behavior]
        if not kind.modalities:
            return Execution(move.next_x, Instance(self._object, kind.name, ANSWERED))
        if self._repeats:
            recording = int(move.luck * self._recordings)
        elif self._left[behavior]:
            recording = self._left[behavior].pop()
        else:
            return Execution(move.next_x, None)
        if self._dataset is None:
            return Execution(move.next_x, Instance(self._object, kind.name, recording))
        return Execution(move.next_x, self._dataset.instance(self._object, kind.name, recording))

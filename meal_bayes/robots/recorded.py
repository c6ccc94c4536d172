"""A robot that replays recordings: failures from the diagram, percepts from a data set."""

from collections.abc import Callable, Iterable, Mapping

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.datasets import Dataset, PerceptTable
from meal_bayes.domain import Domain
from meal_bayes.robots.robot import Outcome
from meal_bayes.seeds import stream

Order = list[list[int]]  # (E,) lists of the recordings to come, the next one last

ANSWERED = -1  # the recording of a percept that a person answers
_BLOCK = 16  # executions of each behavior whose uniform draws are made at once


class RecordedRobot:
    """A robot that replays an object's recordings in random order, none twice in a trial.

    A failed execution uses no recording; when all are used, behaviors still change x and cost time,
    but sense nothing, as it is planned, too (`MOMDP.limit`). The k-th execution of a behavior has
    the same uniform draws whatever else was executed before: agents that are compared meet the same
    failures and the same order of recordings (common random numbers).

    There are so many `recordings` of each behavior, (E,) or one number. The `order` at each `start`
    is drawn, or given as lists (E,) of recordings, the next one last; `failures` are drawn by a
    generator of their own, in blocks for all behaviors at once. Outcomes have the features of a
    `dataset`; without one they have the recording's number, by which a perceiver looks percepts up.
    With `repeats` recordings never run out, each is drawn anew from all (for percepts that are
    drawn from tables). A `person` answers behaviors that ask, with an accuracy; without one a
    perceiver does.
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
        self._domain = domain
        self._dataset = dataset
        self._object = object_index
        self._recordings = np.broadcast_to(recordings, len(domain.behaviors))
        self._repeats = repeats
        self._person = person
        self._order = order
        self._failures = failures
        self._arrays = domain.diagram.compile(domain.behavior_names)

    @classmethod
    def of(
        cls,
        data: Dataset | PerceptTable,
        object_index: int,
        *,
        seed: int,
        key: Iterable[str | int],
        order: Order | None = None,
        repeats: bool = False,
        person: Callable[[float], Mapping[str, bool]] | None = None,
    ) -> "RecordedRobot":
        """Return the robot of one trial, which replays an object of recordings or of a table.

        The seed and the key of the trial's task name its random streams: of the failures, and of
        the order of recordings, unless that is given.
        """
        return cls(
            data.domain,
            object_index,
            replayable(data)[object_index],
            order=stream(seed, "recordings", *key) if order is None else order,
            failures=stream(seed, "robot", *key),
            dataset=data if isinstance(data, Dataset) else None,
            repeats=repeats,
            person=person,
        )

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,)."""
        return np.where(self._repeats, np.inf, self._recordings)

    def start(self) -> str:
        """Start a trial in x0, with all recordings unused."""
        if isinstance(self._order, np.random.Generator):
            size = len(self._recordings), int(self._recordings.max())
            orders = zip(self._order.random(size).argsort(axis=1), self._recordings, strict=True)
            self._unused: Order = [order[order < count].tolist() for order, count in orders]
        else:
            self._unused = [list(recordings) for recordings in self._order]
        diagram = self._domain.diagram
        names = self._domain.behavior_names
        self._x = diagram.states.index(diagram.start)
        self._executed = dict.fromkeys(names, 0)
        self._blocks = list[NDArray[np.float64]]()  # (E,_BLOCK,3) each
        return diagram.start

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior; a success senses its next recording, if one is left."""
        e = self._domain.behavior_index(behavior)
        spec = self._domain.behaviors[e]
        block, row = divmod(self._executed[behavior], _BLOCK)
        # Blocks for all behaviors at once: draws of one do not depend on how often others ran.
        while len(self._blocks) <= block:
            self._blocks.append(self._failures.random((len(self._executed), _BLOCK, 3)))
        self._executed[behavior] += 1
        transition_draw, sensing_draw, recording_draw = self._blocks[block][e, row].tolist()
        x = self._x
        cumulative = self._arrays.cumulative[e, x]
        self._x = int(cumulative.searchsorted(transition_draw, side="right"))
        outcome = Outcome(self._domain.diagram.states[self._x])
        if not spec.senses or sensing_draw >= self._arrays.observation_probability[e, x, self._x]:
            return outcome
        if not spec.modalities:
            if self._person is not None and spec.answer_accuracy is not None:
                return Outcome(outcome.state, answers=self._person(spec.answer_accuracy))
            return Outcome(outcome.state, recording=ANSWERED)
        if self._repeats and not isinstance(self._order, np.random.Generator):
            recording = self._unused[e].pop()
            self._unused[e].insert(0, recording)  # in their order, for ever
        elif self._repeats:
            recording = int(recording_draw * self._recordings.max())
        elif self._unused[e]:
            recording = self._unused[e].pop()
        else:
            return outcome
        if self._dataset is None:
            return Outcome(outcome.state, recording=recording)
        instance = self._dataset.instance(self._object, behavior, recording)
        return Outcome(outcome.state, instance.features, recording=recording)


def replayable(dataset: Dataset | PerceptTable) -> NDArray[np.int64]:
    """Return how many recordings of each behavior can be replayed, (O,E); R where it has none.

    Behaviors without modalities, such as asking a person, never run out before the others.
    """
    senses = [bool(behavior.modalities) for behavior in dataset.domain.behaviors]
    return np.where(senses, dataset.recording_counts, dataset.recordings)

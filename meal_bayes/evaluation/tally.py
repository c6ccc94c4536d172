"""What a report needs of many trials: their outcomes, and of the worst ones the whole trial."""

import heapq
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Trial
from meal_bayes.trial_log import Group, TrialOutcomes

WORST = 10  # trials that are kept whole


class Batch(NamedTuple):
    """Where a file of an online run belongs."""

    number: int
    part: str  # "train" or "test"


class Place(NamedTuple):
    """Where a trial stands."""

    file: Path
    number: int  # in the file


class Bad(NamedTuple):
    """One of the worst trials."""

    place: Place
    outcome: TrialOutcomes  # one row
    trial: Trial | None  # None of a compact log


class Tally:
    """Collects groups of trials as they are read."""

    def __init__(self) -> None:
        self.trials = 0
        self._parts: list[TrialOutcomes] = []
        self._batches: list[Batch | None] = []  # of the parts
        self._worst: list[tuple[float, int, Bad]] = []  # a heap, the least bad first

    def add(self, group: Group) -> None:
        """Count a group, and keep its worst trials."""
        outcomes = group.outcomes
        badness = np.where(outcomes.judged, outcomes.certainty - outcomes.reward, -np.inf)
        for row in np.argsort(-badness, kind="stable")[:WORST].tolist():
            if badness[row] > -np.inf:
                trial = group.trials[row] if group.trials else None
                bad = Bad(Place(group.file, group.places[row]), outcomes.rows([row]), trial)
                item = (float(badness[row]), -self.trials - row, bad)
                if len(self._worst) < WORST:
                    heapq.heappush(self._worst, item)
                else:
                    heapq.heappushpop(self._worst, item)
        self._parts.append(outcomes)
        self._batches.append(batch_of(group.header))
        self.trials += len(outcomes)

    @property
    def worst(self) -> list[Bad]:
        """The trials with the lowest reward; of equals, those that were surest, then the first."""
        return [bad for _, _, bad in sorted(self._worst, key=lambda item: item[:2], reverse=True)]

    def outcomes(self) -> TrialOutcomes:
        """Return the outcomes of all trials."""
        return TrialOutcomes.join(self._parts)

    def batches(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the batch of each trial, (n,), -1 where it has none; and whether it is a test."""
        sizes = list(map(len, self._parts))
        number = [-1 if batch is None else batch.number for batch in self._batches]
        test = [batch is not None and batch.part == "test" for batch in self._batches]
        return np.repeat(number, sizes), np.repeat(test, sizes)


def batch_of(header: Mapping[str, object]) -> Batch | None:
    """Read the batch of an online run from a log's header: `batch`, and `part` train or test."""
    number, part = header.get("batch"), header.get("part")
    if isinstance(number, int) and part in ("train", "test"):
        return Batch(number, str(part))
    return None

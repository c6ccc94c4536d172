"""Outcomes of all trials of a report, and whole trials of those with the lowest reward."""

import heapq
from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.trial_log import Group
from meal_bayes.trials import Trial, TrialOutcomes

WORST = 10  # trials that are kept whole


class Batch(NamedTuple):
    """Place of a file in an online run."""

    number: int
    part: str  # "train" or "test"


class Worst(NamedTuple):
    """One of the trials with the lowest reward.

    Attributes
    ----------
    number : int
        Of the trial in its file.
    outcome : TrialOutcomes
        One row.
    trial : Trial | None
        None of a compact log.
    """

    file: Path
    number: int
    outcome: TrialOutcomes
    trial: Trial | None


class Collected:
    """What has been read of the logs of a report."""

    def __init__(self) -> None:
        self.trials = 0
        self._parts: list[TrialOutcomes] = []
        self._batches: list[Batch | None] = []  # of the parts
        self._worst: list[tuple[float, int, Worst]] = []  # a heap, the least bad first

    def add(self, group: Group) -> None:
        """Add a group, and keep its worst trials."""
        outcomes = group.outcomes
        badness = np.where(outcomes.judged, outcomes.certainty - outcomes.reward, -np.inf)
        for row in np.argsort(-badness, kind="stable")[:WORST].tolist():
            if badness[row] > -np.inf:
                trial = group.trials[row] if group.trials else None
                bad = Worst(group.file, group.places[row], outcomes.rows([row]), trial)
                item = (float(badness[row]), -self.trials - row, bad)
                if len(self._worst) < WORST:
                    heapq.heappush(self._worst, item)
                else:
                    heapq.heappushpop(self._worst, item)
        self._parts.append(outcomes)
        self._batches.append(batch_of(group.header))
        self.trials += len(outcomes)

    @property
    def worst(self) -> list[Worst]:
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

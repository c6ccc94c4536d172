"""Outcomes of all trials of a report, and whole trials of those with the lowest reward."""

from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.trial_log import Group
from meal_bayes.trials import Trial, TrialOutcomes

WORST = 10  # trials that are kept whole


class Worst(NamedTuple):
    """One of the trials with the lowest reward, with its number in its file.

    `outcome` has one row; `trial` is None of a compact log; `badness` is the belief in the report
    less the reward.
    """

    file: Path
    number: int
    outcome: TrialOutcomes
    trial: Trial | None
    badness: float


class Collected:
    """Outcomes of the logs of a report so far, and the worst trials.

    Those have the lowest reward; of equals, those that were surest come first, then the earliest.
    """

    def __init__(self) -> None:
        self.worst: list[Worst] = []
        self._parts: list[TrialOutcomes] = []
        self._batches: list[tuple[int, bool]] = []  # of the parts: number, whether it is a test

    def add(self, group: Group) -> None:
        """Add a group, and keep its worst trials."""
        outcomes = group.outcomes
        badness = np.where(outcomes.judged, outcomes.certainty - outcomes.reward, -np.inf)
        for row in np.argsort(-badness, kind="stable")[:WORST].tolist():
            if badness[row] > -np.inf:
                trial = group.trials[row] if group.trials else None
                self.worst.append(
                    Worst(group.file, group.places[row], outcomes.rows([row]), trial, badness[row])
                )
        self.worst = sorted(self.worst, key=lambda worst: -worst.badness)[:WORST]
        # An online run names the batch of a log, and its part, in the header.
        number, part = group.header.get("batch"), group.header.get("part")
        online = isinstance(number, int) and part in ("train", "test")
        self._batches.append((number, part == "test") if online else (-1, False))  # type: ignore[arg-type]
        self._parts.append(outcomes)

    def outcomes(self) -> TrialOutcomes:
        """Return the outcomes of all trials."""
        return TrialOutcomes.join(self._parts)

    def batches(self) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
        """Return the batch of each trial, (n,), -1 where it has none; and whether it is a test."""
        number, test = np.array(self._batches).T
        sizes = list(map(len, self._parts))
        return np.repeat(number, sizes), np.repeat(test.astype(bool), sizes)

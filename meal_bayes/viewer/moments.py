"""The rows of a replay: every trial before any behavior, then once after each step."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.trial import Step, Trial


class Moment(NamedTuple):
    """One row: what is known once a step is done, and why it was done."""

    row: int  # on the timeline `step`
    trial_number: int  # on the timeline `trial`: position in the log
    seconds: float  # on the timeline `sim_time`: of robot time when the step began
    trial: Trial
    number: int  # 0 = before any behavior, i = the i-th step
    step: Step | None  # None before any behavior
    before: NDArray[np.float64]  # (N,) Pr(attribute is true) before the step
    positive: NDArray[np.float64]  # (N,) and after it
    x: int  # where the robot is
    spent: float  # s, in this trial so far

    @property
    def last(self) -> bool:
        """Whether the trial ends here."""
        return self.number == len(self.trial.steps)

    @property
    def entropy(self) -> float:
        """Entropy of the belief, bits."""
        p = np.clip(self.positive, 1e-300, 1.0)
        q = np.clip(1.0 - self.positive, 1e-300, 1.0)
        return float(-(p * np.log2(p) + q * np.log2(q)).sum())


@dataclass
class Clock:
    """Counts rows and robot time over the trials of a run; between two trials one row is free.

    `trial` is the position in the log; `step` runs on over all trials that are shown; `sim_time`
    adds up the seconds that behaviors took, each row standing where its step began.
    """

    row: int = 0
    seconds: float = field(default=0.0)

    def moments(self, number: int, trial: Trial) -> Iterator[Moment]:
        """Give the rows of the next trial."""
        start, before = self.seconds, trial.first_belief.positive
        x = trial.first_belief.x
        yield Moment(self.row, number, start, trial, 0, None, before, before, x, 0.0)
        spent = 0.0
        for index, step in enumerate(trial.steps, start=1):
            self.row += 1
            spent += step.cost
            began, after = start + spent - step.cost, step.belief.positive
            yield Moment(
                self.row, number, began, trial, index, step, before, after, step.next_x, spent
            )
            before = after
        self.row += 2
        self.seconds = start + spent

"""The rows of a recording: every trial before any behavior, then once after each step."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import Belief
from meal_bayes.trials import Step, Trial


class Time(NamedTuple):
    """Where a row stands on each timeline: position of the trial in its log, row, s."""

    trial: int
    step: int
    sim_time: float


class TrialFrame(NamedTuple):
    """One row: the belief after a step, and the decision behind it.

    Attributes
    ----------
    time : Time
        When the step began.
    number : int
        0 before any behavior, whose `step` is None; i after the i-th step.
    before, positive : NDArray[np.float64]
        (N,) Pr(attribute is true) before and after the step.
    x : int
        Index of the robot's state after the step.
    spent : float
        s, cost of the trial so far.
    """

    time: Time
    trial: Trial
    number: int
    step: Step | None
    before: NDArray[np.float64]
    positive: NDArray[np.float64]
    x: int
    spent: float

    @property
    def last(self) -> bool:
        """Whether the trial ends here."""
        return self.number == len(self.trial.steps)

    @property
    def belief(self) -> Belief:
        """The belief after the step."""
        return self.trial.first_belief if self.step is None else self.step.belief


@dataclass
class Clock:
    """Counter of rows and robot time over the trials of a run.

    One row is left free between two trials. `sim_time` adds up the seconds that behaviors took;
    each row stands where its step began.
    """

    row: int = 0
    seconds: float = 0.0

    def frames(self, number: int, trial: Trial) -> Iterator[TrialFrame]:
        """Yield the rows of the next trial, whose position in the log is `number`."""
        start, spent, before = self.seconds, 0.0, trial.first_belief.positive
        time, x = Time(number, self.row, start), trial.first_belief.x
        yield TrialFrame(time, trial, 0, None, before, before, x, spent)
        for index, step in enumerate(trial.steps, start=1):
            self.row += 1
            time, after = Time(number, self.row, start + spent), step.belief.positive
            spent += step.cost
            yield TrialFrame(time, trial, index, step, before, after, step.next_x, spent)
            before = after
        self.row += 2
        self.seconds = start + spent

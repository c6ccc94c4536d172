"""Who writes a trial down while it happens."""

from pathlib import Path
from typing import Protocol

from meal_bayes.trials.record import Step
from meal_bayes.trials.trial import Trial


class Recorder(Protocol):
    """Writes a trial as it happens: each step before the next behavior is named."""

    @property
    def path(self) -> Path:
        """Where the trial is recorded."""

    def begin(self, trial: Trial) -> None:
        """Record a trial that has no steps yet."""

    def step(self, step: Step) -> None:
        """Record the next step."""

    def end(self, trial: Trial) -> None:
        """Record the whole trial."""

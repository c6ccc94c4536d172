"""Who writes a trial down while it happens."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol, runtime_checkable

from meal_bayes.errors import LogError
from meal_bayes.files import command_line
from meal_bayes.trials.record import Step
from meal_bayes.trials.trial import Trial


@runtime_checkable
class Recorder(Protocol):
    """Writes a trial as it happens: each step before the next behavior is named.

    Examples
    --------
    >>> import meal_bayes
    >>> from pathlib import Path
    >>> class Printed:
    ...     path = Path("nowhere")
    ...     def begin(self, trial):
    ...         print("asked", trial.task.query.attributes)
    ...     def step(self, step):
    ...         print("executed", step.decision.action)
    ...     def end(self, trial):
    ...         print("reported", trial.report)
    >>> isinstance(Printed(), meal_bayes.Recorder)
    True
    """

    @property
    def path(self) -> Path:
        """Where the trial is recorded."""

    def begin(self, trial: Trial) -> None:
        """Record a trial that has no steps yet."""

    def step(self, step: Step) -> None:
        """Record the next step."""

    def end(self, trial: Trial) -> None:
        """Record the whole trial."""


@contextmanager
def breaking(end: Callable[[BaseException], None]) -> Iterator[None]:
    """End a trial where the block raises: the robot has moved, and nobody may wait for it."""
    try:
        yield
    except BaseException as fault:
        end(fault)
        raise


@contextmanager
def noted(fault: BaseException, recorder: Recorder | None) -> Iterator[None]:
    """Let the block end a trial that a fault broke off, and note at the fault where its log is."""
    try:
        yield
    except LogError as unlogged:  # as where the disk is full: the fault itself says why
        fault.add_note(f"the end of the trial is not logged: {unlogged}")
    else:
        if recorder is not None:
            show = command_line("meal-bayes log show", recorder.path)
            fault.add_note(f"the trial, as far as it went: {show}")

"""What a learner knows from a percept table: objects are replayed, each left out of what is known.

A table holds, for every object, what robots learned that never met it. So a label told of an object
that lacked it teaches of all others by all of the object's recordings, and nothing is approximated.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from meal_bayes.agents import Agent, Knowledge, OfflineRunner, Recorder, Step, Task, Trial
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.errors import SettingsError
from meal_bayes.learner.lesson import Lesson, labels_of
from meal_bayes.momdp import MOMDP
from meal_bayes.posterior import ConfusionPosterior


@dataclass(slots=True)
class Replayed:
    """Knowledge of a percept table and of lessons."""

    table: PerceptTable
    agent: Agent
    seed: int
    percepts: str
    reward: float | None
    given: ConfusionPosterior | None
    _runner: OfflineRunner | None = field(default=None)

    def learn(self, lessons: Sequence[Lesson]) -> None:
        """Take the lessons of objects in the table for labels."""
        told = None
        if lessons:
            told = np.full(self.table.labels.shape, -1, np.int8)
            for name, labels in labels_of(lessons, self.table.domain).items():
                told[object_index(self.table.objects, name)] = labels
        self._runner = OfflineRunner(
            self.table, self.agent, self.seed, self.percepts, self.reward, told, self.given
        )

    def known(self, object_name: str | None) -> Knowledge:
        """Return what is known without an object."""
        if object_name is None:
            raise SettingsError("A percept table holds only what is known without an object of it.")
        return self._ready().knowledge(object_index(self.table.objects, object_name))

    def run(
        self,
        task: Task,
        *,
        on_step: Callable[[Step], None] | None = None,
        recorder: Recorder | None = None,
    ) -> Trial:
        """Answer a task about an object of the table."""
        return self._ready().run(task, on_step=on_step, recorder=recorder)

    def problem(self, task: Task) -> MOMDP:
        """Build the decision problem of a task."""
        return self._ready().prepare(task)[0]

    def _ready(self) -> OfflineRunner:
        if self._runner is None:
            self.learn(())
        return self._runner  # type: ignore[return-value]  # just made

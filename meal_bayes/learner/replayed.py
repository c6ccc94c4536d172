"""What is learned from a percept table: objects are replayed, each left out of the training set.

A table holds the percepts of every object, by classifiers trained without it. So a label given to
an object without one adds all of the object's recordings to what is learned of others, exactly.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

import numpy as np

from meal_bayes.agents import Agent, Knowledge, OfflineRunner, Recorder, Step, Task, Trial
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.errors import SettingsError
from meal_bayes.learner.labeled_trial import LabeledTrial, labels_of
from meal_bayes.momdp import MOMDP
from meal_bayes.posterior import ConfusionPosterior


@dataclass(slots=True)
class Replayed:
    """Knowledge from a percept table and from labeled trials; see `Fitted` for the attributes."""

    table: PerceptTable
    agent: Agent
    seed: int
    percepts: str
    reward: float | None
    given: ConfusionPosterior | None
    _runner: OfflineRunner | None = field(default=None)

    def learn(self, labeled_trials: Sequence[LabeledTrial]) -> None:
        """Use the labels that were given to objects of the table."""
        given = None
        if labeled_trials:
            given = np.full(self.table.labels.shape, -1, np.int8)
            for name, labels in labels_of(labeled_trials, self.table.domain).items():
                given[object_index(self.table.objects, name)] = labels
        self._runner = OfflineRunner(
            self.table, self.agent, self.seed, self.percepts, self.reward, given, self.given
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

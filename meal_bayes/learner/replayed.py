"""What is learned from a percept table: objects are replayed, each left out of the training set.

A table holds the percepts of every object, by classifiers trained without it. So a label given to
an object without one adds all of the object's recordings to what is learned of others, exactly.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from meal_bayes.agents import Agent, Knowledge, OfflineRunner
from meal_bayes.datasets import PerceptTable, object_index
from meal_bayes.errors import SettingsError
from meal_bayes.learner.labeled_trial import LabeledTrial, labels_of
from meal_bayes.posterior import ConfusionPosterior


@dataclass(slots=True)
class Replayed:
    """Knowledge from a percept table and from labeled trials; see `Fitted` for the attributes.

    `runner` runs trials with the labels that `learn` got last.
    """

    table: PerceptTable
    agent: Agent
    seed: int
    percepts: str
    reward: float | None
    given: ConfusionPosterior | None
    runner: OfflineRunner = field(init=False)

    def learn(self, labeled_trials: Sequence[LabeledTrial]) -> None:
        """Use the labels that were given to objects of the table."""
        labels = None
        if labeled_trials:
            labels = np.full(self.table.labels.shape, -1, np.int8)
            for name, own in labels_of(labeled_trials, self.table.domain).items():
                labels[object_index(self.table.objects, name)] = own
        self.runner = OfflineRunner(
            self.table, self.agent, self.seed, self.percepts, self.reward, labels, self.given
        )

    def known(self, object_name: str | None) -> Knowledge:
        """Return what is learned without an object."""
        if object_name is None:
            raise SettingsError("A percept table holds only what is known without an object of it.")
        return self.runner.knowledge(object_index(self.table.objects, object_name))

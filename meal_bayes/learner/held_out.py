"""What an agent knows of an object of a percept table: all that its other objects show (Alg. 1)."""

from collections import OrderedDict
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Agent, Knowledge, Progress, information_value, knowledge_without
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Query
from meal_bayes.learner.fitted import progress_of, some_labels
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.perception import Perceiver, RecordedPercepts, SampledPercepts
from meal_bayes.robots import replayable
from meal_bayes.trials import Task

_KEPT = 64  # policies; one over a grid of three attributes takes more than a megabyte


class Recent(OrderedDict[Any, Any]):
    """A dictionary of the entries that were used lately."""

    def __getitem__(self, key: Any) -> Any:
        self.move_to_end(key)
        return super().__getitem__(key)

    def __setitem__(self, key: Any, value: Any) -> None:
        super().__setitem__(key, value)
        if len(self) > _KEPT:
            self.popitem(last=False)


@dataclass(eq=False)
class HeldOut:
    """Knowledge of one agent about one object, of which neither recordings nor labels enter it.

    Attributes
    ----------
    table : PerceptTable
        With labels that were told of objects that had none.
    agent : Agent
        Its levels and its view of objects decide what is learned.
    settings : LearnerSettings
        Of the learner.
    object_index : int
        Which object is left out.
    told : NDArray[np.int8]
        (P,) int array Labels that people gave to it; -1 unknown.
    answering, exploring : Recent
        Models and policies of queries about any object, without and with a bonus.
    """

    table: PerceptTable
    agent: Agent
    settings: LearnerSettings
    object_index: int
    told: NDArray[np.int8]
    answering: Recent
    exploring: Recent

    @cached_property
    def knowledge(self) -> Knowledge:
        """What is learned from all objects but this one."""
        known = knowledge_without(
            self.table, self.object_index, levels=self.agent.levels,
            object_level=self.agent.object_level,
        )  # fmt: skip
        own = self.settings.posterior
        return known if own is None else replace(known, posterior=own)

    @property
    def limit(self) -> NDArray[np.float64]:
        """Percepts of each behavior that a trial can have, (E,)."""
        counts = replayable(self.table)[self.object_index]
        return np.where(self.settings.percepts == "recorded", counts, np.inf)

    @cached_property
    def perceiver(self) -> Perceiver:
        """What shows percepts: classifiers that never saw the object, or the model itself."""
        table = self.table
        if self.settings.percepts == "recorded":
            return RecordedPercepts(table, self.agent.levels)
        every = range(len(table.domain.attributes))
        confusion, _ = self.knowledge.posterior.select(every, exact=True)
        return SampledPercepts(table.domain, table.labels, confusion)

    @cached_property
    def information(self) -> NDArray[np.float64]:
        """Value of information (P,E), s a query."""
        return information_value(
            self.knowledge, reward=self.settings.reward, discount=self.agent.discount
        )

    def place(self, query: Query, limit: NDArray[np.float64]) -> tuple[Any, ...]:
        """Return what a model depends on."""
        return query, limit.tobytes(), id(self)

    def labels_of(self, task: Task) -> NDArray[np.int8] | None:
        """Return the labels (N,) that were told of the object; None where none was."""
        return some_labels(self.told[self.table.domain.columns(task.query.attributes)])

    def progress(self, object_name: str | None, queries: float) -> Progress:
        """Return what the other objects have shown so far, for a bonus."""
        shown = replayable(self.table).copy()
        shown[self.object_index] = 0
        labelled = shown[..., None] * (self.table.labels >= 0)[:, None]
        memory = self.agent.memory and object_name is not None
        return progress_of(
            self, labelled, labelled * self.settings.count_given, queries,
            fresh=np.ones(labelled.shape[:0:-1], np.bool_), labeled=(self.told >= 0) & memory,
        )  # fmt: skip

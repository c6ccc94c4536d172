"""Algorithm 1: replays of an object of a percept table, with knowledge from other objects only."""

from contextlib import AbstractContextManager
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.agents import Agent, Knowledge, knowledge_without
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Query
from meal_bayes.learner.experience import Context, Experience, Labels, Objects
from meal_bayes.learner.fit import OnStep, problem_of, sampled, solve
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.learner.views import labeled_table
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver, RecordedPercepts
from meal_bayes.planners import Policy
from meal_bayes.robots.recorded import RecordedRobot, replayable
from meal_bayes.seeds import Key
from meal_bayes.trials import Task


@dataclass(eq=False)
class HeldOut:
    """Knowledge of one agent for one object, learned without this object's recordings and labels.

    A label that a person gives for an object of the table replaces the table's.
    """

    record: Experience
    agent: Agent
    settings: LearnerSettings
    table: PerceptTable
    object_index: int  # of the object that is left out
    beside: Objects = ()  # other objects that `find` asks about; their labels are unknown, too
    _problems: dict[tuple[object, ...], MOMDP] = field(default_factory=dict)

    @cached_property
    def labeled(self) -> PerceptTable:
        """The percept table, with later labels of its objects."""
        return labeled_table(self.record, self.table)

    @cached_property
    def knowledge(self) -> Knowledge:
        """What is learned from all objects except this one and its alternatives.

        The alternatives are the other objects of a search (`Learner.find`), whose labels must not
        be used either.
        """
        knowledge = knowledge_without(
            self.labeled,
            self.object_index,
            unlabeled=self.beside,
            levels=self.agent.levels,
            object_level=self.agent.object_level,
        )
        posterior = self.settings.posterior
        return knowledge if posterior is None else replace(knowledge, posterior=posterior)

    @property
    def limit(self) -> NDArray[np.float64]:
        """Number of recordings of each behavior, (E,); unlimited for percepts from the model."""
        counts = replayable(self.table)[self.object_index]
        return np.where(self.settings.percepts == "recorded", counts, np.inf)

    @cached_property
    def perceiver(self) -> Perceiver:
        """The perceiver: classifiers that were trained without the object, or the model itself."""
        if self.settings.percepts == "recorded":
            return RecordedPercepts(self.labeled, self.agent.levels)
        return sampled(self.knowledge, self.labeled.labels)

    def truth(self, query: Query) -> Labels:
        """Return the labels (N,) of the object; -1 unknown."""
        columns = self.record.domain.columns(query.attributes)
        return np.asarray(self.labeled.labels[self.object_index, columns])

    @property
    def teaches(self) -> bool:
        """False, because the recordings of a replay are known already."""
        return False

    @property
    def expected_sizes(self) -> dict[Context, int]:
        """Empty, because a percept table contains percepts and no features."""
        return {}

    def perceiving(
        self, task: Task, momdp: MOMDP, lock: AbstractContextManager[Any], on_step: OnStep
    ) -> tuple[Perceiver, OnStep]:
        """Return the perceiver of a trial, which records nothing."""
        return self.perceiver, on_step

    def problem(self, task: Task, limit: ArrayLike) -> MOMDP:
        """Return the MOMDP of a task, which is built once for repeated tasks."""
        if not np.isinf(limit).all():
            return problem_of(self, task, limit)
        key = task.query, task.query.group_names
        if key not in self._problems:
            self._problems[key] = problem_of(self, task)
        return self._problems[key]

    def plan(
        self, task: Task, streams: Key, *, limit: ArrayLike, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task (Algorithm 1, lines 1-5), without exploration."""
        momdp = problem_of(self, task, limit)
        return momdp, solve(self, task, (task.object_name, *task.query.attributes), momdp)


def replay(table: PerceptTable, task: Task, seed: int, *, repeats: bool) -> RecordedRobot:
    """Return the robot that replays the object of a task; a seed names its draws."""
    return RecordedRobot.of(table, task.object_index, seed=seed, key=task.key, repeats=repeats)

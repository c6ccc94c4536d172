"""Algorithm 1: from a query to a report, about an object left out of everything learned."""

from collections import OrderedDict
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.datasets import PerceptTable
from meal_bayes.display import short_repr
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver, RecordedPercepts, SampledPercepts
from meal_bayes.planners import Policy
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.robots import Boundary, RecordedRobot, replayable
from meal_bayes.seeds import stream
from meal_bayes.trials import Environment, Session, Streams, Task, Trial, run_trial

_PERCEPTS = ("recorded", "model")
_KEPT = 64  # policies; one over a grid of three attributes takes more than a megabyte


@dataclass(slots=True)
class OfflineRunner:
    """Runs trials of one agent on a percept table; keeps posteriors, and policies used lately.

    With ``percepts="recorded"`` a percept is a held-out classifier's output on a real recording,
    none used twice in a trial. With ``"model"`` it is drawn from the learned confusion matrices,
    as in the authors' published simulator: then accuracy is the model's own expectation.

    Attributes
    ----------
    table : held-out percepts and true labels.
    agent : who decides.
    seed : of all random streams.
    percepts : "recorded" or "model".
    reward : r+ = -r-, the domain's by default.
    labels : (O,P) that people gave to objects met before; -1 unknown.
    given : posterior of one's own, in place of what the table's other objects imply.
    """

    table: PerceptTable
    agent: Agent
    seed: int
    percepts: str = "recorded"
    reward: float | None = None
    labels: NDArray[np.int8] | None = None
    given: ConfusionPosterior | None = None
    _knowledge: dict[int, Knowledge] = field(default_factory=dict)
    _policies: OrderedDict[tuple[int, tuple[str, ...]], tuple[MOMDP, Policy]] = field(
        default_factory=OrderedDict
    )

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.percepts not in _PERCEPTS:
            raise SettingsError(unknown("percepts", self.percepts, _PERCEPTS))
        if self.labels is not None:  # a label of an object without one is training data of others
            labels = np.where(self.table.labels < 0, self.labels, self.table.labels)
            self.table = replace(self.table, labels=labels)

    def run(self, task: Task, **options: Any) -> Trial:
        """Run one trial (Alg. 1). Equal seeds and tasks give equal trials.

        Parameters
        ----------
        task : Task
            What is asked, of which object.
        options :
            Of `Session`.
        """
        momdp, policy = self.prepare(task)
        session = Session(
            task, momdp, policy, self.environment(task), agent=self.agent.name, **options
        )
        return run_trial(session, self.robot(task))

    def problem(self, task: Task) -> MOMDP:
        """Build the query's MOMDP from what is known without the object."""
        counts = replayable(self.table)[task.object_index]
        columns, known = self.table.domain.columns(task.query.attributes), None
        if self.labels is not None and self.agent.memory:
            known = self.labels[task.object_index, columns]
        return self.agent.model(
            task.query,
            self.knowledge(task.object_index),
            limit=counts if self.percepts == "recorded" else np.inf,
            reward=self.reward,
            labels=known,
        )

    def prepare(self, task: Task) -> tuple[MOMDP, Policy]:
        """Build and solve the query's MOMDP; policies used lately are kept."""
        key = (task.object_index, task.query.attributes)
        if key not in self._policies:
            momdp, solver = self.problem(task), self.agent.solver(self.table.domain, task.query)
            rng = stream(self.seed, "solver", self.agent.name, task.object_name, *key[1])
            self._policies[key] = momdp, solver.solve(momdp, rng)
            if len(self._policies) > _KEPT:
                self._policies.popitem(last=False)
        self._policies.move_to_end(key)
        return self._policies[key]

    def knowledge(self, held_out: int) -> Knowledge:
        """Return what is learned from all objects but one; learned once."""
        if held_out not in self._knowledge:
            known = knowledge_without(
                self.table,
                held_out,
                levels=self.agent.levels,
                object_level=self.agent.object_level,
            )
            if self.given is not None:
                known = replace(known, posterior=self.given)
            self._knowledge[held_out] = known
        return self._knowledge[held_out]

    def robot(self, task: Task) -> RecordedRobot:
        """Return a robot that replays the task's object, with random streams of the trial's own."""
        return RecordedRobot(
            self.table.domain,
            task.object_index,
            replayable(self.table)[task.object_index],
            stream(self.seed, "recordings", *task.key),
            stream(self.seed, "robot", *task.key),
            repeats=self.percepts == "model",
        )

    def environment(self, task: Task) -> Environment:
        """Return the environment of a trial, with random streams of the trial's own."""
        domain = self.table.domain
        columns = domain.columns(task.query.attributes)
        return Environment(
            Boundary(domain, object_index=task.object_index),
            self._perceiver(task),
            Streams.of(self.seed, task.key, self.agent.name),
            self.table.labels[task.object_index, columns],
            self.knowledge(task.object_index).posterior.counts[columns],
        )

    def _perceiver(self, task: Task) -> Perceiver:
        if self.percepts == "recorded":
            return RecordedPercepts(self.table, self.agent.levels)
        every = range(len(self.table.domain.attributes))
        confusion, _ = self.knowledge(task.object_index).posterior.select(every, exact=True)
        return SampledPercepts(self.table.domain, self.table.labels, confusion)

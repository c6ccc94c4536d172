"""Algorithm 1: from a query to a report, about an object left out of everything learned."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.agent import Agent
from meal_bayes.agents.knowledge import Knowledge, knowledge_without
from meal_bayes.agents.trial import Recorder, Step, Streams, Task, Trial, run_trial
from meal_bayes.datasets import PerceptTable
from meal_bayes.display import short_repr
from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver, recorded_percepts, sampled_percepts
from meal_bayes.planners import Policy
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.robots import CheckedRobot, RecordedRobot
from meal_bayes.seeds import stream

_PERCEPTS = ("recorded", "model")
_KEPT = 64  # policies; one over a grid of three attributes takes more than a megabyte


@dataclass(slots=True)
class OfflineRunner:
    """Runs trials of one agent on a percept table; keeps posteriors, and policies used lately.

    With ``percepts="recorded"`` a percept is a held-out classifier's output on a real recording,
    none used twice in a trial. With ``"model"`` it is drawn from the learned confusion matrices,
    as in the authors' published simulator: then accuracy is the model's opinion of itself.
    """

    table: PerceptTable
    agent: Agent
    seed: int
    percepts: str = "recorded"
    reward: float | None = None  # r+ = -r-, the domain's by default
    told: NDArray[np.int8] | None = None  # (O,P) what people told of objects met before; -1 nothing
    given: ConfusionPosterior | None = None  # of one's own, in place of what the others' say
    _knowledge: dict[int, Knowledge] = field(default_factory=dict)
    _policies: OrderedDict[tuple[int, tuple[str, ...]], tuple[MOMDP, Policy]] = field(
        default_factory=OrderedDict
    )

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if self.percepts not in _PERCEPTS:
            raise SettingsError(unknown("percepts", self.percepts, _PERCEPTS))
        if self.told is not None:  # what is told of an unlabelled object teaches of others
            labels = np.where(self.table.labels < 0, self.told, self.table.labels)
            self.table = replace(self.table, labels=labels)

    def run(
        self,
        task: Task,
        *,
        on_step: Callable[[Step], None] | None = None,
        recorder: Recorder | None = None,
    ) -> Trial:
        """Run one trial (Alg. 1). Equal seeds and tasks give equal trials."""
        columns = self.table.domain.columns(task.query.attributes)
        momdp, policy = self.prepare(task)
        return run_trial(
            task,
            momdp,
            policy,
            self.robot(task),
            self.perceiver(task),
            Streams.of(self.seed, task, self.agent.name),
            truth=self.table.labels[task.object_index, columns],
            agent=self.agent.name,
            on_step=on_step,
            recorder=recorder,
        )

    def prepare(self, task: Task) -> tuple[MOMDP, Policy]:
        """Build and solve the query's MOMDP from what is known without the object."""
        key = (task.object_index, task.query.attributes)
        if key not in self._policies:
            limit = self._recordings(task) if self.percepts == "recorded" else np.inf
            columns = self.table.domain.columns(key[1])
            rng = stream(self.seed, "solver", self.agent.name, task.object_name, *key[1])
            self._policies[key] = self.agent.prepare(
                task.query,
                self.knowledge(task.object_index),
                rng,
                limit=limit,
                reward=self.reward,
                told=None if self.told is None else self.told[task.object_index, columns],
            )
            if len(self._policies) > _KEPT:
                self._policies.popitem(last=False)
        self._policies.move_to_end(key)
        return self._policies[key]

    def knowledge(self, held_out: int) -> Knowledge:
        """Learn from all objects but one, once."""
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

    def _recordings(self, task: Task) -> NDArray[np.int64]:
        """Return how many recordings of each behavior the object has, (E,)."""
        senses = [bool(behavior.modalities) for behavior in self.table.domain.behaviors]
        counts = self.table.recording_counts[task.object_index]
        return np.where(senses, counts, self.table.recordings)

    def robot(self, task: Task) -> CheckedRobot:
        """Return the body of a trial, with random streams of the trial's own."""
        domain = self.table.domain
        robot = RecordedRobot(
            domain,
            task.object_index,
            self._recordings(task),
            stream(self.seed, "recordings", *task.key),
            stream(self.seed, "robot", *task.key),
            repeats=self.percepts == "model",
        )
        return CheckedRobot(robot, domain, object_index=task.object_index)

    def perceiver(self, task: Task) -> Perceiver:
        """Return the perceiver of a trial."""
        if self.percepts == "recorded":
            return recorded_percepts(self.table, self.agent.levels)
        every = range(len(self.table.domain.attributes))
        confusion, _ = self.knowledge(task.object_index).posterior.select(every, exact=True)
        return sampled_percepts(self.table.domain, self.table.labels, confusion)

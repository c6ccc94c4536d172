"""What a report needs of many trials, taken one by one: small rows, and whole only the worst."""

import heapq
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

import numpy as np

from meal_bayes.agents.trial import Step, Trial
from meal_bayes.momdp import Belief
from meal_bayes.planners import unvalued

WORST = 10  # trials that are kept whole


@dataclass(frozen=True, slots=True)
class Batch:
    """Where a file of an online run belongs."""

    number: int
    part: str  # "train" or "test"


class Place(NamedTuple):
    """Where a trial stands."""

    file: Path
    number: int  # in the file


@dataclass
class AgentTally:
    """The trials of one agent."""

    trials: list[Trial] = field(default_factory=list)  # in brief
    executed: Counter[str] = field(default_factory=Counter)  # by behavior
    failed: Counter[str] = field(default_factory=Counter)  # of those, without a percept
    asked: Counter[str] = field(default_factory=Counter)  # by attribute
    right: Counter[str] = field(default_factory=Counter)
    train_cost: dict[int, float] = field(default_factory=dict)  # s, by batch
    tested: dict[int, list[bool]] = field(default_factory=dict)  # successes, by batch


class Tally:
    """Counts trials as they are read."""

    def __init__(self) -> None:
        self.agents: dict[str, AgentTally] = {}
        self.behaviors: dict[str, None] = {}  # in the order of the domain
        self.trials = self.steps = 0
        self.objects: set[str] = set()
        self._worst: list[tuple[float, int, Place, Trial]] = []  # a heap, the least bad first

    @property
    def worst(self) -> list[tuple[Place, Trial]]:
        """The trials with the lowest reward; of equals, those that were surest, then the first."""
        ordered = sorted(self._worst, key=lambda item: item[:2], reverse=True)
        return [(place, trial) for _, _, place, trial in ordered]

    def add(self, trial: Trial, place: Place, batch: Batch | None = None) -> None:
        """Count a trial."""
        agent = self.agents.setdefault(trial.agent or "agent", AgentTally())
        agent.trials.append(_brief(trial))
        names = trial.momdp.behavior_names
        self.behaviors.update(dict.fromkeys(names))
        for step in trial.steps:
            action = step.decision.action
            if action < len(names):
                agent.executed[names[action]] += 1
                agent.failed[names[action]] += step.observation is None
        if not trial.ended:
            _count_answers(agent, trial)
        if batch is not None:
            self._in_batch(agent, trial, batch)
        if trial.judged:
            badness = trial.last_belief.certainty - trial.reward
            item = (badness, -self.trials, place, trial)
            if len(self._worst) < WORST:
                heapq.heappush(self._worst, item)
            else:
                heapq.heappushpop(self._worst, item)
        self.objects.add(trial.task.object_name)
        self.trials, self.steps = self.trials + 1, self.steps + len(trial.steps)

    @staticmethod
    def _in_batch(agent: AgentTally, trial: Trial, batch: Batch) -> None:
        if batch.part == "test":
            if trial.success is not None:
                agent.tested.setdefault(batch.number, []).append(trial.success)
        else:
            spent = agent.train_cost.get(batch.number, 0.0)
            agent.train_cost[batch.number] = spent + trial.cost


def batch_of(header: Mapping[str, object]) -> Batch | None:
    """Read the batch of an online run from a log's header: `batch`, and `part` train or test."""
    number, part = header.get("batch"), header.get("part")
    if isinstance(number, int) and part in ("train", "test"):
        return Batch(number, str(part))
    return None


def _count_answers(agent: AgentTally, trial: Trial) -> None:
    """Count the attributes whose truth is known, and which of them were reported right."""
    right = np.zeros(len(trial.truth), np.bool_)
    if trial.report is not None:
        right = trial.report == (trial.truth == 1)
    known = trial.truth >= 0
    for name, told, hit in zip(trial.task.query.attributes, known, right, strict=True):
        agent.asked[name] += int(told)
        agent.right[name] += int(told and hit)


def _brief(trial: Trial) -> Trial:
    """Keep of a trial what measures need: one step stands for all, nothing of how it was chosen."""
    last = trial.last_belief
    nothing = np.zeros((len(trial.truth), 0, 0), np.int64)
    belief = Belief(last.x, last.weight, nothing, last.log_share)
    decision = unvalued(trial.momdp, 0)
    step = Step(last.x, decision, last.x, None, trial.cost, trial.reward, belief)
    return Trial(
        trial.task,
        trial.agent,
        trial.momdp,
        belief,
        (step,),
        trial.truth,
        trial.report,
        trial.ended,
    )

"""One trial: the task, its steps, and the inner loop that Algorithms 1 and 2 share."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.domain import Query
from meal_bayes.momdp import (
    MOMDP,
    Belief,
    Transition,
    best_report,
    initial_belief,
    update_belief,
)
from meal_bayes.perception import Perceiver
from meal_bayes.planners import Decision, History, Policy, unvalued
from meal_bayes.robots import Robot
from meal_bayes.seeds import stream


@dataclass(frozen=True, slots=True)
class Task:
    """A query about an object; `key` names every random stream of the trial."""

    name: str
    query: Query
    object_index: int
    object_name: str
    key: tuple[str | int, ...]


@dataclass(frozen=True, slots=True)
class Step:
    """One executed action."""

    x: int
    decision: Decision
    next_x: int
    observation: NDArray[np.int8] | None  # (N,) percept levels, None = "none"
    cost: float  # s, paid in this step
    reward: float  # true (unshaped) reward of this step
    belief: Belief  # after the step


@dataclass(frozen=True, slots=True)
class Trial:
    """The paper's xi, with the beliefs and decisions behind it."""

    task: Task
    agent: str
    momdp: MOMDP
    first_belief: Belief
    steps: tuple[Step, ...]
    truth: NDArray[np.bool_]  # (N,)
    report: NDArray[np.bool_] | None  # (N,), None = abstained

    def __post_init__(self) -> None:
        set_frozen(self, truth=freeze(self.truth, np.bool_))
        if self.report is not None:
            set_frozen(self, report=freeze(self.report, np.bool_))

    @property
    def success(self) -> bool:
        """Rst of Eq. 5: a report right in all attributes."""
        return self.report is not None and bool((self.report == self.truth).all())

    @property
    def cost(self) -> float:
        """Cst of Eq. 6, s: the summed cost of the executed behaviors."""
        return float(sum(step.cost for step in self.steps))

    @property
    def reward(self) -> float:
        """Undiscounted, unshaped return."""
        return float(sum(step.reward for step in self.steps))

    @property
    def last_belief(self) -> Belief:
        """The belief when the trial ended."""
        return self.steps[-1].belief if self.steps else self.first_belief


class Streams(NamedTuple):
    """The random streams of one trial; all but `planner` are the same for every agent."""

    robot: np.random.Generator  # failures, order of recordings
    percepts: np.random.Generator  # answers, percepts drawn from tables
    planner: np.random.Generator

    @classmethod
    def of(cls, seed: int, task: Task, agent: str) -> "Streams":
        """Streams named by seed and task, and the planner's by the agent as well."""
        return cls(
            stream(seed, "robot", *task.key),
            stream(seed, "percepts", *task.key),
            stream(seed, "planner", agent, *task.key),
        )


def run_trial(
    task: Task,
    momdp: MOMDP,
    policy: Policy,
    robot: Robot,
    perceiver: Perceiver,
    streams: Streams,
    *,
    truth: NDArray[np.bool_],
    agent: str = "",
    max_steps: int = 100,
    on_step: Callable[[Step], None] | None = None,
) -> Trial:
    """Run one trial (Alg. 1, l. 6-11): decide, execute, perceive, filter, until `term`.

    After `max_steps` behaviors the best report is made. `truth` (N,) is only compared with the
    report; neither policy nor belief sees it.
    """
    belief = initial_belief(momdp)
    first, x = belief, robot.start(task.object_index)
    belief = belief.at(x)
    history, steps, report = History(belief), list[Step](), None
    while x != momdp.terminal:
        decision = policy.decide(history, streams.planner)
        if decision.action < momdp.n_behaviors and len(steps) >= max_steps:
            decision = unvalued(momdp, best_report(momdp, belief))
        if decision.action >= momdp.n_behaviors:
            step, report = _report(momdp, belief, decision, truth)
        else:
            step = _execute(momdp, belief, decision, task, robot, perceiver, streams)
        steps.append(step)
        if on_step is not None:
            on_step(step)
        belief, x = step.belief, step.next_x
        history = History(
            belief,
            (*history.actions, decision.action),
            (*history.perceived, step.observation is not None),
            (*history.moved, x),
            history.cost + step.cost,
        )
    return Trial(task, agent, momdp, first, tuple(steps), truth, report)


def _report(
    momdp: MOMDP, belief: Belief, decision: Decision, truth: NDArray[np.bool_]
) -> tuple[Step, NDArray[np.bool_]]:
    report = momdp.query.values_of(decision.action - momdp.n_behaviors)
    reward = float(momdp.report_reward((report == truth).astype(float)))
    last = belief.at(momdp.terminal)
    return Step(belief.x, decision, momdp.terminal, None, 0.0, reward, last), report


def _execute(
    momdp: MOMDP,
    belief: Belief,
    decision: Decision,
    task: Task,
    robot: Robot,
    perceiver: Perceiver,
    streams: Streams,
) -> Step:
    action, observation = decision.action, None
    execution = robot.execute(action, streams.robot)
    if execution.instance is not None:
        observation = perceiver.observe(execution.instance, task.query, streams.percepts)
    belief_after = update_belief(belief, momdp, Transition(action, execution.next_x, observation))
    # Where illegal behaviors are self-loops (the published ROC36 diagram) they cost nothing.
    free = not momdp.legal[belief.x, action] and execution.next_x == belief.x
    cost = 0.0 if free else float(momdp.cost[action])
    return Step(belief.x, decision, execution.next_x, observation, cost, -cost, belief_after)

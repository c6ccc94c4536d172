"""What a trial needs from an agent's knowledge: a problem, a policy, a perceiver, limits.

There are two implementations: `HeldOut` (Algorithm 1: a percept table without the object in the
question) and `Online` (Algorithm 2: the experience of a robot that learns while it works).
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import expit, logit

from meal_bayes.agents import Agent, Knowledge
from meal_bayes.domain import Query
from meal_bayes.learner.experience import NONE, Context, Experience, Labels
from meal_bayes.learner.settings import LearnerSettings
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver, SampledPercepts
from meal_bayes.planners import Policy
from meal_bayes.planners.solver import solve as solve_checked
from meal_bayes.seeds import Key, stream
from meal_bayes.trials import Step, Task

OnStep = Callable[[Step], None] | None  # called after each step
_LABEL_ACCURACY = 0.99  # default accuracy of the labels of a recognized object, and the largest
_MOST_VOTES = 5  # largest difference of votes, so that percepts can still change the belief


class Fit(Protocol):
    """Interface to what one agent knows when it is asked about an object."""

    record: Experience
    agent: Agent
    settings: LearnerSettings

    @property
    def knowledge(self) -> Knowledge:
        """What the agent has learned, without the object if this is held out."""

    @property
    def limit(self) -> NDArray[np.float64]:
        """Maximum number of percepts of each behavior in a trial, (E,)."""

    @property
    def perceiver(self) -> Perceiver:
        """The perceiver, which computes percept levels from sensor data."""

    @property
    def teaches(self) -> bool:
        """Whether trials become experience, as those with a robot do."""

    @property
    def expected_sizes(self) -> dict[Context, int]:
        """Required number of features for each behavior and modality."""

    def perceiving(
        self, task: Task, momdp: MOMDP, lock: AbstractContextManager[Any], on_step: OnStep
    ) -> tuple[Perceiver, OnStep]:
        """Return the perceiver of a trial, and a function to call after each of its steps."""

    def truth(self, query: Query) -> Labels | None:
        """Return the labels (N,) of a replayed object, or None for a robot's object."""

    def problem(self, task: Task, limit: ArrayLike) -> MOMDP:
        """Return the MOMDP of a task in which a program commands the behaviors, as in a test."""

    def plan(
        self, task: Task, streams: Key, *, limit: ArrayLike, explore: bool
    ) -> tuple[MOMDP, Policy]:
        """Build and solve the problem of a task.

        Parameters
        ----------
        task : Task
            The question and the object.
        streams : Key
            Key of the planner's random stream.
        limit : ArrayLike
            Maximum number of percepts of each behavior in a trial, (E,) or one number.
        explore : bool
            Whether to plan with an exploration bonus, for later questions.
        """


def problem_of(fit: Fit, task: Task, limit: ArrayLike = np.inf, *, recognize: bool = True) -> MOMDP:
    """Build the MOMDP of a task without a bonus, as in a test (Algorithm 1, lines 1-4)."""
    return fit.agent.model(
        task.query,
        fit.knowledge,
        limit=limits_of(fit, limit),
        reward=fit.settings.reward_in(fit.knowledge.domain),
        payoffs=fit.settings.payoffs,
        told=told_of(fit, task) if recognize else None,
    )


def limits_of(fit: Fit, limit: ArrayLike) -> NDArray[np.float64]:
    """Return the maximum number of percepts of each behavior (E,), given the limits of a robot."""
    behaviors = len(fit.record.domain.behaviors)
    return np.asarray(np.broadcast_to(np.minimum(limit, fit.limit), behaviors), np.float64)


def told_of(fit: Fit, task: Task) -> NDArray[np.float64] | None:
    """Return Pr(attribute is true) (N,) from the labels of a task's object, if it is recognized.

    An agent with memory recognizes an object with at least one label. Labels of different trials
    have independent errors given the truth. If as many labels say yes as no, or there is none, the
    probability is NaN. The result is None if the object is not recognized.
    """
    if not fit.agent.memory:
        return None
    o = fit.record.objects.get(task.object_name, NONE)
    labels = fit.record.labels_by_trial(o)[:, fit.record.domain.columns(task.query.attributes)]
    if not (labels >= 0).any():
        return None
    votes = (labels == 1).sum(axis=0) - (labels == 0).sum(axis=0)
    log_odds = logit(min(fit.settings.label_accuracy or _LABEL_ACCURACY, _LABEL_ACCURACY))
    chance = expit(np.clip(votes, -_MOST_VOTES, _MOST_VOTES) * log_odds)
    return np.where(votes == 0, np.nan, chance)


def solve(fit: Fit, task: Task, streams: Key, momdp: MOMDP) -> Policy:
    """Solve the problem of a task by the agent's planner (Algorithm 1, line 5)."""
    solver = fit.agent.planner(fit.knowledge.domain, task.query)
    return solve_checked(
        solver, momdp, stream(fit.settings.seed, "solver", fit.agent.name, *streams)
    )


def training_agent(agent: Agent) -> Agent:
    """Return the agent that executes training trials: the agent itself by default."""
    if agent.trained_by is None:
        return agent
    return replace(agent.trained_by, name=agent.name)


def sampled(knowledge: Knowledge, labels: Labels) -> SampledPercepts:
    """Return a perceiver that draws percepts from learned matrices, by labels (O,P)."""
    every = range(len(knowledge.domain.attributes))
    confusion, _ = knowledge.posterior.select(every, exact=True)
    return SampledPercepts(knowledge.domain, labels, confusion)

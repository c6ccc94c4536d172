"""What is perceived of an outcome: by its features, by a person's answers, or nothing."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain.diagram import TransitionArrays
from meal_bayes.momdp import MOMDP
from meal_bayes.perception import Perceiver
from meal_bayes.planners import History
from meal_bayes.robots.robot import NO_PERCEPT, Execution, OutcomeChecker
from meal_bayes.trials.faults import CHANCE, nothing_came
from meal_bayes.trials.record import Task


@dataclass(frozen=True, slots=True)
class PerceptReader:
    """Reads the percepts of a trial from what its executions sensed.

    Attributes
    ----------
    task : Task
        The question and the object.
    momdp : MOMDP
        The decision problem.
    checker : OutcomeChecker
        Of the robot; knows how often behaviors fail by the domain.
    perceiver : Perceiver
        Turns features into percept levels.
    rng : np.random.Generator
        Of the percepts that are drawn.
    """

    task: Task
    momdp: MOMDP
    checker: OutcomeChecker
    perceiver: Perceiver
    rng: np.random.Generator

    def read(
        self, execution: Execution, action: int, before: History
    ) -> tuple[NDArray[np.int8] | None, str]:
        """Return percept levels (N,), or None, and a warning; `before` ends before the action.

        A level is -1 where nothing came of an attribute.
        """
        query = self.task.query
        warning = execution.warning
        if execution.instance is not None:
            levels = self.perceiver.observe(execution.instance, query, self.rng)
            if levels is not None and np.max(levels) < 0:
                levels = None
            if levels is None and not warning:
                behavior = execution.instance.behavior
                warning = f"{NO_PERCEPT} of {behavior}: nothing of what was asked"
            return levels, warning
        if execution.answers is not None:
            return answered(execution.answers, query.attributes, self.momdp.levels)
        # A replay may have used up its recordings; a robot that senses nothing may be broken.
        if self.task.object_index < 0 and not warning:
            usual = self.checker.usual
            warning = silence(self.momdp, usual, before, action, execution.next_x)
        return None, warning


def answered(
    answers: Mapping[str, bool], attributes: Sequence[str], levels: int
) -> tuple[NDArray[np.int8] | None, str]:
    """Return percept levels (N,) of what a person said, or None, and a warning.

    A level is -1 where the person said nothing of an attribute.

    >>> answered({"red": True}, ["red", "full"], 4)
    (array([ 3, -1], dtype=int8), '')
    """
    if answers.keys().isdisjoint(attributes):
        names = ", ".join(attributes)
        return None, f"{NO_PERCEPT}: the person did not answer about {names}"
    sure = (0, levels - 1)  # the two extreme levels
    said = [sure[bool(answers[name])] if name in answers else -1 for name in attributes]
    return np.array(said, np.int8), ""


def silence(momdp: MOMDP, usual: TransitionArrays, before: History, e: int, next_x: int) -> str:
    """Return a warning where a robot's behavior shows nothing, more often than failures explain.

    How often it fails is `usual`; a failure that this explains is one that is shown as failed.
    """
    if not momdp.observation_probability[e, before.belief.x, next_x] > 0:
        return ""
    now = before.after(before.belief.at(next_x), e, perceived=False, cost=0.0)
    if nothing_came(momdp, now, usual).chance[e] > CHANCE:
        return ""
    return f"nothing perceived by {momdp.behavior_names[e]}: it sensed nothing, or it failed"

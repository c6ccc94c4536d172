"""Records of a trial: its task, its steps, what came of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import reduce
from operator import add
from typing import Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import ByValue, FrozenArrays, label_values
from meal_bayes.datasets import Instance
from meal_bayes.domain import Query
from meal_bayes.domain.domain import one_value
from meal_bayes.errors import DataError, QueryError
from meal_bayes.look import short_repr
from meal_bayes.momdp import MOMDP, Belief
from meal_bayes.momdp.reports import ABSTAINED
from meal_bayes.planners import Decision
from meal_bayes.robots.robot import NO_PERCEPT
from meal_bayes.seeds import Key
from meal_bayes.untrusted import name_fault


@dataclass(frozen=True, slots=True)
class Task:
    """A query about an object.

    Attributes
    ----------
    name : str
        Of the task.
    query : Query
        What is asked.
    object_index : int
        In the data set; -1: an object of which nothing is recorded.
    object_name : str
        The object's name.
    key : Key
        Texts and numbers; names every random stream of the trial.
    learn : bool
        Whether it may become experience; else it is a test.
    """

    name: str
    query: Query
    object_index: int
    object_name: str
    key: Key
    learn: bool = field(default=True, repr=False)

    def __post_init__(self) -> None:
        if fault := name_fault(self.object_name):
            raise QueryError(f"The object's name {self.object_name!a:.60} {fault}; rename it.")

    @property
    def question(self) -> str:
        """The question as it was asked, else the names of what is asked."""
        return self.name if self.name.endswith("?") else self.query.text


@dataclass(frozen=True, slots=True)
class Step(ByValue):
    """One executed action.

    Attributes
    ----------
    x, next_x : int
        States before and after.
    decision : Decision
        The action and its values.
    observation : NDArray[np.int8] | None
        (N,) percept levels, -1 where nothing came of an attribute; None where nothing came of any.
    cost, reward : float
        Of this step, s; the true (unshaped) reward, nan where the truth is not known.
    belief : Belief
        After the step.
    warning : str
        Why sensor data of the robot were not used as a percept, or which limit brought the answer;
        empty: neither.
    sensed : Instance | None
        What a robot sensed, of which nothing is recorded elsewhere; None of a replay.
    """

    x: int
    decision: Decision
    next_x: int
    observation: NDArray[np.int8] | None
    cost: float
    reward: float
    belief: Belief
    warning: str = ""
    sensed: Instance | None = None

    __repr__ = short_repr

    @property
    def unread(self) -> bool:
        """Whether features or answers came of which nothing could be read."""
        return self.observation is None and self.warning.startswith(NO_PERCEPT)


@dataclass(frozen=True, slots=True)
class TrialRecord(FrozenArrays):
    """The paper's xi, with its beliefs and decisions; a `Trial` is one that shows itself.

    Attributes
    ----------
    task : Task
        The question and the object.
    agent : str
        Name of the agent.
    momdp : MOMDP
        The decision problem.
    first_belief : Belief
        Before the first step.
    steps : tuple[Step, ...]
        In order.
    truth : NDArray[np.int8]
        (N,) 1 true, 0 false, -1 not known.
    report : NDArray[np.bool_] | None
        (N,), or of yes or no (1,) whether it is yes; None: the agent abstained.
    ended : str
        Why the trial was broken off, such as "robot error: ..."; empty: it was not.
    counts : NDArray[np.float64] | None
        (N,E,2,K) labeled percepts behind the rows of the MOMDP, where they are known.
    """

    task: Task
    agent: str
    momdp: MOMDP
    first_belief: Belief
    steps: tuple[Step, ...]
    truth: NDArray[np.int8]
    report: NDArray[np.bool_] | None
    ended: str = ""
    counts: NDArray[np.float64] | None = None

    @property
    def answer(self) -> dict[str, bool | str] | None:
        """The report by what was asked: of a group its value, of others True or False.

        Of an event, in its words, whether it is yes: ``{"red and not empty": True}``. None where
        the agent abstained, or the trial was broken off: `if trial.answer` would not tell "no" from
        nothing, as its values do.
        """
        if self.report is None:
            return None
        if self.task.query.event is not None:
            return {self.task.query.text.removesuffix("?"): bool(self.report[0])}
        names = self.task.query.attributes
        values = dict[str, bool | str]()
        for name, indices in self.task.query.questions:
            true = [names[index] for index in indices if self.report[index]]
            if len(indices) > 1:
                values[name] = true[0]
            else:
                values[name] = bool(true)
        return values

    @property
    def warnings(self) -> list[str]:
        """Warnings of the steps, each once."""
        return list(dict.fromkeys(step.warning for step in self.steps if step.warning))

    @property
    def judged(self) -> bool:
        """Whether success is known: the trial came to its end, and the right report is known."""
        return not self.ended and bool((self.task.query.report_truth(self.truth) >= 0).all())

    @property
    def success(self) -> bool | None:
        """Rst of Eq. 5: a report right in all attributes; None where that is not known."""
        if not self.judged:
            return None
        right = self.task.query.report_truth(self.truth)
        return self.report is not None and bool((self.report == right).all())

    @property
    def probability(self) -> float | None:
        """Pr(yes is right) when the trial ended, of a question of yes or no; None of values.

        A question of one attribute is one of yes or no, too.
        """
        if self.task.query.event is None and self.task.query.yes_or_no:
            return float(self.last_belief.positive[0])
        return self.momdp.reports.probability_now(self.last_belief)

    @property
    def certainty(self) -> float:
        """Pr(most probable values) when the trial ended; of an event, of the likelier answer."""
        if self.task.query.event is None or self.probability is None:
            return self.last_belief.certainty
        return max(self.probability, 1.0 - self.probability)

    @property
    def cost(self) -> float:
        """Cst of Eq. 6, s: the summed cost of the executed behaviors."""
        # In order: `sum` rounds otherwise from Python 3.12 on, and logs hold every bit.
        return reduce(add, (step.cost for step in self.steps), 0.0)

    @property
    def reward(self) -> float:
        """Undiscounted, unshaped return; nan where the truth of a report is not known."""
        return reduce(add, (step.reward for step in self.steps), 0.0)

    def with_truth(self, truth: NDArray[np.int8]) -> Self:
        """Return the trial as another truth (N,) of its object judges it: 1, 0, -1 not known."""
        steps = self.steps
        if self.report is not None:
            right = self.task.query.report_truth(truth)
            reward = answer_reward(self.momdp, self.report, right)
            steps = (*steps[:-1], replace(steps[-1], reward=reward))
        return replace(self, truth=truth, steps=steps)

    @property
    def last_belief(self) -> Belief:
        """The belief when the trial ended."""
        return self.steps[-1].belief if self.steps else self.first_belief


def answer_reward(momdp: MOMDP, report: NDArray[np.bool_] | None, right: NDArray[np.int8]) -> float:
    """Return what a report, or none, earns; nan where what is right (1, 0, -1) is not known."""
    if report is None:
        return ABSTAINED
    return momdp.reports.reward(report, right) if (right >= 0).all() else float("nan")


def answer_step(
    momdp: MOMDP, belief: Belief, decision: Decision, right: NDArray[np.int8], warning: str = ""
) -> Step:
    """Return the last step of a trial: a decision to answer, or to abstain, at a belief.

    `right` is the right report, 1, 0, or -1 where it is not known; the warning says which limit
    brought the answer.
    """
    report = momdp.reported(decision.action)
    last_belief = belief.at(momdp.terminal)
    return Step(
        x=belief.x,
        decision=decision,
        next_x=last_belief.x,
        observation=None,
        cost=0.0,
        reward=answer_reward(momdp, report, right),
        belief=last_belief,
        warning=warning,
    )


def truth_of(query: Query, truth: Mapping[str, bool] | ArrayLike | None) -> NDArray[np.int8]:
    """Return the truth of the queried attributes, (N,): 1 true, 0 false, -1 not known.

    Parameters
    ----------
    query : Query
        What is asked.
    truth : Mapping[str, bool] | ArrayLike | None
        By attribute, or (N,) in the query's order; None where nothing is known.

    Raises
    ------
    QueryError
        Another number of values, or one that is no label.
    """
    if truth is None:
        return np.full(len(query), -1, np.int8)
    queried = truth  # what is not asked plays no part
    if isinstance(truth, Mapping):
        queried = [truth.get(name) for name in query.attributes]  # type: ignore[assignment]  # None
    try:
        values = label_values(queried)
    except DataError as fault:
        raise QueryError(f"truth of {list(query.attributes)}: {fault}") from None
    if values.shape != (len(query),):
        raise QueryError(
            f"truth is {truth}; expected 1, 0 or -1 for each of {list(query.attributes)}, or "
            "{attribute: True or False}."
        )
    values = values.copy()
    for name, indices in zip(query.group_names, map(list, query.groups), strict=True):
        members = [query.attributes[i] for i in indices]
        values[indices] = one_value(values[indices], name, members)
    return values

"""Records of a trial: its task, its steps, and its result."""

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
        Name of the task, such as the question as it was asked.
    query : Query
        The question.
    object_index : int
        Index of the object in the data set; -1 if the object is not recorded there.
    object_name : str
        Name of the object.
    key : Key
        Texts and numbers that select the random streams of the trial. If the last of them are the
        attributes of the question, the robot learns that people ask about these attributes.
    learn : bool
        Whether the agent may learn from the trial. If False, the trial is a test.
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
        """The question as it was asked, or the names of the queried attributes and groups."""
        return self.name if self.name.endswith("?") else self.query.text


@dataclass(frozen=True, slots=True)
class Step(ByValue):
    """One step of a trial: an executed behavior, or the answer.

    Attributes
    ----------
    x, next_x : int
        Indices of the states before and after the step.
    decision : Decision
        The chosen action and the values on which the choice is based.
    observation : NDArray[np.int8] | None
        (N,) percept levels, -1 for attributes without a percept; None if there is no percept.
    cost, reward : float
        Cost of the step in seconds, and its reward without exploration bonus. The reward is nan if
        the truth is not known.
    belief : Belief
        Belief after the step.
    warning : str
        Why sensor data of the robot were not used, or which limit ended the trial; empty if there
        is no warning.
    sensed : Instance | None
        Features, percepts and answers that a robot returned; None in replays, whose data set
        contains them.
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
        """Whether the robot returned features or answers of which none could be read."""
        return self.observation is None and self.warning.startswith(NO_PERCEPT)


@dataclass(frozen=True, slots=True)
class TrialRecord(FrozenArrays):
    """Data of a trial (the paper's xi) with beliefs and decisions; `Trial` adds text and pictures.

    Attributes
    ----------
    task : Task
        The question and the object.
    agent : str
        Name of the agent.
    momdp : MOMDP
        The decision problem.
    first_belief : Belief
        Belief before the first step.
    steps : tuple[Step, ...]
        Steps in their order. The last one is the answer, if there is one.
    truth : NDArray[np.int8]
        (N,) truth of the queried attributes: 1 true, 0 false, -1 unknown.
    report : NDArray[np.bool_] | None
        (N,) reported values of the queried attributes; (1,) whether the answer is yes, for a
        yes-or-no question; None if there is no report.
    ended : str
        Why the trial ended without an answer, such as "robot error: ..."; empty otherwise.
    counts : NDArray[np.float64] | None
        (N,E,2,K) counts of the labeled percepts from which the MOMDP was learned; None if unknown.
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
        """The answer as a dictionary: for a group its value, for an attribute True or False.

        The key of a yes-or-no question is its text: ``{"red and not empty": True}``. The answer is
        None if the agent answered "I do not know", or if the trial ended without an answer.
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
        """Warnings of the steps, without repetitions."""
        return list(dict.fromkeys(step.warning for step in self.steps if step.warning))

    @property
    def judged(self) -> bool:
        """Whether `success` is known: the trial has ended regularly, and the truth is known."""
        return not self.ended and bool((self.task.query.report_truth(self.truth) >= 0).all())

    @property
    def success(self) -> bool | None:
        """Whether the whole report is right (Rst of Eq. 5); None if this is not known."""
        if not self.judged:
            return None
        right = self.task.query.report_truth(self.truth)
        return self.report is not None and bool((self.report == right).all())

    @property
    def probability(self) -> float | None:
        """Probability at the end of the trial that yes is right; None for other questions.

        A question about one attribute is a yes-or-no question, too.
        """
        if self.task.query.event is None and self.task.query.yes_or_no:
            return float(self.last_belief.positive[0])
        return self.momdp.reports.probability_now(self.last_belief)

    @property
    def certainty(self) -> float:
        """Probability of the most probable values, or of yes or no, at the end of the trial."""
        if self.task.query.event is None or self.probability is None:
            return self.last_belief.certainty
        return max(self.probability, 1.0 - self.probability)

    @property
    def cost(self) -> float:
        """Sum of the costs of the executed behaviors, in seconds (Cst of Eq. 6)."""
        # In order: `sum` rounds otherwise from Python 3.12 on, and logs hold every bit.
        return reduce(add, (step.cost for step in self.steps), 0.0)

    @property
    def reward(self) -> float:
        """Sum of rewards without discount and exploration bonus; nan if the truth is unknown."""
        return reduce(add, (step.reward for step in self.steps), 0.0)

    def with_truth(self, truth: NDArray[np.int8]) -> Self:
        """Return the trial with another truth (N,): 1 true, 0 false, -1 unknown."""
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
    """Return the reward of a report, or of no report; nan if the right report is unknown (-1)."""
    if report is None:
        return ABSTAINED
    return momdp.reports.reward(report, right) if (right >= 0).all() else float("nan")


def answer_step(
    momdp: MOMDP, belief: Belief, decision: Decision, right: NDArray[np.int8], warning: str = ""
) -> Step:
    """Return the last step of a trial: the decision to answer or to abstain, given a belief.

    `right` is the right report: 1 true, 0 false, -1 unknown. The warning says which limit ended the
    trial.
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
    """Return the truth of the queried attributes, (N,): 1 true, 0 false, -1 unknown.

    Parameters
    ----------
    query : Query
        The question.
    truth : Mapping[str, bool] | ArrayLike | None
        Truth by attribute, or (N,) in the query's order; None if nothing is known.

    Raises
    ------
    QueryError
        The number of values is wrong, or a value is not a label.
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

"""What the answers of a question earn: values of attributes, or yes and no about an event.

The kind of the question decides this one value; planners, beliefs, trials and files ask it. A
report of values is right in all attributes, or wrong. Yes and no are about an event E, a
conjunction over variables or its complement. Where these are independent Pr(E) is a product, else
the sum over the values at which E holds:

    yes: wrong_yes + (right_yes - wrong_yes) Pr(E)
    no:  wrong_no + (right_no - wrong_no) (1 - Pr(E)), less what "no" costs in x
"""

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import ByValue, Floats, freeze
from meal_bayes.domain import Event, Payoffs, Query


def mean_reward(wrong: Any, gain: Any, right: Any) -> Any:
    """Return r- + (r+ - r-) Pr(right), what a report of values is expected to earn.

    The one definition of this, for arrays and, compiled, for the planning kernels. Whose report
    comes later discounts both numbers before, and takes its costs from the first.

    >>> mean_reward(-500.0, 1000.0, 0.9)
    400.0
    """
    return wrong + gain * right


ABSTAINED = 0.0  # reward of "I do not know"


class Believed(Protocol):
    """What is believed of the truth, at one belief or at any number (...)."""

    @property
    def positive(self) -> Floats:
        """Pr(attribute is true), (...,N)."""
        ...

    @property
    def joint_table(self) -> Floats | None:
        """Pr(values), (...,Y), where attributes are coupled by the prior."""
        ...


class Conjunction(NamedTuple):
    """Yes or no as kernels read it: asserts that a conjunction of literals holds, or denies it.

    Besides beliefs and reports, planners read it: `plans` (`values`, `affinity`, `library`),
    `table/sweep.py`.
    """

    literal: NDArray[np.bool_]  # (N,) value of each attribute that the conjunction needs
    wrong_assertion: float  # reward of a wrong assertion,
    assertion_gain: float  # and what a right one adds
    wrong_denial: float
    denial_gain: float
    gain: float  # of an assertion over a denial, where it is right
    loss: float  # and of a denial over an assertion, where that is wrong


@dataclass(frozen=True, slots=True)
class Reports(ByValue):
    """The reports of a query and their rewards.

    Attributes
    ----------
    query : Query
        The question.
    payoffs : Payoffs
        Payoffs of yes and no. If the question asks for values, the first two are the rewards of a
        right and of a wrong report.
    """

    query: Query
    payoffs: Payoffs

    @property
    def event(self) -> Event | None:
        """The event that yes and no are about; None if the report consists of values.

        A question about one attribute is a yes-or-no question. If yes and no have the same rewards,
        planners treat it as a question about values.
        """
        if self.query.event is None and len(self.query) == 1 and not self.payoffs.symmetric:
            return Event((True,))
        return self.query.event

    @property
    def conjunction(self) -> Conjunction | None:
        """The yes-or-no question for kernels; None if the report consists of values."""
        event = self.event
        if event is None:
            return None
        right_assertion, wrong_assertion, right_denial, wrong_denial = self.payoffs
        # By De Morgan "no" asserts a conjunction where "yes" asserts a disjunction.
        if event.complement:
            right_denial, wrong_denial, right_assertion, wrong_assertion = self.payoffs
        assertion_gain = right_assertion - wrong_assertion
        denial_gain = right_denial - wrong_denial
        return Conjunction(
            literal=np.array(event.allowed),
            wrong_assertion=wrong_assertion,
            assertion_gain=assertion_gain,
            wrong_denial=wrong_denial,
            denial_gain=denial_gain,
            gain=wrong_assertion + assertion_gain - wrong_denial,
            loss=wrong_denial + denial_gain - wrong_assertion,
        )

    def probability(self, belief: Believed) -> Floats:
        """Compute Pr(yes is right) (...) at one or more beliefs."""
        event = self.event
        if event is None:
            raise ValueError("values have no event")
        if belief.joint_table is not None:
            return np.asarray(belief.joint_table @ _truth_table(self.query, event))
        return event.probability(belief.positive, self.query.variables)

    def probability_now(self, belief: Believed) -> float | None:
        """Return Pr(yes is right) for a yes-or-no question; None for a question about values."""
        return None if self.query.event is None else float(self.probability(belief))

    def answers(self, probability: ArrayLike) -> Floats:
        """Compute the expected rewards of no and of yes, (...,2), given Pr(yes is right)."""
        p = np.asarray(probability)
        right_yes, wrong_yes, right_no, wrong_no = self.payoffs
        no = mean_reward(wrong_no, right_no - wrong_no, 1.0 - p)
        yes = mean_reward(wrong_yes, right_yes - wrong_yes, p)
        return np.stack(np.broadcast_arrays(no, yes), axis=-1)

    def of_right(self, right: Floats) -> Floats:
        """Compute the reward of a report, given Pr(right) of each of its attributes, (...,N).

        A report is right only if all attributes are right.
        """
        reward_range = self.payoffs.right_yes - self.payoffs.wrong_yes
        return np.asarray(mean_reward(self.payoffs.wrong_yes, reward_range, right.prod(axis=-1)))

    def reward(self, report: NDArray[np.bool_], right: NDArray[Any]) -> float:
        """Return the reward of a report, given the right report."""
        if self.event is None:
            return float(self.of_right((report == right).astype(float)))
        return float(self.answers(float(right[0] == 1))[int(report[0])])

    def rewards(self) -> Floats:
        """Return the reward of each report for each combination of values, (Y,reports)."""
        values = self.query.values
        if self.event is None:
            return self.of_right((values[:, None] == values).astype(float))
        return self.answers(_truth_table(self.query, self.event))


@lru_cache(maxsize=8)  # of a trial's beliefs all ask the same one
def _truth_table(query: Query, event: Event) -> Floats:
    """Return at which values (Y,) of a query an event holds: 1 or 0."""
    return freeze(event.probability(query.values.astype(float), query.variables))

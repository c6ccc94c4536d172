"""Events of yes-or-no questions, and the payoffs of their answers."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, is_number, plain, plain_fields
from meal_bayes.domain.words import denied
from meal_bayes.errors import QueryError
from meal_bayes.untrusted import LARGEST

Variables = Sequence[tuple[int, ...]]  # indices of each variable's attributes


def wrong_reward(reward: float) -> float:
    """Return the default reward r- of a wrong report, given the reward r+ of a right report."""
    return -reward


class Payoffs(NamedTuple):
    """Rewards of the answers yes and no, in seconds.

    Attributes
    ----------
    right_yes, wrong_yes : float
        Rewards of a right yes (hit) and of a wrong yes (false alarm).
    right_no, wrong_no : float
        Rewards of a right no (correct rejection) and of a wrong no (miss).
    """

    right_yes: float
    wrong_yes: float
    right_no: float
    wrong_no: float

    @classmethod
    def of(cls, values: Sequence[float]) -> "Payoffs":
        """Make payoffs from four numbers.

        Raises
        ------
        QueryError
            The values are not four finite numbers, a wrong answer has a higher reward than the
            right one, or the rewards do not depend on whether an answer is right.
        """
        numbers = np.asarray(values, dtype=object)
        if numbers.shape == (4,):
            numbers = np.array([plain(value) for value in numbers], dtype=object)
        if numbers.shape != (4,) or not all(
            is_number(value) and abs(value) <= LARGEST for value in numbers
        ):
            raise QueryError(
                f"Payoffs are {values!r:.60}; give four numbers: right yes, wrong yes, right no, "
                "wrong no."
            )
        payoffs = cls(*map(float, numbers))
        if payoffs.right_yes < payoffs.wrong_no or payoffs.right_no < payoffs.wrong_yes:
            raise QueryError(f"{payoffs}: a wrong answer must not earn more than the right one.")
        if payoffs.right_yes == payoffs.wrong_no and payoffs.right_no == payoffs.wrong_yes:
            raise QueryError(
                f"{payoffs}: the rewards do not depend on whether an answer is right; give a right "
                "answer a higher reward than a wrong one."
            )
        return payoffs

    @property
    def symmetric(self) -> bool:
        """Whether yes and no have the same rewards."""
        return self[:2] == self[2:]


@dataclass(frozen=True, slots=True)
class Event:
    """A conjunction over variables, or its complement (a disjunction, by De Morgan's law).

    Attributes
    ----------
    allowed : tuple[bool, ...]
        (N,) what the conjunction requires of each queried attribute. For a single attribute, the
        entry is the required value. For an attribute of a group, the entry is True if this
        attribute may be the true value of the group.
    complement : bool
        Whether the event is that the conjunction does not hold.
    """

    allowed: tuple[bool, ...]
    complement: bool = False

    def __post_init__(self) -> None:
        plain_fields(self)

    def check(self, attributes: Sequence[str], variables: Variables) -> None:
        """Raise an error if the event has other attributes, or if it always or never holds."""
        if len(self.allowed) != len(attributes):
            raise QueryError(
                f"The event has {len(self.allowed)} values for {len(attributes)} attributes."
            )
        for indices in variables:
            members = [self.allowed[index] for index in indices]
            if len(indices) > 1 and (all(members) or not any(members)):
                names = " and ".join(attributes[index] for index in indices)
                raise QueryError(
                    f"Of {names}, exactly one is true, so the answer is known; ask something else."
                )

    def literals(self, positive: Floats, variables: Variables) -> list[Floats]:
        """Return Pr(literal) of each variable, given Pr(attribute is true) (...,N)."""
        probabilities = []
        for indices in variables:
            allowed = np.array([self.allowed[index] for index in indices])
            p = positive[..., list(indices)]
            single = p[..., 0] if allowed[0] else 1.0 - p[..., 0]
            probabilities.append(single if len(indices) == 1 else (p * allowed).sum(axis=-1))
        return probabilities

    def probability(self, positive: Floats, variables: Variables) -> Floats:
        """Compute Pr(event) for independent variables, given Pr(attribute is true) (...,N)."""
        conjunction = np.ones(np.shape(positive)[:-1])
        for p in self.literals(np.asarray(positive), variables):
            conjunction = conjunction * p
        return np.asarray(1.0 - conjunction if self.complement else conjunction)

    def holds(self, truth: NDArray[np.int8], variables: Variables) -> int:
        """Return whether the event holds for truths (N,): 1 yes, 0 no, -1 unknown."""
        literals = []
        for indices in variables:
            if len(indices) == 1:
                value = int(truth[indices[0]])
                literals.append(-1 if value < 0 else int(value == self.allowed[indices[0]]))
                continue
            true = [index for index in indices if truth[index] == 1]
            candidates = true or [index for index in indices if truth[index] != 0]
            possible = {self.allowed[index] for index in candidates}
            literals.append(int(possible.pop()) if len(possible) == 1 else -1)
        conjunction = 0 if 0 in literals else min(literals)
        return 1 - conjunction if self.complement and conjunction >= 0 else conjunction

    def labels(self, answer: bool, variables: Variables) -> NDArray[np.int8]:
        """Return the label of each attribute that a right answer implies, (N,); -1 for no label.

        If a conjunction of several literals is false, no label follows, because any of them may be
        false.
        """
        labels = np.full(len(self.allowed), -1, np.int8)
        holds = answer != self.complement
        for indices in variables if holds or len(variables) == 1 else ():
            excluded = [index for index in indices if self.allowed[index] != holds]
            possible = [index for index in indices if self.allowed[index] == holds]
            if len(indices) == 1:
                labels[indices[0]] = self.allowed[indices[0]] == holds
            else:
                labels[excluded] = 0
                labels[possible if len(possible) == 1 else []] = 1
        return labels

    def text(self, attributes: Sequence[str], variables: Variables) -> str:
        """Return the event as text, such as "red and not empty"."""
        words = []
        for indices in variables:
            names = [attributes[p] for p in indices if self.allowed[p] != self.complement]
            others = [attributes[p] for p in indices if self.allowed[p] == self.complement]
            if len(indices) == 1:
                words += names or [denied(others[0])]
            elif len(names) == 1 or self.complement:
                words += names
            else:
                words += map(denied, others)
        return (" or " if self.complement else " and ").join(words)

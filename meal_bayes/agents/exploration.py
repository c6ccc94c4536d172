"""Exploration bonuses of training trials, beyond their own query: see `MOMDP.bonus`.

The paper's ITRS pays for percepts of high entropy and charges for experience, with weights that a
person chose (Eq. 11). Ours is Eq. 11 with weights that the posterior says: see `learning_value`.
"""

from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from meal_bayes.agents.learning_value import first_percept_value
from meal_bayes.agents.progress import Progress
from meal_bayes.arrays import plain_fields
from meal_bayes.momdp import MOMDP, add_itrs_bonus

# Percepts of a behavior in one trial that Eq. 11 pays for: as many as the paper's data sets have
# recordings, or a robot whose percepts do not run out would be paid until it is stopped.
_PAID_BY_ITRS = 10.0


@runtime_checkable
class ExplorationBonus(Protocol):
    """Shapes the rewards of training trials.

    Attributes
    ----------
    bonus_limit : float
        Percepts of a behavior in one trial that the bonus is paid for, at most.
    """

    @property
    def bonus_limit(self) -> float: ...  # noqa: D102  in the class's docstring

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the query's MOMDP with a bonus for exploring, given what was learned so far."""


def add_bonus(exploration: ExplorationBonus, momdp: MOMDP, progress: Progress) -> MOMDP:
    """Return the query's MOMDP with its bonus, and how many percepts of a trial it is paid for."""
    limit = np.full(momdp.n_behaviors, float(exploration.bonus_limit))
    return replace(exploration.shape(momdp, progress), bonus_limit=limit)


@dataclass(frozen=True, slots=True)
class NoBonus:
    """Answer the query at hand, and learn from what that shows."""

    bonus_limit: float = np.inf

    def __post_init__(self) -> None:
        plain_fields(self)

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP as it is."""
        return momdp


@dataclass(frozen=True, slots=True)
class ITRSBonus:
    """The paper's alpha Ent - beta IE (Eq. 11), with the published code's weights."""

    alpha: float = 6.0
    beta: float = 30.0
    bonus_limit: float = _PAID_BY_ITRS

    def __post_init__(self) -> None:
        plain_fields(self)

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with the shaped reward of Eq. 11."""
        domain = progress.knowledge.domain
        columns = domain.columns(momdp.query.attributes)
        experience = progress.instances[columns] / progress.unit
        return add_itrs_bonus(momdp, experience, self.alpha, self.beta, domain=domain)


@dataclass(frozen=True, slots=True)
class LearningBonus:
    """Eq. 11 with weights from the posterior: what one more labeled object teaches.

    It pays `first_percept_value` for a first percept; `as_equation_11` has the terms of Eq. 11.
    """

    bonus_limit: float = 1.0

    def __post_init__(self) -> None:
        plain_fields(self)

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with a bonus on the first percept of each behavior."""
        columns = progress.knowledge.domain.columns(momdp.query.attributes)
        bonus = np.zeros((len(columns), momdp.n_behaviors, 2))
        bonus[0] = first_percept_value(progress, columns)[:, None]  # rows are summed
        return replace(momdp, bonus=bonus)

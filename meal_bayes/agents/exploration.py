"""Exploration bonuses of training trials, beyond their own query: see `MOMDP.bonus`.

The paper's ITRS pays for percepts of high entropy and charges for experience, with weights that a
person chose. Ours values what a better table brings: after n objects a table's rates are known to
within a posterior standard deviation, one more object moves them by about 1 / (n + 1) of it, and
all queries to come gain from where they then are. No weight is left to choose, but for the number
of queries to come.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.arrays import Floats
from meal_bayes.domain import Query
from meal_bayes.momdp import MOMDP, Objective, build_momdp, observation_entropy, shape_reward
from meal_bayes.planners import batched_value_iteration


@dataclass(frozen=True, slots=True)
class Progress:
    """What a robot has learned when it plans a training trial.

    Attributes
    ----------
    knowledge : Knowledge
        So far.
    valued : Callable[[], Floats]
        Returns (P,E) `information_value` at the last refit, s a query.
    queries : float
        About each attribute, to come.
    unit : float
        Labelled instances that make one unit of experience, delta of Eq. 10.
    instances : NDArray[np.int64]
        (P,E) labelled instances: delta x IE of Eq. 10.
    objects : NDArray[np.int64]
        (P,E) objects with a labelled instance.
    fresh : NDArray[np.bool_]
        (P,E) whether the object at hand has none.
    labeled : NDArray[np.bool_]
        (P,) attributes of the object at hand that were labeled before and are remembered.
    """

    knowledge: Knowledge
    valued: Callable[[], Floats]
    queries: float
    unit: float
    instances: NDArray[np.int64]
    objects: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    labeled: NDArray[np.bool_]


# Recordings of an object by a behavior that the paper's data sets have, at most: Eq. 11 pays for as
# many, or a robot whose percepts do not run out would be paid until it is stopped.
RECORDED = 10.0


class ExplorationBonus(Protocol):
    """Shapes the rewards of training trials.

    Attributes
    ----------
    paid : float
        Percepts of a behavior in one trial that the bonus is paid for, at most.
    """

    @property
    def paid(self) -> float: ...  # noqa: D102  in the class's docstring

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the query's MOMDP with a bonus for exploring, given what was learned so far."""
        ...


@dataclass(frozen=True, slots=True)
class NoBonus:
    """Answer the query at hand, and learn from what that shows."""

    paid: float = np.inf

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP as it is."""
        return momdp


@dataclass(frozen=True, slots=True)
class ITRSBonus:
    """The paper's alpha Ent - beta IE (Eq. 11), with the published code's weights."""

    alpha: float = 6.0
    beta: float = 30.0
    paid: float = RECORDED

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with the shaped reward of Eq. 11."""
        domain = progress.knowledge.domain
        columns = domain.columns(momdp.query.attributes)
        experience = progress.instances[columns] / progress.unit
        return shape_reward(momdp, experience, self.alpha, self.beta, domain=domain)


@dataclass(frozen=True, slots=True)
class FittedITRSBonus:
    """Eq. 11 with the weights that come nearest to the value of information."""

    paid: float = RECORDED

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with the shaped reward of Eq. 11."""
        return ITRSBonus(*fitted_weights(progress)).shape(momdp, progress)


@dataclass(frozen=True, slots=True)
class InformationBonus:
    """The value of information for queries to come, paid for an object's first percepts."""

    paid: float = 1.0

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with a bonus on the first percept of each behavior."""
        domain = progress.knowledge.domain
        columns = domain.columns(momdp.query.attributes)
        bonus = np.zeros((len(columns), momdp.n_behaviors, 2))
        bonus[0] = first_percept_value(progress, columns)[:, None]
        return replace(momdp, bonus=bonus)


def information_value(knowledge: Knowledge, *, reward: float, discount: float) -> Floats:
    """Compute what one query about an attribute gains where a table is better known, (P,E), s.

    The gain of the optimal value when the rates of yes percepts of (attribute, behavior) are each
    better by their posterior's standard deviation.
    """
    domain, alpha = knowledge.domain, knowledge.posterior.concentration
    half = alpha.shape[-1] // 2
    weight = alpha.sum(axis=-1)  # (P,E,2)
    yes = alpha[..., half:].sum(axis=-1) / weight
    deviation = np.sqrt(yes * (1 - yes) / (weight + 1))
    senses = np.array(domain.recorded, int)
    believed = np.isin(np.arange(len(domain.behaviors)), senses) & (yes[..., 1] > yes[..., 0])
    flat = yes.mean(axis=-1, keepdims=True)
    now = np.where(believed[..., None], yes, flat)  # (P,E,2)
    better = np.clip(now + deviation * np.array([-1.0, 1.0]), 0.01, 0.99)
    p, e = believed.shape
    rates = np.repeat(now[:, None], 1 + e, axis=1)  # (P,1+E,E,2), the first as it is
    rates[:, 1 + senses, senses] = better[:, senses]
    query = Query(domain.attributes[:1])
    momdp = build_momdp(
        domain, query, np.full((1, e, 2, 2), 0.5), np.inf,
        objective=Objective(correct=reward, incorrect=-reward, discount=discount),
    )  # fmt: skip
    prior = np.repeat(knowledge.base_rates, 1 + e)
    values = batched_value_iteration(momdp, rates.reshape(-1, e, 2), prior).reshape(p, 1 + e)
    return np.asarray(np.maximum(values[:, 1:] - values[:, :1], 0.0))


def first_percept_value(progress: Progress, columns: list[int]) -> Floats:
    """Compute the value of a first percept of each behavior to the queries to come, (E,), s.

    It counts for the queried attributes and, with memory, for those labeled before. (For those
    labeled later too, but to record for them first costs more than it brings.)
    """
    new = np.tile(progress.labeled[:, None], progress.instances.shape[1])  # (P,E)
    new[columns] = True
    new &= progress.fresh
    return np.asarray((_object_value(progress) * new).sum(axis=0))


def fitted_weights(progress: Progress) -> tuple[float, float]:
    """Fit alpha and beta of Eq. 11 to the value of information, by nonnegative least squares.

    alpha Ent - beta IE, averaged over the truths, is fitted to the value of a first percept over
    all attributes and behaviors.
    """
    knowledge = progress.knowledge
    domain, senses = knowledge.domain, knowledge.domain.recorded
    confusion, _ = knowledge.posterior.select(range(len(domain.attributes)), exact=True)
    momdp = build_momdp(domain, Query(domain.attributes), confusion, np.inf)
    entropy = observation_entropy(momdp).mean(axis=-1)[:, senses]  # (P,E)
    value = _object_value(progress)[:, senses]
    ie = progress.instances[:, senses] / progress.unit
    (alpha, beta), _ = nnls(np.stack([entropy.ravel(), -ie.ravel()], axis=1), value.ravel())
    return float(alpha), float(beta)


def _object_value(progress: Progress) -> Floats:
    """Compute the value of one more object in each table, (P,E), s; it falls with their number."""
    return np.asarray(progress.queries * progress.valued() / (progress.objects + 1))

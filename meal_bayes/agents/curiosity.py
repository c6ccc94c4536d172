"""What a training trial is worth beyond its own query: bonuses for exploring.

The paper's ITRS pays for percepts of high entropy and takes for experience, with weights that a
person chose. Ours asks what a better table would be worth: after n objects a table's rates are
known to within a posterior standard deviation, one more object moves them by about 1 / (n + 1) of
it, and all queries to come gain from where they then are. No weight is left to choose, but for how
many queries are to come.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from meal_bayes.agents.experience import Experience
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.domain import Query
from meal_bayes.momdp import ITRS, build_momdp, observation_entropy
from meal_bayes.planners import batched_value_iteration

Array = NDArray[np.float64]


def information_value(knowledge: Knowledge, *, reward: float, discount: float) -> Array:
    """Value what one query about an attribute gains where a behavior tells more of it, (P,E), s.

    The gain of the optimal value when the rates of yes percepts of (attribute, behavior) are each
    better by their posterior's standard deviation.
    """
    domain, alpha = knowledge.domain, knowledge.posterior.concentration
    half = alpha.shape[-1] // 2
    weight = alpha.sum(axis=-1)  # (P,E,2)
    yes = alpha[..., half:].sum(axis=-1) / weight
    spread = np.sqrt(yes * (1 - yes) / (weight + 1))
    senses = np.array([bool(behavior.modalities) for behavior in domain.behaviors])
    told = senses & (yes[..., 1] > yes[..., 0])
    flat = yes.mean(axis=-1, keepdims=True)
    now = np.where(told[..., None], yes, flat)  # (P,E,2)
    better = np.clip(now + spread * np.array([-1.0, 1.0]), 0.01, 0.99)
    p, e = told.shape
    rates = np.repeat(now[:, None], 1 + e, axis=1)  # (P,1+E,E,2), the first as it is
    for behavior in np.flatnonzero(senses):
        rates[:, 1 + behavior, behavior] = better[:, behavior]
    query = Query(domain.attributes[:1])
    momdp = build_momdp(
        domain, query, np.full((1, e, 2, 2), 0.5), np.inf,
        correct=reward, incorrect=-reward, discount=discount,
    )  # fmt: skip
    prior = np.repeat(knowledge.base_rates, 1 + e)
    values = batched_value_iteration(momdp, rates.reshape(-1, e, 2), prior).reshape(p, 1 + e)
    return np.asarray(np.maximum(values[:, 1:] - values[:, :1], 0.0))


def exploration_bonus(
    value: Array,
    experience: Experience,
    object_index: int | None,
    columns: list[int],
    queries: float,
) -> Array:
    """Value a first percept of each behavior to the queries to come, (E,), s.

    Parameters
    ----------
    value : (P,E) from `information_value`.
    object_index : the object at hand, of which nothing is worth recording twice; None: a new one.
    columns : the queried attributes; with memory, those told of the object before teach as well.
        (Those still to be told would too, but to record for them first costs more than it brings.)
    queries : how many queries about each attribute are to come.
    """
    new = np.zeros(value.shape, np.bool_)  # (P,E)
    new[columns] = True
    if object_index is not None:
        if experience.memory:
            new |= experience.told[object_index][:, None] >= 0
        new &= ~experience.recorded()[object_index].T
    return np.asarray((_worth(value, experience, queries) * new).sum(axis=0))


def chosen_weights(
    value: Array, knowledge: Knowledge, experience: Experience, delta: float, queries: float
) -> ITRS:
    """Choose alpha and beta of Eq. 11 by what exploring is worth: nonnegative least squares.

    alpha Ent - beta IE, averaged over the truths, is fitted to the bonus of a first percept over
    all attributes and behaviors.
    """
    domain = knowledge.domain
    senses = np.array([bool(behavior.modalities) for behavior in domain.behaviors])
    confusion, _ = knowledge.posterior.select(range(len(domain.attributes)), exact=True)
    momdp = build_momdp(domain, Query(domain.attributes), confusion, np.inf)
    entropy = observation_entropy(momdp).mean(axis=-1)[:, senses]  # (P,E)
    worth = _worth(value, experience, queries)[:, senses]
    ie = experience.evidence()[:, senses] / delta
    (alpha, beta), _ = nnls(np.stack([entropy.ravel(), -ie.ravel()], axis=1), worth.ravel())
    return ITRS(float(alpha), float(beta), delta)


def _worth(value: Array, experience: Experience, queries: float) -> Array:
    """Value one more object in a table, (P,E), s: the more it has, the less another moves it."""
    objects = experience.recorded().sum(axis=0).T  # (P,E)
    return np.asarray(queries * value / (objects + 1))

"""Exploration bonuses of training trials, beyond their own query: see `MOMDP.bonus`.

The paper's ITRS pays for percepts of high entropy and charges for experience, with weights that a
person chose (Eq. 11). Ours is Eq. 11 with weights that the posterior says. With theta a pair's rate
and m its mean, the entropy of a percept is noise that stays plus what the percept teaches,

    Ent(m) = E Ent(theta) + I,

so alpha Ent - beta IE with alpha = beta and IE = E Ent(theta), experience in bits, pays alpha for
each bit that is learned. Alpha is the price of a labeled object (`label_prices`) over these bits.

How often an attribute is true decides what a percept can change, and is not known either: gains are
means over the posterior of the base rate, as each question to come will have the rate that is true.
"""

from dataclasses import dataclass, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from scipy.special import digamma, entr

from meal_bayes.agents.base_rates import RATES
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.agents.label_prices import AHEAD, explained, prices, rates_ahead
from meal_bayes.agents.progress import Progress
from meal_bayes.arrays import Bools, Floats, plain_fields
from meal_bayes.domain import Domain, Query
from meal_bayes.domain.event import wrong_reward
from meal_bayes.momdp import MOMDP, Objective, add_itrs_bonus, build_momdp
from meal_bayes.planners import batched_value_iteration

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

    It is paid for an object's first percept by each behavior. The prices of the queried attributes
    count and, with memory, of those labeled before; of all others as often as people tell more than
    they were asked for. `as_equation_11` has the terms of Eq. 11.
    """

    bonus_limit: float = 1.0

    def __post_init__(self) -> None:
        plain_fields(self)

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with a bonus on the first percept of each behavior."""
        columns = progress.knowledge.domain.columns(momdp.query.attributes)
        told = np.where(progress.labeled, 1.0, progress.told_fraction)
        told[columns] = 1.0
        price = learning_prices(progress, len(columns)) * told[:, None] * progress.fresh
        bonus = np.zeros((len(columns), momdp.n_behaviors, 2))
        bonus[0] = price.sum(axis=0)[:, None]  # rows are summed
        return replace(momdp, bonus=bonus)


class Equation11(NamedTuple):
    """A bonus as alpha Ent - beta IE of each attribute and behavior, (P,E), alpha = beta.

    Attributes
    ----------
    entropy : Floats
        Ent, bits, of a percept by the mean rates, over the truths.
    experience : Floats
        IE, bits: the expected entropy where the rates are known.
    weight : Floats
        Alpha and beta, s a bit.
    """

    entropy: Floats
    experience: Floats
    weight: Floats

    @property
    def bonus(self) -> Floats:
        """Return alpha Ent - beta IE, (P,E), s."""
        return self.weight * (self.entropy - self.experience)


def as_equation_11(progress: Progress, asked: int = 1) -> Equation11:
    """Return the prices of `learning_prices` as terms of Eq. 11, for people: no plan reads it."""
    alpha = progress.beta
    rates = progress.knowledge.base_rates[:, None]
    entropy = percept_entropy(alpha, rates)
    experience = experience_bits(alpha, rates)
    weight = learning_prices(progress, asked) / (entropy - experience)
    return Equation11(entropy, experience, weight)


def learning_prices(progress: Progress, asked: int) -> Floats:
    """Compute the price of one labeled object, (P,E), s, where so many attributes are asked.

    It is what `label_prices.prices` says, of rates learned from percepts of the pair alone.
    """
    knowledge = progress.knowledge
    share = asked / len(progress.labeled)  # of the questions are about an attribute
    pace = 1 / (share + (1 - share) * progress.told_fraction)  # trials until an object is labeled
    alpha = progress.beta  # (P,E,2,2)
    ahead = rates_ahead(alpha)  # (P,E,Z,2)
    believed = knowledge.posterior.informative  # (P,E)
    value, now = values_ahead(knowledge, ahead, believed, progress)
    # A better table of one attribute counts where the answers on all others are right.
    prob_right = np.clip((1 + now.mean() / progress.reward) / 2, 0.0, 1.0)
    questions = share * progress.horizon.after(pace * AHEAD) * prob_right ** (asked - 1)
    costs = np.array([behavior.cost for behavior in knowledge.domain.behaviors])
    variance_explained = explained(alpha, knowledge.base_rates[:, None])
    price = prices(value - now[:, None, None], variance_explained, questions, costs)
    senses = np.isin(np.arange(len(costs)), knowledge.domain.recorded)
    return np.asarray(np.where(senses, price, 0.0))


def values_ahead(
    knowledge: Knowledge, ahead: Floats, believed: Bools, progress: Progress
) -> tuple[Floats, Floats]:
    """Compute V of one question with each behavior's rates ahead (P,E,Z,2), all others as now.

    Returns (P,E,Z) and, with all as now, (P,), each the mean over the base rate's posterior. Rates
    in the wrong order carry no information, nor does what the planner does not believe (P,E) and is
    not better.
    """
    p, e, z, _ = ahead.shape
    flat = ahead.mean(axis=-1, keepdims=True)
    ordered = ahead[..., 1] > ahead[..., 0]
    better = np.arange(z) > z // 2
    ahead = np.where((ordered & (believed[..., None] | better))[..., None], ahead, flat)
    now = ahead[:, :, z // 2]  # (P,E,2)
    # Problems of a pair: first without any information by it, from which all others start.
    problems = np.concatenate([np.full((p, e, 1, 2), 0.5), ahead], axis=2)  # (P,E,1+Z,2)
    informs = problems[..., 0] != problems[..., 1]
    informs[:, :, 0] = True
    pair, behavior, node = np.nonzero(informs)
    rates = now[pair]  # (B,E,2)
    rates[np.arange(len(pair)), behavior] = problems[pair, behavior, node]
    attribute = np.concatenate([pair, np.arange(p)])
    uninformed = np.concatenate([node == 0, np.ones(p, np.bool_)])
    momdp = _one_question(knowledge.domain, progress)
    problems_rates = np.concatenate([rates, now])
    if knowledge.rates is None:
        prior = knowledge.base_rates[attribute]
        values = batched_value_iteration(momdp, problems_rates, prior, uninformed)
    else:
        prior = np.broadcast_to(RATES, (len(attribute), len(RATES)))
        values = batched_value_iteration(momdp, problems_rates, prior, uninformed)
        values = (values * knowledge.rates.probabilities[attribute]).sum(axis=1)
    value = np.where(informs, 0.0, np.nan)
    value[pair, behavior, node] = values[: len(pair)]
    value = np.where(informs, value, value[:, :, :1])
    return value[:, :, 1:], values[len(pair) :]


def percept_entropy(alpha: Floats, base_rates: Floats) -> Floats:
    """Compute Ent of Eq. 9 (...), bits, of the mean of Beta(alpha) (...,2,2), over the truths."""
    mean = alpha[..., 1] / alpha.sum(axis=-1)
    entropy = (entr(mean) + entr(1 - mean)) / np.log(2)  # (...,2)
    return np.asarray((1 - base_rates) * entropy[..., 0] + base_rates * entropy[..., 1])


def experience_bits(alpha: Floats, base_rates: Floats) -> Floats:
    """Compute IE as E Ent(theta), bits: what of a percept's entropy is noise, not ignorance."""
    total = alpha.sum(axis=-1)
    parts = alpha / total[..., None] * digamma(alpha + 1)
    bits = (digamma(total + 1) - parts.sum(axis=-1)) / np.log(2)
    return np.asarray((1 - base_rates) * bits[..., 0] + base_rates * bits[..., 1])


def _one_question(domain: Domain, progress: Progress) -> MOMDP:
    """Build the problem of one attribute, without shaping; its rows are not read."""
    objective = Objective(progress.reward, wrong_reward(progress.reward), progress.discount)
    rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    return build_momdp(domain, Query(domain.attributes[:1]), rows, np.inf, objective=objective)

"""What a first percept is worth to the questions to come: the weights of our Eq. 11.

With theta a pair's rate and m its mean, the entropy of a percept is noise that stays plus what the
percept teaches,

    Ent(m) = E Ent(theta) + I,

so alpha Ent - beta IE with alpha = beta and IE = E Ent(theta), experience in bits, pays alpha for
each bit that is learned. Alpha is the price of a labeled object (`prices`) over these bits.

Where people tell little but what was asked, a percept teaches one pair, and prices are not paid for
all that a trial teaches: there a better table is valued at one posterior standard deviation.
"""

from typing import NamedTuple

import numpy as np
from scipy.special import digamma, entr

from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.agents.label_prices import (
    AHEAD,
    explained,
    prices,
    rate_moments,
    rates_ahead,
    uncertain,
)
from meal_bayes.agents.progress import Progress
from meal_bayes.arrays import Bools, Floats, no_and_yes_of
from meal_bayes.domain import Domain, Query
from meal_bayes.domain.event import wrong_reward
from meal_bayes.momdp import MOMDP, Objective, build_momdp
from meal_bayes.planners import batched_value_iteration


def first_percept_value(progress: Progress, columns: list[int]) -> Floats:
    """Compute the value of a first percept of each behavior to the questions to come, (E,), s.

    It counts for the queried attributes and, with memory, for those labeled before; where people
    tell more than they were asked for, for all others as well, as often as these are told.
    """
    p = len(progress.labeled)
    certain = progress.labeled.copy()
    certain[columns] = True
    if progress.told_fraction <= 0.5 and len(columns) < p:  # mostly, only what was asked is told
        value = deviation_value(progress, len(columns)) * certain[:, None]
    else:
        value = learning_prices(progress, len(columns))
        value *= np.where(certain, 1.0, progress.told_fraction)[:, None]
    return np.asarray((value * progress.fresh).sum(axis=0))


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

    Returns (P,E,Z) and, with all as now, (P,). Rates in the wrong order carry no information, nor
    does what the planner does not believe (P,E) and is not better.
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
    prior = np.concatenate([knowledge.base_rates[pair], knowledge.base_rates])
    uninformed = np.concatenate([node == 0, np.ones(p, np.bool_)])
    momdp = _one_question(knowledge.domain, progress)
    values = batched_value_iteration(momdp, np.concatenate([rates, now]), prior, uninformed)
    value = np.where(informs, 0.0, np.nan)
    value[pair, behavior, node] = values[: len(pair)]
    value = np.where(informs, value, value[:, :, :1])
    return value[:, :, 1:], values[len(pair) :]


def deviation_value(progress: Progress, asked: int) -> Floats:
    """Compute the value of one more object in each table, (P,E), s, where few labels are told.

    What one question about an attribute gains where the rates of yes percepts of the pair are each
    better by their posterior's standard deviation; it falls with the number of objects.
    """
    knowledge = progress.knowledge
    domain = knowledge.domain
    levels = knowledge.posterior.concentration
    alpha = no_and_yes_of(levels)
    yes = alpha[..., 1] / alpha.sum(axis=-1)  # (P,E,2)
    senses = np.array(domain.recorded, int)
    sensed = np.isin(np.arange(len(domain.behaviors)), senses)
    believed = sensed & (yes[..., 1] > yes[..., 0])
    flat = yes.mean(axis=-1, keepdims=True)
    now = np.where(believed[..., None], yes, flat)
    better = deviated(alpha, now)
    p, e = believed.shape
    rates = np.repeat(now[:, None], 1 + e, axis=1)  # (P,1+E,E,2), the first as it is
    rates[:, 1 + senses, senses] = better[:, senses]
    prior = np.repeat(knowledge.base_rates, 1 + e)
    momdp = _one_question(domain, progress)
    values = batched_value_iteration(momdp, rates.reshape(-1, e, 2), prior).reshape(p, 1 + e)
    gain = np.maximum(values[:, 1:] - values[:, :1], 0.0)
    return np.asarray(progress.horizon.questions * asked / p * gain / (progress.objects + 1))


def deviated(alpha: Floats, rates: Floats | None = None) -> Floats:
    """Return rates (...,2) better by one posterior standard deviation each.

    Beta parameters are (...,2,2), no and yes; their means are the rates by default.
    """
    mean, variance = rate_moments(alpha)
    now = mean if rates is None else rates
    return uncertain(now + np.sqrt(variance) * np.array([-1.0, 1.0]))


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

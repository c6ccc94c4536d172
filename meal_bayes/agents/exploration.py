"""Exploration bonuses of training trials, beyond their own query: see `MOMDP.bonus`.

The paper's ITRS pays for percepts of high entropy and charges for experience, with weights that a
person chose (Eq. 11). Ours is Eq. 11 with weights that the posterior says. With theta a pair's rate
and m its mean, the entropy of a percept is noise that stays plus what the percept teaches,

    Ent(m) = E Ent(theta) + I,

so alpha Ent - beta IE with alpha = beta and IE = E Ent(theta), experience in bits, pays alpha for
each bit that is learned. Alpha is the price of a labeled object over these bits.

How often an attribute is true decides what a percept can change, and is not known either: gains are
means over the posterior of the base rate, as each question to come will have the rate that is true.

The price is what a robot should pay at most for one more labeled object. A learner's problem is
Bayes-adaptive: a behavior's rates are unknown, and knowing them better is worth something to every
question to come. It is solved here for one (attribute, behavior) at a time, as a problem of optimal
stopping. After m more labeled objects the mean rates have moved by part of what they can move, and
N(m) questions gain V(rates) - V(now) each; a robot may stop at any of the numbers m. The price of
one object is the highest at which it still buys:

    price = max over stopping times tau of  E[N(tau) (V(rates after tau) - V(now))] / E[tau],

the index of Gittins and Whittle; with tau a fixed number it is KG(*) [Frazier2010].

The rates move along one line, that of the difference J = Pr(yes | true) - Pr(yes | false), which
decides what they are worth; each rate takes its regression on J, with J as Normal, up to 2.2
standard deviations, for its true tails are lighter. Knowledge grows as the posterior variance
falls: m objects of a rate of which weight n is known explain m / (m + n) of it.

Behaviors are substitutes. The one whose learning brings most, after its costs, will be learned; the
others are worth what they add to that: E max(their gain, its gain) less E of its gain.

`Progress` is what a robot has learned when it plans a training trial, and how many questions are
to come.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, entr

from meal_bayes.agents.base_rates import RATES
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.arrays import Bools, ByValue, Floats, no_and_yes_of, plain_fields
from meal_bayes.domain import Domain, Query
from meal_bayes.domain.event import wrong_reward
from meal_bayes.momdp import MOMDP, Objective, add_itrs_bonus, build_momdp
from meal_bayes.planners import batched_value_iteration

_FIRST = 20.0  # questions that a robot expects before it was asked any


@dataclass(frozen=True, slots=True)
class Horizon:
    """Questions to come.

    After t questions, a robot that is given no number expects 20 + t more. This is the mean of a
    Pareto law [Lomax1954]: m more questions come with probability ((20 + t) / (20 + t + m))^2, and
    20 + t + m are expected after these.

    Attributes
    ----------
    asked : int
        Questions of training trials so far.
    expected : float | None
        To come, where a person told a number.
    """

    asked: int = 0
    expected: float | None = None

    def __post_init__(self) -> None:
        plain_fields(self)

    @property
    def questions(self) -> float:
        """Questions to come, expected now."""
        return _FIRST + self.asked if self.expected is None else self.expected

    def after(self, trials: Floats | float) -> Floats:
        """Return the questions expected to come after some trials more, of any shape."""
        now = self.questions
        if self.expected is None:
            return np.asarray(now**2 / (now + trials))
        return np.maximum(now - trials, 0.0)


@dataclass(frozen=True, slots=True)
class Progress(ByValue):
    """What a robot has learned when it plans a training trial.

    Attributes
    ----------
    knowledge : Knowledge
        So far.
    horizon : Horizon
        Questions to come.
    reward : float
        r+ = -r- of a report.
    discount : float
        Factor a step, in planning.
    percepts : NDArray[np.float64]
        (P,E,2,2) labeled objects by truth and percept, no and yes; repeats share the one of their
        object, and what a classifier shows that cannot tell yet is half of each.
    told_fraction : float
        Fraction of the labels beyond one that people have told of an object, by Laplace's rule.
    unit : float
        Labeled instances that make one unit of experience, delta of Eq. 10.
    instances : NDArray[np.int64]
        (P,E) labeled instances: delta x IE of Eq. 10.
    objects : NDArray[np.int64]
        (P,E) objects with a labeled instance.
    fresh : NDArray[np.bool_]
        (P,E) whether the object at hand has none.
    labeled : NDArray[np.bool_]
        (P,) attributes of the object at hand that were labeled before and are remembered.
    values : dict[bytes, NDArray[np.float64]]
        What `values_ahead` computed of an attribute, kept from one trial to the next.
    """

    knowledge: Knowledge
    horizon: Horizon
    reward: float
    discount: float
    percepts: NDArray[np.float64]
    told_fraction: float
    unit: float
    instances: NDArray[np.int64]
    objects: NDArray[np.int64]
    fresh: NDArray[np.bool_]
    labeled: NDArray[np.bool_]
    values: dict[bytes, NDArray[np.float64]] = field(
        default_factory=dict, repr=False, compare=False
    )

    @property
    def beta(self) -> NDArray[np.float64]:
        """Beta parameters (P,E,2,2) of the rates, no and yes by truth.

        The prior is uniform, or that of percepts which the robot brings.
        """
        posterior = self.knowledge.posterior
        prior = np.ones(self.percepts.shape)
        if posterior.given_prior is not None:
            given = posterior.given
            prior[given] = no_and_yes_of(posterior.given_prior)[given]
        return np.asarray(prior + self.percepts)


# m, labeled objects after which a robot may stop
AHEAD: Floats = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0])
_Z = np.linspace(-2.2, 2.2, 9)  # of J, standard deviations from its mean
_MIDDLE = len(_Z) // 2
_LEAST = 0.01  # rates that may be found are at least this far from 0 and 1
_ROUNDS = 6  # of the search for a price, which grows in each, at most

_NORMAL = np.exp(-(_Z**2) / 2) / np.exp(-(_Z**2) / 2).sum()


def rate_moments(alpha: Floats) -> tuple[Floats, Floats]:
    """Return mean and variance (...) of rates of yes, from Beta parameters (...,2), no and yes."""
    total = alpha.sum(axis=-1)
    mean = alpha[..., 1] / total
    return mean, mean * (1 - mean) / (total + 1)


def uncertain(rates: Floats) -> Floats:
    """Return rates that are neither 0 nor 1, as none that may be found is."""
    return np.asarray(np.clip(rates, _LEAST, 1 - _LEAST))


def rates_ahead(alpha: Floats) -> Floats:
    """Return rates (...,Z,2) that may be found true, from Beta parameters (...,2,2), no and yes."""
    mean, variance = rate_moments(alpha)
    deviation = np.sqrt(variance)  # (...,2)
    direction = deviation / np.sqrt((deviation**2).sum(axis=-1, keepdims=True))
    moved = deviation * direction * np.array([-1.0, 1.0])
    rates = mean[..., None, :] + _Z[:, None] * moved[..., None, :]  # (...,Z,2)
    return uncertain(rates)


def explained(alpha: Floats, base_rates: Floats) -> Floats:
    """Return the part (...,M) of the variance of J that `AHEAD` more labeled objects explain."""
    total = alpha.sum(axis=-1)
    variance = rate_moments(alpha)[1][..., None]  # (...,2,1)
    objects = np.stack([1 - base_rates, base_rates], axis=-1)[..., None] * AHEAD  # (...,2,M)
    reduction = variance * objects / (objects + total[..., None])
    return np.asarray(reduction.sum(axis=-2) / variance.sum(axis=-2))


def prices(gain: Floats, variance_explained: Floats, questions: Floats, costs: Floats) -> Floats:
    """Return the price (R,E) of a labeled object of each behavior, of R attributes.

    Parameters
    ----------
    gain : Floats
        (R,E,Z) V(rates ahead) - V(now), s a question.
    variance_explained : Floats
        (R,E,M) part of the variance that `AHEAD` more objects explain.
    questions : Floats
        (M,) or (R,M) to come once as many objects are labeled.
    costs : Floats
        (E,) or (R,E) of a percept, s.
    """
    r, e, z = gain.shape
    moves = _transitions(variance_explained.reshape(r * e, -1))
    to_come = np.repeat(np.broadcast_to(questions, (r, len(AHEAD))), e, axis=0)
    alone = _index(gain.reshape(r * e, z), moves, to_come).reshape(r, e)
    if e == 1:
        return alone
    lead = (alone - costs).argmax(axis=1)[:, None]
    leads = np.take_along_axis(alone - costs, lead, axis=1) > 0
    # What the leader's gain will be, once it is learned as far as questions allow.
    explained_in_the_end = np.sqrt(variance_explained[..., -1])[..., None]
    lead_gain = _interpolated(gain, explained_in_the_end * _Z)
    lead_gain = np.take_along_axis(lead_gain, lead[..., None], axis=1)[:, 0]  # (R,Z)
    # E max(gain, the leader's) less E of the leader's: what is added to it.
    best_gain = np.maximum(gain[..., None], lead_gain[:, None, None]) @ _NORMAL  # (R,E,Z)
    added = best_gain - (np.maximum(lead_gain, 0.0) @ _NORMAL)[:, None, None]
    beside = _index(added.reshape(r * e, z), moves, to_come).reshape(r, e)
    return np.where(leads & (np.arange(e) != lead), beside, alone)


def _interpolated(values: Floats, z: Floats) -> Floats:
    """Interpolate values (...,Z) at z (...,J)."""
    position = np.clip((z - _Z[0]) / (_Z[1] - _Z[0]), 0.0, len(_Z) - 1)
    low = np.minimum(position.astype(np.intp), len(_Z) - 2)
    below = np.take_along_axis(values, low, axis=-1)
    above = np.take_along_axis(values, low + 1, axis=-1)
    return np.asarray(below + (position - low) * (above - below))


def _transitions(variance_explained: Floats) -> Floats:
    """Return Pr(z' | z) between stages, (n,M,Z,Z): z is a Brownian motion in what is explained.

    Three points have the mean and the variance of each step, and nearly its fourth moment.
    """
    variance = np.maximum(np.diff(variance_explained, prepend=0.0, axis=1), 0.0)  # (n,M)
    width = _Z[1] - _Z[0]
    far = np.maximum(np.rint(np.sqrt(3 * variance) / width), 1.0)
    chance = variance / (2 * (far * width) ** 2)
    n, m = variance_explained.shape
    moves = np.zeros((n, m, len(_Z), len(_Z)))
    row, stage = np.ogrid[:n, :m]
    for z in range(len(_Z)):
        for sign in (-1, 1):
            to = np.clip(z + sign * far.astype(np.intp), 0, len(_Z) - 1)
            moves[row, stage, z, to] += chance
        moves[:, :, z, z] += 1 - 2 * chance
    return moves


def _index(gain: Floats, moves: Floats, questions: Floats) -> Floats:
    """Return the price (n,) of gains (n,Z): at a price the best stopping time, and again at its.

    Each round's price is the ratio of what the last round's stopping time gains and takes, so it
    rises to the maximum (Dinkelbach).
    """
    price = np.zeros(len(gain))
    for _ in range(_ROUNDS):
        pay = questions[:, -1:] * gain
        taken = np.full(gain.shape, AHEAD[-1])
        for stage in reversed(range(len(AHEAD))):
            pay = np.einsum("nzj,nj->nz", moves[:, stage], pay)
            taken = np.einsum("nzj,nj->nz", moves[:, stage], taken)
            if stage:
                # Going on is worth what it pays less the price of the objects that it takes.
                pay_now = questions[:, stage - 1, None] * gain
                taken_now = AHEAD[stage - 1]
                goes_on = pay - price[:, None] * taken > pay_now - price[:, None] * taken_now
                pay = np.where(goes_on, pay, pay_now)
                taken = np.where(goes_on, taken, taken_now)
        before = price
        price = np.maximum(price, pay[:, _MIDDLE] / taken[:, _MIDDLE])
        if (price == before).all():  # and so would all further rounds be
            break
    return price


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

    It is what `prices` says, of rates learned from percepts of the pair alone.
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
    values = np.empty(len(attribute))
    weights = None if knowledge.rates is None else knowledge.rates.probabilities
    for number in range(p):
        # An attribute's problems start from no other's values, and most attributes stay from one
        # trial to the next.
        rows = np.flatnonzero(attribute == number)
        prior = knowledge.base_rates[[number]] if weights is None else RATES
        each = problems_rates[rows]
        key = each.tobytes() + uninformed[rows].tobytes() + prior.tobytes()
        if key not in progress.values:
            priors = np.tile(prior, (len(rows), 1))
            progress.values[key] = batched_value_iteration(momdp, each, priors, uninformed[rows])
        by_prior = progress.values[key]
        if weights is None:
            values[rows] = by_prior[:, 0]
        else:
            values[rows] = (by_prior * weights[number]).sum(axis=1)
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

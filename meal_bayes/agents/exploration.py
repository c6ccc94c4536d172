"""Exploration bonuses of training trials, for the benefit of later questions: see `MOMDP.bonus`.

The paper's bonus (ITRS, Eq. 11) is positive for percepts with high entropy and decreases with
experience, with weights that a person chose. The bonus of `bayes` is Eq. 11 with weights that are
computed from the posterior. Let theta be a rate Pr(yes | truth) of a pair (attribute, behavior),
and m its mean. The entropy of a percept is the sum of irreducible noise and of the information I
that the percept gives about theta:

    Ent(m) = E Ent(theta) + I.

With alpha = beta and the experience IE = E Ent(theta) in bits, the bonus alpha Ent - beta IE is
alpha for each bit that is learned. Alpha is the price of a labeled object divided by I.

The base rate of an attribute determines whether a percept can change an answer, and is not known
either. Therefore gains are means over the posterior of the base rate.

The price is the largest cost that a robot should pay for one more labeled object. The problem of a
learner is Bayes-adaptive: the rates of a behavior are unknown, and better estimates increase the
value of every later question. It is solved for one (attribute, behavior) at a time, as a problem of
optimal stopping. After m more labeled objects, the mean rates have changed, and each of the N(m)
remaining questions gains V(rates) - V(now). A robot may stop after any of the numbers m. The price
of one object is the highest price at which learning still pays:

    price = max over stopping times tau of  E[N(tau) (V(rates after tau) - V(now))] / E[tau].

This is an index like those of Gittins and Whittle; for a fixed tau it is KG(*) [Frazier2010].

The rates change along one line, that of the difference J = Pr(yes | true) - Pr(yes | false), which
determines their value. Each rate is replaced by its regression on J. J is treated as Normal, up to
2.2 standard deviations, because its true tails are lighter. As objects are labeled, the posterior
variance falls: m more objects explain m / (m + n) of the variance of a rate whose posterior has the
weight n.

Behaviors can replace each other. The behavior with the largest gain after its costs gets its own
price; each other behavior gets the gain that it adds: E max(own gain, gain of the best) minus
E gain of the best.

`Progress` contains what a robot has learned when it plans a training trial, and the number of
questions that it still expects.
"""

from dataclasses import dataclass, field, replace
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray
from scipy.special import digamma, entr, gammaln, softmax

from meal_bayes.agents.base_rates import RATES
from meal_bayes.agents.knowledge import Knowledge
from meal_bayes.arrays import Bools, ByValue, Floats, no_and_yes_of, plain_fields
from meal_bayes.domain import Domain, Payoffs, Query
from meal_bayes.domain.event import wrong_reward
from meal_bayes.momdp import MOMDP, Objective, add_itrs_bonus, build_momdp
from meal_bayes.planners import batched_value_iteration

_FIRST = 20.0  # questions that a robot expects before it was asked any


@dataclass(frozen=True, slots=True)
class Horizon:
    """Number of questions that a robot still expects.

    By default, a robot expects 20 + t more questions after t questions. This is the mean of a
    Pareto distribution [Lomax1954]: at least m more questions come with probability
    ((20 + t) / (20 + t + m))^2. After m more questions, the robot expects another 20 + t + m
    questions.

    Attributes
    ----------
    asked : int
        Number of questions in training trials so far.
    expected : float | None
        Number of questions to come, if a person has stated it.
    """

    asked: int = 0
    expected: float | None = None

    def __post_init__(self) -> None:
        plain_fields(self)

    @property
    def questions(self) -> float:
        """Number of questions that are expected now."""
        return _FIRST + self.asked if self.expected is None else self.expected

    def after(self, trials: Floats | float) -> Floats:
        """Return the expected number of questions after `trials` more trials (array or number)."""
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
        Current knowledge of the robot.
    horizon : Horizon
        Expected number of questions.
    reward : float
        Reward r+ of a right report; a wrong report has the reward r- = -r+.
    discount : float
        Discount factor of a step in planning.
    percepts : NDArray[np.float64]
        (P,E,2,2) number of labeled objects for each attribute and behavior, by truth and percept
        (no, yes). Each object has the weight 1, which its repeated percepts share equally. A
        percept of a classifier without information counts as half no and half yes.
    told_fraction : float
        Fraction of the other attributes that people label too when they label one attribute,
        estimated by Laplace's rule.
    unit : float
        Number of labeled instances in one unit of experience (delta in Eq. 10).
    instances : NDArray[np.int64]
        (P,E) number of instances of each behavior that have a label of each attribute (delta x IE
        in Eq. 10).
    objects : NDArray[np.int64]
        (P,E) number of objects that have at least one such instance.
    fresh : NDArray[np.bool_]
        (P,E) True if the object of the current trial has no such instance yet.
    labeled : NDArray[np.bool_]
        (P,) True for an attribute whose label is remembered for the object of the current trial.
    values : dict[bytes, NDArray[np.float64]]
        Cache of the results of `values_ahead`, kept from one trial to the next.
    payoffs : Payoffs | None
        Payoffs of yes and no in later yes-or-no questions and in later questions about one
        attribute. None if every right report has the reward `reward`.
    abstain : bool
        Whether the robot may answer "I do not know". This matters only with payoffs. Without
        payoffs, the best report of one attribute never has a negative expected reward.
    asked_about : NDArray[np.int64] | None
        (P,) number of questions about each attribute so far, including the current question. None
        if all attributes are asked about equally often.
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
    payoffs: Payoffs | None = None
    abstain: bool = False
    asked_about: NDArray[np.int64] | None = None

    @property
    def beta(self) -> NDArray[np.float64]:
        """Beta parameters (P,E,2,2) of the percept rates: of no and of yes, by truth.

        The prior is uniform, except for percepts of the robot's own detector.
        """
        posterior = self.knowledge.posterior
        prior = np.ones(self.percepts.shape)
        if posterior.given_prior is not None:
            given = posterior.given
            prior[given] = no_and_yes_of(posterior.given_prior)[given]
        return np.asarray(prior + self.percepts)


# m, the numbers of labeled objects after which a robot may stop
AHEAD: Floats = np.array([1.0, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0, 16.0, 24.0, 32.0, 48.0, 64.0])
_Z = np.linspace(-2.2, 2.2, 9)  # of J, standard deviations from its mean
_MIDDLE = len(_Z) // 2
_LEAST = 0.01  # smallest distance of a rate from 0 and 1
_ROUNDS = 6  # largest number of iterations of the search for a price
# Concentrations of the Dirichlet prior of what is asked: from always the same to all alike.
_CONCENTRATIONS: Floats = np.exp2(np.arange(11.0))

_NORMAL = np.exp(-(_Z**2) / 2) / np.exp(-(_Z**2) / 2).sum()


def rate_moments(alpha: Floats) -> tuple[Floats, Floats]:
    """Return mean and variance (...) of rates of yes, from Beta parameters (...,2), no and yes."""
    total = alpha.sum(axis=-1)
    mean = alpha[..., 1] / total
    return mean, mean * (1 - mean) / (total + 1)


def uncertain(rates: Floats) -> Floats:
    """Clip rates to an interval without 0 and 1."""
    return np.asarray(np.clip(rates, _LEAST, 1 - _LEAST))


def rates_ahead(alpha: Floats) -> Floats:
    """Return possible rates (...,Z,2) on a line, from Beta parameters (...,2,2), no and yes."""
    mean, variance = rate_moments(alpha)
    deviation = np.sqrt(variance)  # (...,2)
    direction = deviation / np.sqrt((deviation**2).sum(axis=-1, keepdims=True))
    moved = deviation * direction * np.array([-1.0, 1.0])
    rates = mean[..., None, :] + _Z[:, None] * moved[..., None, :]  # (...,Z,2)
    return uncertain(rates)


def explained(alpha: Floats, base_rates: Floats) -> Floats:
    """Return the fraction (...,M) of the variance of J that `AHEAD` more objects explain."""
    total = alpha.sum(axis=-1)
    variance = rate_moments(alpha)[1][..., None]  # (...,2,1)
    objects = np.stack([1 - base_rates, base_rates], axis=-1)[..., None] * AHEAD  # (...,2,M)
    reduction = variance * objects / (objects + total[..., None])
    return np.asarray(reduction.sum(axis=-2) / variance.sum(axis=-2))


def prices(gain: Floats, variance_explained: Floats, questions: Floats, costs: Floats) -> Floats:
    """Return the price (R,E) in seconds of one labeled object, for R attributes and E behaviors.

    Parameters
    ----------
    gain : Floats
        (R,E,Z) V(rates ahead) - V(now) for one question, in seconds.
    variance_explained : Floats
        (R,E,M) fraction of the variance that `AHEAD` more objects explain.
    questions : Floats
        (M,) or (R,M) number of questions that are left after `AHEAD` more labeled objects.
    costs : Floats
        (E,) or (R,E) cost of a percept in seconds.
    """
    r, e, z = gain.shape
    moves = _transitions(variance_explained.reshape(r * e, -1))
    to_come = np.repeat(np.broadcast_to(questions, (r, len(AHEAD))), e, axis=0)
    alone = _index(gain.reshape(r * e, z), moves, to_come).reshape(r, e)
    if e == 1:
        return alone
    lead = (alone - costs).argmax(axis=1)[:, None]
    leads = np.take_along_axis(alone - costs, lead, axis=1) > 0
    # The gain of the best behavior after the largest number of labeled objects.
    explained_in_the_end = np.sqrt(variance_explained[..., -1])[..., None]
    lead_gain = _interpolated(gain, explained_in_the_end * _Z)
    lead_gain = np.take_along_axis(lead_gain, lead[..., None], axis=1)[:, 0]  # (R,Z)
    # E max(gain, gain of the best) minus E gain of the best.
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
    """Return Pr(z' | z) between stages, (n,M,Z,Z).

    z is a Brownian motion whose time is the explained variance. A step has three points, with the
    exact mean and variance and nearly the fourth moment.
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
    """Return the price (n,) for gains (n,Z), by Dinkelbach's method.

    Each iteration computes the best stopping time at the current price. The next price is the
    ratio of expected gain and expected duration of this stopping time; it rises to the maximum.
    """
    price = np.zeros(len(gain))
    for _ in range(_ROUNDS):
        pay = questions[:, -1:] * gain
        taken = np.full(gain.shape, AHEAD[-1])
        for stage in reversed(range(len(AHEAD))):
            pay = np.einsum("nzj,nj->nz", moves[:, stage], pay)
            taken = np.einsum("nzj,nj->nz", moves[:, stage], taken)
            if stage:
                # Continue if the gain minus the price of the further objects is higher.
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


# Largest number of percepts of a behavior in a trial that have the bonus of Eq. 11. It is the
# largest number of recordings in the paper's data sets; without a limit, a robot could repeat a
# behavior forever for the bonus.
_PAID_BY_ITRS = 10.0


@runtime_checkable
class ExplorationBonus(Protocol):
    """Exploration bonus that is added to the rewards of training trials.

    Attributes
    ----------
    bonus_limit : float
        Number of percepts of each behavior that earn the bonus in one trial; later percepts earn
        none.
    """

    @property
    def bonus_limit(self) -> float: ...  # noqa: D102  in the class's docstring

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the query's MOMDP with an exploration bonus, given what was learned so far."""


def add_bonus(exploration: ExplorationBonus, momdp: MOMDP, progress: Progress) -> MOMDP:
    """Return the query's MOMDP with the exploration bonus and its `bonus_limit`."""
    limit = np.full(momdp.n_behaviors, float(exploration.bonus_limit))
    return replace(exploration.shape(momdp, progress), bonus_limit=limit)


@dataclass(frozen=True, slots=True)
class NoBonus:
    """No exploration bonus: the agent learns only from percepts that its questions need."""

    bonus_limit: float = np.inf

    def __post_init__(self) -> None:
        plain_fields(self)

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP unchanged."""
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
    """Eq. 11 with weights from the posterior: the value of one more labeled object.

    The robot earns the bonus for the first percept of an object by each behavior. The bonus is a
    sum of prices over the attributes; a price is the value in seconds of one more labeled object.
    Queried attributes and attributes with a remembered label have their full price. The price of
    any other attribute is multiplied by the fraction of the other attributes that people label.
    `as_equation_11` returns the terms of Eq. 11.
    """

    bonus_limit: float = 1.0

    def __post_init__(self) -> None:
        plain_fields(self)

    def shape(self, momdp: MOMDP, progress: Progress) -> MOMDP:
        """Return the MOMDP with a bonus on the first percept of each behavior."""
        columns = progress.knowledge.domain.columns(momdp.query.attributes)
        told = np.where(progress.labeled, 1.0, progress.told_fraction)
        told[columns] = 1.0
        if not momdp.query.yes_or_no:  # reports of several values have the reward
            progress = replace(progress, payoffs=None)
        price = learning_prices(progress, len(columns)) * told[:, None] * progress.fresh
        bonus = np.zeros((len(columns), momdp.n_behaviors, 2))
        bonus[0] = price.sum(axis=0)[:, None]  # rows are summed
        return replace(momdp, bonus=bonus)


class Equation11(NamedTuple):
    """The bonus alpha Ent - beta IE of each attribute and behavior, (P,E), with alpha = beta.

    Attributes
    ----------
    entropy : Floats
        (P,E) entropy Ent of a percept in bits, at the mean rates, averaged over the truth.
    experience : Floats
        (P,E) experience IE in bits: the expected entropy if the rates were known.
    weight : Floats
        (P,E) alpha and beta, in seconds per bit.
    """

    entropy: Floats
    experience: Floats
    weight: Floats

    @property
    def bonus(self) -> Floats:
        """Return alpha Ent - beta IE in seconds, (P,E)."""
        return self.weight * (self.entropy - self.experience)


def as_equation_11(progress: Progress, asked: int = 1) -> Equation11:
    """Return the prices of `learning_prices` as terms of Eq. 11, for display; plans use prices.

    `asked` is the number of attributes in a question.
    """
    alpha = progress.beta
    rates = progress.knowledge.base_rates[:, None]
    entropy = percept_entropy(alpha, rates)
    experience = experience_bits(alpha, rates)
    weight = learning_prices(progress, asked) / (entropy - experience)
    return Equation11(entropy, experience, weight)


def learning_prices(progress: Progress, asked: int) -> Floats:
    """Compute the price in seconds of one labeled object for each attribute and behavior, (P,E).

    `asked` is the number of attributes in a question. The prices are those of `prices`, with rates
    that are learned only from percepts of the pair.
    """
    knowledge = progress.knowledge
    asked_about = progress.asked_about
    if asked_about is None:
        asked_about = np.zeros(len(progress.labeled), np.int64)
    # Fraction of the questions that contain each attribute, (P,1)
    share = np.minimum(asked * expected_shares(asked_about)[:, None], 1.0)
    pace = 1 / (share + (1 - share) * progress.told_fraction)  # trials for one labeled object
    alpha = progress.beta  # (P,E,2,2)
    ahead = rates_ahead(alpha)  # (P,E,Z,2)
    believed = knowledge.posterior.informative  # (P,E)
    value, now = values_ahead(knowledge, ahead, believed, progress)
    # Knowing one attribute better increases the reward only if all other answers are right.
    best, worst = progress.reward, wrong_reward(progress.reward)
    if progress.payoffs is not None:
        best, worst = max(progress.payoffs), min(progress.payoffs)
    middle, half = (best + worst) / 2, (best - worst) / 2
    prob_right = np.clip((1 + (now.mean() - middle) / half) / 2, 0.0, 1.0)
    questions = share * progress.horizon.after(pace * AHEAD) * prob_right ** (asked - 1)
    costs = np.array([behavior.cost for behavior in knowledge.domain.behaviors])
    variance_explained = explained(alpha, knowledge.base_rates[:, None])
    price = prices(value - now[:, None, None], variance_explained, questions, costs)
    senses = np.isin(np.arange(len(costs)), knowledge.domain.recorded)
    return np.asarray(np.where(senses, price, 0.0))


def expected_shares(counts: NDArray[np.int64]) -> Floats:
    """Return the probability (P,) that the next question is about each attribute.

    What is asked is drawn from a distribution with the prior Dirichlet(c/P, ..., c/P), and `counts`
    (P,) was asked so far. The concentration c is small if people ask about few attributes, and
    large if they ask about all alike; it is learned from a uniform prior on log c.
    """
    share = _CONCENTRATIONS[:, None] / len(counts)
    counted = (gammaln(share + counts) - gammaln(share)).sum(axis=1)
    evidence = gammaln(_CONCENTRATIONS) - gammaln(_CONCENTRATIONS + counts.sum()) + counted
    expected = (share + counts) / (_CONCENTRATIONS[:, None] + counts.sum())
    return np.asarray(softmax(evidence) @ expected)


def values_ahead(
    knowledge: Knowledge, ahead: Floats, believed: Bools, progress: Progress
) -> tuple[Floats, Floats]:
    """Compute the value of a question for possible rates of one behavior, with the others as now.

    Parameters
    ----------
    knowledge : Knowledge
        Current knowledge, with the posterior of the base rates.
    ahead : Floats
        (P,E,Z,2) possible rates of each pair.
    believed : Bools
        (P,E) pairs that the planner treats as informative.
    progress : Progress
        Rewards and discount; `progress.values` caches results.

    Returns
    -------
    value : Floats
        (P,E,Z) value with the possible rates of one behavior, averaged over the base rate.
    now : Floats
        (P,) value with the current rates of all behaviors.

    Notes
    -----
    Rates with Pr(yes | true) <= Pr(yes | false) count as uninformative. So do rates of a pair that
    the planner does not believe, unless they are better than the mean.
    """
    p, e, z, _ = ahead.shape
    flat = ahead.mean(axis=-1, keepdims=True)
    ordered = ahead[..., 1] > ahead[..., 0]
    better = np.arange(z) > z // 2
    ahead = np.where((ordered & (believed[..., None] | better))[..., None], ahead, flat)
    now = ahead[:, :, z // 2]  # (P,E,2)
    # Problems for a pair: the first one without information, from which the others start.
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
    earned = np.array(progress.payoffs or ()).tobytes()
    for number in range(p):
        # The problems of an attribute do not depend on other attributes, and for most attributes
        # they do not change from one trial to the next, so they are cached.
        rows = np.flatnonzero(attribute == number)
        prior = knowledge.base_rates[[number]] if weights is None else RATES
        each = problems_rates[rows]
        key = each.tobytes() + uninformed[rows].tobytes() + prior.tobytes() + earned
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
    """Compute Ent of Eq. 9 in bits (...), at the mean of Beta(alpha) (...,2,2), over the truths."""
    mean = alpha[..., 1] / alpha.sum(axis=-1)
    entropy = (entr(mean) + entr(1 - mean)) / np.log(2)  # (...,2)
    return np.asarray((1 - base_rates) * entropy[..., 0] + base_rates * entropy[..., 1])


def experience_bits(alpha: Floats, base_rates: Floats) -> Floats:
    """Compute IE as E Ent(theta) in bits: the part of a percept's entropy that is noise."""
    total = alpha.sum(axis=-1)
    parts = alpha / total[..., None] * digamma(alpha + 1)
    bits = (digamma(total + 1) - parts.sum(axis=-1)) / np.log(2)
    return np.asarray((1 - base_rates) * bits[..., 0] + base_rates * bits[..., 1])


def _one_question(domain: Domain, progress: Progress) -> MOMDP:
    """Build the problem of one attribute without a bonus; its rows are placeholders."""
    objective = Objective(
        progress.reward,
        wrong_reward(progress.reward),
        progress.discount,
        abstain=progress.abstain and progress.payoffs is not None,
        payoffs=progress.payoffs,
    )
    rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    domain = replace(domain, payoffs=None)  # those of `progress` apply
    return build_momdp(domain, Query(domain.attributes[:1]), rows, np.inf, objective=objective)

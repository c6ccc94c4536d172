"""Build the MOMDP of a query (Alg. 1, l. 1-4), where only queried attributes enter, and shape it.

Information-theoretic reward shaping (ITRS) is the paper's Eqs 9 to 11. Reward is added where
percepts have high entropy, and subtracted where experience is large. With Eq. 8 the entropy of a
state is the sum over the queried attributes, and the experience of a query is the mean over them,
so the shaping factors into `MOMDP.bonus` (N,E,2).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import (
    Floats,
    freeze,
    real_array,
    shaped_array,
    spread_array,
    tiny_is_zero,
    yes_of,
)
from meal_bayes.domain import Domain, Payoffs, Query, load_domain
from meal_bayes.domain.event import wrong_reward
from meal_bayes.errors import SettingsError
from meal_bayes.momdp.model import DISCOUNT, MOMDP


@dataclass(frozen=True, slots=True)
class Objective:
    """What a planner maximizes.

    Attributes
    ----------
    correct, incorrect : float | None
        Rewards r+ and r- of a right and a wrong report. By default they are those of the domain.
    discount : float
        Discount factor of a step, used in planning only.
    abstain : bool
        Whether the agent may answer "I do not know", if the domain's diagram allows it.
    payoffs : Payoffs | None
        Payoffs of yes and no for a query without payoffs of its own. By default they are the
        domain's payoffs.
    """

    correct: float | None = None
    incorrect: float | None = None
    discount: float = DISCOUNT
    abstain: bool = False
    payoffs: Payoffs | None = None


@tiny_is_zero
def build_momdp(
    domain: str | Path | Mapping[str, Any] | Domain,
    query: Query,
    confusion: ArrayLike,
    precision: ArrayLike = np.inf,
    *,
    prior: ArrayLike = 0.5,
    limit: ArrayLike = np.inf,
    latent_classes: ArrayLike | None = None,
    objective: Objective | None = None,
) -> MOMDP:
    """Build the MOMDP of a query from a domain and the confusion matrices of the attributes.

    The answer of a person depends on the truth alone. So if a behavior asks a person (`ask`), and a
    latent class contains true and false objects, every class is split in two: the MOMDP then has C
    classes of false objects, followed by C classes of true objects.

    Parameters
    ----------
    domain : str, path, mapping or Domain
        Domain, as for `Learner`, with its behaviors, costs and state transitions.
    query : Query
        The question, about N attributes.
    confusion : ArrayLike
        (N,E,C,K) mean probability of each percept level given the latent class. In the paper C = 2,
        and the class is the truth. Rows of behaviors that ask a person are replaced: a person's
        answer about each attribute is right with the accuracy in the domain.
    precision : ArrayLike
        Dirichlet precision of the rows of `confusion`, (N,E,C) or one number. The paper's Eq. 8 is
        the case inf.
    prior : ArrayLike
        Pr(attribute is true) before the trial, (N,) or one number; the default 0.5 is the paper's.
        Probabilities of the values of a group are scaled to sum to 1.
    limit : ArrayLike
        Maximum number of percepts of each behavior in a trial, (E,) or one number for all.
    latent_classes : ArrayLike | None
        (N,2,C) Pr(latent class | truth). By default the class is the truth.
    objective : Objective | None
        Rewards and discount factor. By default they are the domain's rewards and 0.99 per step.

    Raises
    ------
    SettingsError
        An array has a wrong shape or values that are not valid in a MOMDP.

    Examples
    --------
    >>> import numpy as np
    >>> import meal_bayes
    >>> domain = meal_bayes.load_domain("toy")
    >>> query = meal_bayes.Query(domain.attributes[:1])
    >>> rows = np.full((1, len(domain.behaviors), 2, 2), 0.5)
    >>> momdp = meal_bayes.build_momdp(domain, query, rows)
    >>> momdp.n_behaviors == len(domain.behaviors)
    True
    """
    domain = load_domain(domain)
    n = len(query)
    e = len(domain.behaviors)
    answers = [behavior.asks for behavior in domain.behaviors]
    identity = np.tile(np.eye(2), (n, 1, 1))
    classes = identity if latent_classes is None else real_array("latent_classes", latent_classes)
    if classes.ndim != 3 or classes.shape[:2] != (n, 2):
        raise SettingsError(f"latent_classes has shape {classes.shape}; expected ({n},2,C).")
    rows = real_array("confusion", confusion)
    c = classes.shape[-1]
    if rows.ndim != 4 or rows.shape[:3] != (n, e, c):
        expected = f"({n} queried, {e} behaviors, {c} latent classes, levels)"
        raise SettingsError(f"confusion has shape {rows.shape}; expected {expected}.")
    spread = spread_array("precision", precision, n, e, c)
    rows, spread, classes = _with_answers(domain, rows, spread, classes)
    arrays = domain.diagram.compile(domain.behavior_names)
    goal = objective or Objective()
    correct = domain.report_reward if goal.correct is None else goal.correct
    incorrect = wrong_reward(domain.report_reward) if goal.incorrect is None else goal.incorrect
    payoffs = query.payoffs
    if payoffs is None and query.yes_or_no:
        payoffs = goal.payoffs or domain.payoffs
    senses = np.array([behavior.senses for behavior in domain.behaviors])
    chance = spread_array("prior", prior, n)
    for group in map(list, query.groups):
        chance[group] /= chance[group].sum()
    return MOMDP(
        query=query,
        x_names=domain.diagram.states,
        x_labels=domain.diagram.labels,
        behavior_names=domain.behavior_names,
        start=domain.diagram.states.index(domain.diagram.start),
        transition=arrays.transition,
        observation_probability=arrays.observation_probability * senses[:, None, None],
        legal=arrays.legal,
        confusion=rows,
        precision=spread,
        prior=chance,
        latent_classes=classes,
        cost=np.array([behavior.cost for behavior in domain.behaviors]),
        bonus=np.zeros((n, e, 2)),
        bonus_limit=np.full(e, np.inf),
        limit=np.where(answers, np.inf, spread_array("limit", limit, e)),
        correct=correct if payoffs is None else max(payoffs),
        incorrect=incorrect if payoffs is None else min(payoffs),
        payoffs=payoffs,
        discount=goal.discount,
        abstain=goal.abstain and domain.diagram.abstain,
    )


def with_joint_prior(momdp: MOMDP, joint: ArrayLike) -> MOMDP:
    """Return the MOMDP with a joint prior; `prior` becomes the marginals of this prior.

    Parameters
    ----------
    momdp : MOMDP
        Decision problem with any prior.
    joint : ArrayLike
        (Y,) probability of each combination of values, in the order of `Query.values`.

    Raises
    ------
    SettingsError
        `joint` is not a probability distribution over the values of the query.
    """
    table = shaped_array("joint", joint, momdp.query.n_values)
    return replace(momdp, joint=table, prior=(table @ momdp.query.values).clip(0.0, 1.0))


def _with_answers(
    domain: Domain, rows: Floats, spread: Floats, classes: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return confusion rows, their precision, and classes with those of behaviors that answer."""
    n, _, c = classes.shape
    answers = [behavior.asks for behavior in domain.behaviors]
    if any(answers) and (classes > 0).all(axis=1).any():  # split every class by truth: C -> 2C
        classes = (classes[:, :, None] * np.eye(2)[:, :, None]).reshape(n, 2, 2 * c)
        rows = np.tile(rows, (1, 1, 2, 1))
        spread = np.tile(spread, 2)
    # A person's answer is right with one accuracy; what senses nothing says nothing.
    for index, behavior in enumerate(domain.behaviors):
        if behavior.answer_accuracy is not None:
            rows[:, index] = _answer_rows(classes, behavior.answer_accuracy, rows.shape[-1])
            spread[:, index] = np.inf
        elif not behavior.senses:
            rows[:, index] = 1.0 / rows.shape[-1]
    return rows, spread, classes


def _answer_rows(classes: NDArray[np.float64], accuracy: float, levels: int) -> NDArray[np.float64]:
    """Return rows (N,C,K) of answers, which are right in each attribute, whatever the class."""
    true = classes[:, 1] > 0
    rows = np.zeros((*true.shape, levels))
    rows[..., 0] = np.where(true, 1.0 - accuracy, accuracy)
    rows[..., -1] = np.where(true, accuracy, 1.0 - accuracy)
    return rows


def observation_entropy(momdp: MOMDP) -> NDArray[np.float64]:
    """Compute the entropy (N,E,2), bits, of a percept given the attribute's value (Eq. 9).

    If there are more than two levels, their probabilities are summed to those of no and yes. The
    meaning of alpha therefore does not depend on the number of levels. Behaviors without percepts
    have entropy 0.
    """
    yes = yes_of(momdp.rows)
    rows = np.clip(np.stack([1 - yes, yes]), np.finfo(float).tiny, 1.0)
    entropy = -(rows * np.log2(rows)).sum(axis=0)
    senses = momdp.observation_probability.max(axis=(1, 2), keepdims=True)[:, 0] > 0  # (E,1)
    return freeze(np.where(senses, entropy, 0.0))


def add_itrs_bonus(
    momdp: MOMDP,
    experience: ArrayLike,
    alpha: float,
    beta: float,
    *,
    domain: Domain,
) -> MOMDP:
    """Return the MOMDP with the bonus of ITRS, alpha Ent - beta IE for a percept (Eq. 11).

    Only behaviors with modalities get a bonus: `ask` gives no instance from which classifiers could
    learn, and `reinit` gives no percept. Planners add the bonus for percepts within `limit` and
    `bonus_limit`. The reward of a logged trial does not contain the bonus.

    Parameters
    ----------
    momdp : MOMDP
        MOMDP of the query without bonus.
    experience : ArrayLike
        (N,E) experience IE of Eq. 10: labeled instances in units of delta.
    alpha, beta : float
        Reward for one bit of percept entropy, and cost of one unit of experience, s.
    domain : Domain
        Domain from which the MOMDP was built.
    """
    entropy = observation_entropy(momdp)
    ie = shaped_array("experience", experience, *entropy.shape[:2])[..., None]
    # Eq. 11, shared by the N attributes that one execution explores.
    bonus = alpha * entropy - beta * ie / len(momdp.query)
    shaped = np.isin(np.arange(momdp.n_behaviors), domain.recorded)[:, None]
    return replace(momdp, bonus=np.where(shaped, bonus, 0.0))

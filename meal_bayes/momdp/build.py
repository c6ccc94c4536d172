"""Build the MOMDP of a query (Alg. 1, l. 1-4): only queried attributes enter."""

import numpy as np
from numpy.typing import ArrayLike

from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError
from meal_bayes.momdp.model import MOMDP


def build_momdp(
    domain: Domain,
    query: Query,
    confusion: ArrayLike,
    precision: ArrayLike = np.inf,
    *,
    prior: ArrayLike = 0.5,
    correct: float | None = None,
    incorrect: float | None = None,
    limit: ArrayLike = np.inf,
    misperception: ArrayLike = 0.0,
    discount: float = 0.99,
    abstain: bool = False,
) -> MOMDP:
    """Build the MOMDP of a query from a domain and the queried rows of the confusion posterior.

    Parameters
    ----------
    domain : behaviors, costs, diagram.
    query : the N attributes asked.
    confusion : (N,E,2,K) mean confusion matrices; behaviors that answer (ask) are filled in here:
        each attribute right with accuracy^(1/N), so the whole answer with the stated accuracy.
    precision : (N,E,2) or a number; inf is the paper's Eq. 8.
    prior : (N,) or a number; the paper's is uniform.
    correct, incorrect : rewards of a right and a wrong report, the domain's +-r by default.
    limit : (E,) or a number: recordings that can be perceived in one trial.
    misperception : (N,) or a number: Pr(the object seems to have the other value), 0 in the paper.
    discount : factor a step, in planning only.
    abstain : may a planner end the trial by an illegal behavior?
    """
    arrays = domain.transitions()
    n, e = len(query), len(domain.behaviors)
    rows = np.array(confusion, dtype=float)
    if rows.ndim != 4 or rows.shape[:3] != (n, e, 2):  # noqa: PLR2004
        raise SettingsError(
            f"confusion has shape {rows.shape}; expected ({n} queried, {e} behaviors, 2, levels)."
        )
    weight = np.array(np.broadcast_to(precision, (n, e, 2)), dtype=float)
    percepts = np.array(np.broadcast_to(limit, (e,)), dtype=float)
    informative = arrays.informative.copy()
    for index, behavior in enumerate(domain.behaviors):
        if behavior.answer_accuracy is not None:
            right = behavior.answer_accuracy ** (1.0 / n)
            rows[:, index] = 0.0
            rows[:, index, 0, 0] = rows[:, index, 1, -1] = right
            rows[:, index, 0, -1] = rows[:, index, 1, 0] = 1.0 - right
            weight[:, index] = percepts[index] = np.inf
        elif not behavior.senses:
            informative[index] = 0.0
            rows[:, index] = 1.0 / rows.shape[-1]
    reward = domain.report_reward
    return MOMDP(
        query=query,
        x_names=domain.diagram.states,
        behavior_names=domain.behavior_names,
        start=domain.diagram.states.index(domain.diagram.start),
        transition=arrays.transition,
        informative=informative,
        legal=arrays.legal,
        confusion=rows,
        precision=weight,
        prior=np.broadcast_to(prior, (n,)),
        cost=np.array([behavior.cost for behavior in domain.behaviors]),
        correct=reward if correct is None else correct,
        incorrect=-reward if incorrect is None else incorrect,
        bonus=np.zeros((n, e, 2)),
        limit=percepts,
        misperception=np.broadcast_to(misperception, (n,)),
        direct=np.array([behavior.answer_accuracy is not None for behavior in domain.behaviors]),
        discount=discount,
        abstain=abstain,
    )

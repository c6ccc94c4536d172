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
    latent_classes: ArrayLike | None = None,
    discount: float = 0.99,
    abstain: bool = False,
    counts: ArrayLike | None = None,
) -> MOMDP:
    """Build the MOMDP of a query from a domain and the queried rows of the confusion posterior.

    Parameters
    ----------
    domain : behaviors, costs, diagram.
    query : the N attributes asked.
    confusion : (N,E,C,K) mean confusion matrices of the kinds of object, C = 2 (the truth) in the
        paper. Behaviors that answer (ask) are filled in here, for all kinds of a truth alike:
        each attribute right with accuracy^(1/N), so the whole answer with the stated accuracy.
        An answer tells of the truth itself: where a domain has such a behavior, and truths share
        kinds, every kind is split in two, C false ones and then C true ones.
    precision : (N,E,C) or a number; inf is the paper's Eq. 8.
    prior : (N,) or a number; the paper's is uniform.
    correct, incorrect : rewards of a right and a wrong report, the domain's +-r by default.
    limit : (E,) or a number: recordings that can be perceived in one trial.
    latent_classes : (N,2,C) Pr(class | truth), which truths may share; the truth itself by default.
    discount : factor a step, in planning only.
    abstain : may a planner end the trial by an illegal behavior?
    counts : (N,E,2,K) labelled percepts that the rows were learned from, for who looks on.
    """
    arrays = domain.transitions()
    n, e = len(query), len(domain.behaviors)
    rows = np.array(confusion, dtype=float)
    shares = (
        np.tile(np.eye(2), (n, 1, 1))
        if latent_classes is None
        else np.asarray(latent_classes, dtype=float)
    )
    if shares.ndim != 3 or shares.shape[:2] != (n, 2):  # noqa: PLR2004
        raise SettingsError(f"latent_classes has shape {shares.shape}; expected ({n},2,C).")
    c = shares.shape[-1]
    if rows.ndim != 4 or rows.shape[:3] != (n, e, c):  # noqa: PLR2004
        raise SettingsError(
            f"confusion has shape {rows.shape}; expected ({n} queried, {e} behaviors, {c} latent "
            "classes, levels)."
        )
    weight = np.array(np.broadcast_to(precision, (n, e, c)), dtype=float)
    percepts = np.array(np.broadcast_to(limit, (e,)), dtype=float)
    answers = any(behavior.answer_accuracy is not None for behavior in domain.behaviors)
    if answers and (shares > 0).all(axis=1).any():
        nobody = np.zeros((n, c))
        shares = np.stack(
            [np.hstack([shares[:, 0], nobody]), np.hstack([nobody, shares[:, 1]])], axis=1
        )
        rows, weight = np.tile(rows, (1, 1, 2, 1)), np.tile(weight, (1, 1, 2))
    true = shares[:, 1] > 0  # (N,C)
    observation_probability = arrays.observation_probability.copy()
    for index, behavior in enumerate(domain.behaviors):
        if behavior.answer_accuracy is not None:
            right = behavior.answer_accuracy ** (1.0 / n)
            rows[:, index] = 0.0
            rows[:, index, :, 0] = np.where(true, 1.0 - right, right)
            rows[:, index, :, -1] = np.where(true, right, 1.0 - right)
            weight[:, index] = percepts[index] = np.inf
        elif not behavior.senses:
            observation_probability[index] = 0.0
            rows[:, index] = 1.0 / rows.shape[-1]
    reward = domain.report_reward
    return MOMDP(
        query=query,
        x_names=domain.diagram.states,
        behavior_names=domain.behavior_names,
        start=domain.diagram.states.index(domain.diagram.start),
        transition=arrays.transition,
        observation_probability=observation_probability,
        legal=arrays.legal,
        confusion=rows,
        precision=weight,
        prior=np.broadcast_to(prior, (n,)),
        latent_classes=shares,
        cost=np.array([behavior.cost for behavior in domain.behaviors]),
        correct=reward if correct is None else correct,
        incorrect=-reward if incorrect is None else incorrect,
        bonus=np.zeros((n, e, 2)),
        limit=percepts,
        discount=discount,
        abstain=abstain,
        counts=None if counts is None else np.asarray(counts, dtype=float),  # type: ignore[arg-type]
    )

"""A MOMDP as the arrays that the search kernels read, with failures folded into each behavior."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP

_INFORMATIVE = 3e-4  # bits: percepts that tell less of an object's kind are not planned with
_USES = 15  # percepts of one behavior that the table of first counts goes to


class Compiled(NamedTuple):
    """Failures are folded in: to repeat until success is optimal, as failure changes nothing.

    With cost c, discount g and Pr(nothing happens) f: V = -cost + discount * E V(next),
    cost = c / (1 - g f), discount = g (1 - f) / (1 - g f).
    """

    start: int
    legal: NDArray[np.bool_]  # (X,E)
    cost: NDArray[np.float64]  # (X,E) s, folded
    discount: NDArray[np.float64]  # (X,E) folded
    bonus_scale: NDArray[np.float64]  # (X,E) expected discounted executions until success
    branches: NDArray[np.int64]  # (X,E) how many outcomes
    branch_p: NDArray[np.float64]  # (X,E,B) their probabilities given that something happens
    branch_x: NDArray[np.int64]  # (X,E,B) next x
    branch_sense: NDArray[np.bool_]  # (X,E,B) with a percept?
    confusion: NDArray[np.float64]  # (N,E,C,K)
    precision: NDArray[np.float64]  # (N,E,C)
    informative: NDArray[np.bool_]  # (N,E) does a percept tell of the kind of object?
    fresh: NDArray[np.float64]  # (N,E,C,U,U) Pr(j of the first k percepts say yes): [k, j]
    affinity: NDArray[np.float64]  # (N,E,U) log sum_j sqrt(Pr(j | true) Pr(j | false)), k percepts
    bonus: NDArray[np.float64]  # (N,E,2)
    shaped: bool
    limit: NDArray[np.float64]  # (E,)
    paid: NDArray[np.float64]  # (E,) percepts of a trial that shaping pays for
    exact: NDArray[np.bool_]  # (E,) are its rows known, so that percepts seen tell nothing of them?
    plain: bool  # are all rows known, and percepts never used up?
    prior: NDArray[np.float64]  # (N,C) of the kinds, none of them 0
    share: NDArray[np.float64]  # (N,2,C) Pr(truth | kind)
    kinds: NDArray[np.float64]  # (N,2,C) Pr(kind | truth)
    kind_is_truth: bool
    correct: float
    incorrect: float
    additive: bool  # is a report paid by the share of attributes right?
    exit_value: NDArray[np.float64]  # (X,) of the cheapest illegal behavior, -inf where none


def compile_momdp(momdp: MOMDP) -> Compiled:
    """Compile a MOMDP for the kernels."""
    size, n_behaviors = len(momdp.x_names), momdp.n_behaviors
    states, behaviors = np.arange(size), np.arange(n_behaviors)
    idle = (momdp.transition * (1 - momdp.informative))[:, states, states].T  # (X,E)
    idle = np.where(momdp.legal, idle, 0.0)
    moved = momdp.transition.transpose(1, 0, 2).copy()  # (X,E,X)
    sensed = (momdp.transition * momdp.informative).transpose(1, 0, 2)
    moved[states, :, states] -= idle
    silent = np.clip(moved - sensed, 0.0, None)
    folded = np.where(idle < 1, 1 - momdp.discount * idle, 1.0)
    happens = np.where(1 - idle > 0, 1 - idle, 1.0)
    branch_count = np.zeros((size, n_behaviors), dtype=np.int64)
    width = max(1, int(((sensed > 0).sum(2) + (silent > 1e-12).sum(2)).max()))  # noqa: PLR2004
    p = np.zeros((size, n_behaviors, width))
    next_x = np.zeros((size, n_behaviors, width), dtype=np.int64)
    sense = np.zeros((size, n_behaviors, width), dtype=bool)
    legal = momdp.legal & (idle < 1)  # what never does anything is no choice
    for x in states:
        for e in behaviors[legal[x]]:
            for target in states:
                for mass, senses in ((sensed[x, e, target], True), (silent[x, e, target], False)):
                    if mass > 1e-12:  # noqa: PLR2004  rounding
                        k = branch_count[x, e]
                        p[x, e, k], next_x[x, e, k], sense[x, e, k] = mass, target, senses
                        branch_count[x, e] += 1
    ends = (momdp.transition[:, :, -1].T > 0) & ~momdp.legal
    exits = np.where(ends, momdp.cost, np.inf).min(axis=1)
    fresh = _first_counts(momdp)
    chance = np.clip(np.stack([1 - momdp.prior, momdp.prior], axis=1), 1e-9, 1.0)  # (N,2)
    prior = np.clip((chance[:, :, None] * momdp.kinds).sum(axis=1), 1e-21, 1.0)
    counted = np.einsum("nvc,neckl->nevkl", momdp.kinds, fresh)  # (N,E,2,U,U)
    return Compiled(
        start=momdp.start,
        legal=legal,
        cost=momdp.cost / folded,
        discount=momdp.discount * (1 - idle) / folded,
        bonus_scale=1 / folded,
        branches=branch_count,
        branch_p=p / happens[:, :, None],
        branch_x=next_x,
        branch_sense=sense,
        confusion=momdp.confusion.copy(),
        precision=momdp.precision.copy(),
        informative=_information(momdp) > _INFORMATIVE,
        fresh=fresh,
        affinity=np.log(np.sqrt(counted[:, :, 0] * counted[:, :, 1]).sum(axis=-1) + 1e-300),
        bonus=momdp.bonus.copy(),
        shaped=bool(momdp.bonus.any()),
        limit=momdp.limit.copy(),
        paid=momdp.limit.copy(),
        exact=np.asarray(np.isinf(momdp.precision).all(axis=(0, 2))),
        plain=bool(np.isinf(momdp.precision).all() and np.isinf(momdp.limit).all()),
        prior=prior / prior.sum(axis=1, keepdims=True),
        share=np.exp(momdp.log_share),
        kinds=momdp.kinds.copy(),
        kind_is_truth=momdp.kind_is_truth,
        correct=float(momdp.correct),
        incorrect=float(momdp.incorrect),
        additive=momdp.additive,
        exit_value=-exits if momdp.abstain else np.full(size, -np.inf),
    )


def _information(momdp: MOMDP) -> NDArray[np.float64]:
    """Mutual information of a percept and the kind of object at even odds of truth, bits, (N,E).

    A percept that tells of the kind alone may make the next one worth more.
    """
    rows, share = momdp.confusion, momdp.kinds.mean(axis=1)[:, None, :, None]
    mixed = (share * rows).sum(axis=2, keepdims=True)
    ratio = np.log2(np.clip(rows, 1e-300, None) / np.clip(mixed, 1e-300, None))
    return np.asarray((share * rows * ratio).sum(axis=(2, 3)))


def _first_counts(momdp: MOMDP) -> NDArray[np.float64]:
    """Beta-binomial (binomial, at infinite precision) counts of yes among the first percepts."""
    yes = momdp.confusion[..., momdp.levels // 2 :].sum(axis=-1)  # (N,E,C)
    out = np.zeros((*yes.shape, _USES + 1, _USES + 1))
    out[..., 0, 0] = 1.0
    s = np.minimum(momdp.precision, 1e12)  # far beyond any count
    for k in range(_USES):
        for j in range(k + 1):
            p = (s * yes + j) / (s + k)
            out[..., k + 1, j + 1] += out[..., k, j] * p
            out[..., k + 1, j] += out[..., k, j] * (1 - p)
    return out

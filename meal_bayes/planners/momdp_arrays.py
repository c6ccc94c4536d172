"""A MOMDP as arrays for planners, in which failures are marginalized out.

A failed behavior changes nothing, so it is optimal to repeat it until it succeeds. With cost c,
discount factor g and probability f of a failure, the value is V = -cost + discount * E V(next),
where cost = c / (1 - g f) and discount = g (1 - f) / (1 - g f).

A bonus is for percepts, not for executions: without discount, a behavior with success probability
p, cost c and bonus b contributes b - c/p.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats
from meal_bayes.momdp import MOMDP
from meal_bayes.momdp.reports import Conjunction
from meal_bayes.planners.jit import by_reference

# Planners ignore percepts with less information (in bits) about the class. (The certified bound
# uses all percepts whose rows differ: `informative_pairs` of table/grid.py.)
_INFORMATIVE = 3e-4
_ROUNDING = 1e-12
_PRICE = 1e-4  # smallest cost of a behavior in planning, as a fraction of r+ - r-
DIAGRAMS = 16  # number of diagrams whose dynamics and shortest paths are cached

V = TypeVar("V")

STEP = np.dtype([
    ("legal", np.bool_),
    ("cost", np.float64),  # s, summed over failures
    ("discount", np.float64),  # summed over failures
    ("moves", np.bool_),  # to another x, maybe
    ("percepts", np.float64),  # expected, discounted, until something happens: what a bonus pays
], align=True)  # fmt: skip
BRANCH = np.dtype([
    ("p", np.float64),  # given that something happens; 0 beyond the last branch
    ("x", np.int64),  # next x
    ("senses", np.bool_),  # with a percept?
], align=True)  # fmt: skip


@by_reference
class Dynamics(NamedTuple):
    """The transition model of the behaviors."""

    step: NDArray[np.void]  # (X,E) records of `STEP`
    branch: NDArray[np.void]  # (X,E,B) records of `BRANCH`, the outcomes of a step
    exit_value: float  # value of abstaining; -inf if the agent may not abstain


@by_reference
class Percepts(NamedTuple):
    """The observation model of the behaviors."""

    rows: Floats  # (N,E,C,K) mean Pr(level | latent class)
    precision: Floats  # (N,E,C) Dirichlet precision of a row
    class_of_truth: Floats  # (N,2,C) Pr(latent class | truth)
    truth_of_class: Floats  # (N,2,C) Pr(truth | latent class) under the prior
    informative: NDArray[np.bool_]  # (N,E) does a percept carry information on the latent class?
    limit: Floats  # (E,) percepts that a trial can have
    rows_known: NDArray[np.bool_]  # (E,) are all rows of a behavior known exactly?
    class_is_truth: bool  # are the classes the two truths (Eq. 8)?


@by_reference
class MOMDPArrays(NamedTuple):
    """The arrays of a MOMDP that the kernels use."""

    dynamics: Dynamics
    percepts: Percepts
    bonus: Floats  # (N,E,2) exploration bonus of each attribute and truth (Eq. 11)
    bonus_limit: Floats  # (E,) largest number of percepts in a trial that have the bonus
    shaped: bool  # is there any bonus?
    incorrect: float  # r-
    reward_range: float  # r+ - r-
    conjunction: Conjunction | None  # payoffs of yes and no, for yes-or-no questions


def paid_share(limit: Any, seen: Any, planned: Any) -> Any:
    """Return the fraction of planned percepts that get a bonus, up to its limit.

    In a trial, the first `limit` percepts of a behavior get the bonus, and there have been `seen`
    percepts already. Arrays and compiled kernels use this same definition.
    """
    return np.minimum(1.0, np.maximum(limit - seen, 0.0) / np.maximum(planned, 1))


_cache: dict[object, Dynamics] = {}  # at most DIAGRAMS entries; the MOMDPs of a run share one


def arrays_of(momdp: MOMDP, price: float = _PRICE) -> MOMDPArrays:
    """Convert a MOMDP to arrays; behaviors cost at least the fraction `price` of r+ - r-."""
    return MOMDPArrays(
        dynamics=dynamics_of(momdp, price),
        percepts=Percepts(
            rows=momdp.confusion.copy(),
            precision=momdp.precision.copy(),
            class_of_truth=momdp.latent_classes.copy(),
            truth_of_class=np.exp(momdp.log_truth),
            informative=_information(momdp) > _INFORMATIVE,
            limit=momdp.limit.copy(),
            rows_known=np.asarray(np.isinf(momdp.precision).all(axis=(0, 2))),
            class_is_truth=momdp.class_is_truth,
        ),
        bonus=momdp.bonus.copy(),
        bonus_limit=np.minimum(momdp.limit, momdp.bonus_limit),
        shaped=bool(momdp.bonus.any()),
        incorrect=float(momdp.incorrect),
        reward_range=float(momdp.correct - momdp.incorrect),
        conjunction=momdp.reports.conjunction,
    )


def dynamics_of(momdp: MOMDP, price: float = _PRICE) -> Dynamics:
    """Return the dynamics of a MOMDP, cached for all MOMDPs with equal diagram, costs and discount.

    Behaviors cost at least the fraction `price` of r+ - r-. Without discount, behaviors without
    cost could be repeated forever.
    """
    cost = np.maximum(momdp.expected_cost(), price * (momdp.correct - momdp.incorrect))
    arrays = momdp.transition, momdp.observation_probability, momdp.legal, cost
    key = (*(array.tobytes() for array in arrays), momdp.discount, momdp.abstain)
    return memoized(_cache, key, lambda: _dynamics(momdp, cost))


def memoized(cache: dict[object, V], key: object, make: Callable[[], V]) -> V:
    """Return the cached value of a key, or make it; the cache has a limited size."""
    if key not in cache:
        if len(cache) >= DIAGRAMS:
            cache.clear()
        cache[key] = make()
    return cache[key]


def _dynamics(momdp: MOMDP, cost: Floats) -> Dynamics:
    """Marginalize out failures: a behavior is repeated until x changes or there is a percept.

    For each x and behavior, let f be the probability that x stays and there is no percept, c the
    expected cost (X,E) of an execution, and g the discount factor. The number of executions is
    geometric. So the behavior has the cost c / (1 - g f) and the discount factor
    g (1 - f) / (1 - g f), and its outcomes have the probabilities p / (1 - f).
    """
    states = np.arange(len(momdp.x_names))
    failure = momdp.failure_probability  # (X,E)
    happened = momdp.transition.transpose(1, 0, 2).copy()  # (X,E,X) Pr(next x, no failure)
    happened[states, :, states] -= failure
    sensed = (momdp.transition * momdp.observation_probability).transpose(1, 0, 2)  # and a percept
    silent = np.clip(happened - sensed, 0.0, None)  # and none
    step = np.zeros(failure.shape, STEP)
    step["legal"] = momdp.legal & (failure < 1)  # a behavior that always fails cannot be chosen
    remaining = np.where(failure < 1, 1 - momdp.discount * failure, 1.0)  # 1 - g f
    step["cost"] = cost / remaining
    step["discount"] = momdp.discount * (1 - failure) / remaining
    step["percepts"] = sensed.sum(axis=2) / remaining
    # Outcomes (X,E,2X): each next x with a percept, then without.
    mass = np.stack([sensed, silent], axis=3).reshape(*failure.shape, -1)
    possible = mass > _ROUNDING
    branch = np.zeros((*failure.shape, max(1, int(possible.sum(axis=2).max()))), BRANCH)
    x, e, k = np.nonzero(possible & step["legal"][..., None])
    index = x, e, possible.cumsum(axis=2)[x, e, k] - 1
    branch["p"][index] = mass[x, e, k] / np.where(1 - failure > 0, 1 - failure, 1.0)[x, e]
    branch["x"][index] = k // 2
    branch["senses"][index] = k % 2 == 0
    step["moves"] = ((branch["p"] > 0) & (branch["x"] != states[:, None, None])).any(axis=2)
    return Dynamics(step, branch, momdp.exit_value)


def _information(momdp: MOMDP) -> Floats:
    """Compute the mutual information (N,E) in bits of a percept and the class at even odds."""
    rows = momdp.confusion
    p = momdp.latent_classes.mean(axis=1)[:, None, :, None]
    mixed = (p * rows).sum(axis=2, keepdims=True)
    # I(C; Z) = sum over c, z of p(c) p(z | c) log2 p(z | c) / p(z)
    ratio = np.log2(np.clip(rows, 1e-300, None) / np.clip(mixed, 1e-300, None))
    return np.asarray((p * rows * ratio).sum(axis=(2, 3)))

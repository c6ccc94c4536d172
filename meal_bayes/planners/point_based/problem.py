"""A MOMDP as point-based solvers read it: observed x, hidden y, discounted outcomes."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, initial_belief, percept_probabilities
from meal_bayes.planners.compiled import Dynamics, dynamics_of

_MAX_ENTRIES = 20_000_000  # of all outcome matrices, 160 MB

Floats = NDArray[np.float64]


class Choice(NamedTuple):
    """An action at some x, its reward (Y,), and Q outcomes: x (Q,), discount * Pr(Q, y' | y)."""

    action: int
    reward: Floats
    next_x: NDArray[np.int64]
    outcome: Floats


class Plans(NamedTuple):
    """Alpha vectors (V,Y) of one x and their first actions (V,)."""

    vectors: Floats
    actions: NDArray[np.int64]


class Problem(NamedTuple):
    """Choices by x, known plans by x (to end), first x and belief (Y,)."""

    choices: tuple[tuple[Choice, ...], ...]
    known: tuple[Plans, ...]
    start_x: int
    start: Floats


def problem_of(momdp: MOMDP) -> Problem:
    """Build the problem of a MOMDP, failures summed out; nothing comes after `term`, so it is no x.

    Raises
    ------
    SettingsError : finite precision, several latent classes a truth, or too many attributes.
    """
    if not np.isinf(momdp.precision).all() or not momdp.class_is_truth:
        raise SettingsError(
            "Alpha vectors cannot hold rows of finite precision, or several latent classes a "
            "truth; build the MOMDP with precision=inf and without "
            "`latent_classes` (Eq. 8), or use POMCP."
        )
    n_y, n_z = 2 ** len(momdp.query), momdp.levels ** len(momdp.query)
    size = int(momdp.legal.sum()) * n_z * n_y**2
    if size > _MAX_ENTRIES:
        raise SettingsError(
            f"{len(momdp.query)} attributes make {size:.1g} entries of outcome matrices; "
            f"point-based solving ends at {_MAX_ENTRIES:.0e}. Ask fewer attributes, or use POMCP."
        )
    dynamics = dynamics_of(momdp)
    truth = momdp.query.values.astype(int)  # (Y,N)
    bonus = momdp.bonus[np.arange(truth.shape[1]), :, truth].sum(axis=1)  # (Y,E)
    choices = tuple(
        tuple(_choice(momdp, dynamics, x, e, bonus[:, e]) for e in np.flatnonzero(legal).tolist())
        for x, legal in enumerate(dynamics.step["legal"][: momdp.terminal])
    )
    known = tuple(_endings(momdp, dynamics, x) for x in range(momdp.terminal))
    return Problem(choices, known, momdp.start, initial_belief(momdp).joint)


def _choice(momdp: MOMDP, dynamics: Dynamics, x: int, e: int, bonus: Floats) -> Choice:
    n_y = len(bonus)
    step, weights, next_x = dynamics.step[x, e], [], []
    for p, to, senses in dynamics.outcomes(x, e):
        shown = percept_probabilities(momdp, e).T if senses else np.ones((1, n_y))
        weights.append(step["discount"] * p * shown)  # (outcomes,Y)
        next_x += [to] * len(shown)
    outcome = np.concatenate(weights)[:, :, None] * np.eye(n_y)
    reward = step["bonus_scale"] * bonus - step["cost"]
    return Choice(e, reward, np.array(next_x), outcome)


def _endings(momdp: MOMDP, dynamics: Dynamics, x: int) -> Plans:
    """List reports, and the way out where the MOMDP lets a planner abstain."""
    truth = momdp.query.values
    vectors = momdp.report_reward((truth[:, None] == truth).astype(float))  # (reports,Y)
    actions = momdp.n_behaviors + np.arange(len(truth))
    if dynamics.exit_value[x] > -np.inf:
        way_out = np.where(momdp.legal[x], np.inf, momdp.cost).argmin()
        vectors = np.concatenate([vectors, np.full((1, len(truth)), dynamics.exit_value[x])])
        actions = np.append(actions, way_out)
    return Plans(vectors, actions)

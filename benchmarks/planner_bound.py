"""A certified upper bound for queries of any size, from parts of the query that a grid can hold.

A policy for the query also answers a subset S of it, by leaving the rest of its report out and
drawing the percepts of the others from the model, at the same cost and at least as often right. So
V <= V_S, and the least V_S over subsets bounds V.
"""

from dataclasses import replace

import numpy as np

from meal_bayes.domain import Query
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.table.grid import informative_pairs
from meal_bayes.planners.table.policy import Factored

_CANDIDATES = 3  # attributes tried as the next of a subset


def upper_bound(
    momdp: MOMDP, *, size: int = 3, points: int = 50_000, tolerance: float = 2e-4
) -> float:
    """Bound the value that any policy has from the start.

    Subsets grow from the attribute with the least bound, to which the one that lowers the bound
    most is added. Attributes that no percept moves need no axis of the grid, so they are in every
    subset.

    *Finite precision*, equal for both truths: percepts of one behavior are then draws from the mean
    row, some replaced by copies of earlier ones, where which are copies does not depend on the
    truth (the urn of Blackwell and MacQueen). Independent draws inform at least as much, so the
    bound is that of infinite precision.

    Parameters
    ----------
    momdp : of any number of attributes.
    size : attributes that percepts move, in a subset, at most.
    points : of a grid, at most.
    tolerance : as that of `Factored`.

    Raises
    ------
    SettingsError : precision that differs between the truths, several latent classes a truth,
        more attributes than the grid can hold, or rewards without a bound.
    """
    if size < 1:
        raise SettingsError(f"size is {size}; a subset has one attribute or more.")
    solver = Factored(points, tolerance)
    momdp = _most_favorable(momdp)
    moved = informative_pairs(momdp).any(axis=1)
    still = np.flatnonzero(~moved).tolist()
    moving = np.flatnonzero(moved).tolist()
    if not moving:
        return _value(momdp, solver)
    single = {i: _value(restrict(momdp, [*still, i]), solver) for i in moving}
    first, *rest = sorted(moving, key=lambda i: single[i])
    subset = [*still, first]
    best = single[first]
    for _ in range(min(size, len(moving)) - 1):
        larger = {i: _value(restrict(momdp, [*subset, i]), solver) for i in rest[:_CANDIDATES]}
        chosen = min(larger, key=lambda i: larger[i])
        subset = [*subset, chosen]
        best = min(best, larger[chosen])
        rest.remove(chosen)
    return best


def _value(momdp: MOMDP, solver: Factored) -> float:
    return solver.solve(momdp, np.random.default_rng(0)).upper_bound


def restrict(momdp: MOMDP, attributes: list[int]) -> MOMDP:
    """Ask for some attributes only; shaping pays for the others what it could pay at most."""
    some = np.sort(attributes)
    bonus = momdp.bonus[some]
    others = np.delete(momdp.bonus, some, axis=0)
    bonus[0] += others.max(axis=2).sum(axis=0)[:, None]
    return replace(
        momdp,
        query=Query(tuple(momdp.query.attributes[i] for i in some)),
        confusion=momdp.confusion[some],
        precision=momdp.precision[some],
        prior=momdp.prior[some],
        latent_classes=momdp.latent_classes[some],
        bonus=bonus,
    )


def _most_favorable(momdp: MOMDP) -> MOMDP:
    """Let percepts be independent and, where they run out, shaping take no pay away."""
    if (momdp.precision != momdp.precision[..., :1]).any():
        raise SettingsError(
            "No bound is known for rows whose precision differs between the truths; bound the "
            "MOMDP of Eq. 8 (precision=inf) instead, which is another problem."
        )
    lasting = np.isinf(np.minimum(momdp.limit, momdp.bonus_limit))[:, None]
    return replace(
        momdp,
        precision=np.full_like(momdp.precision, np.inf),
        bonus=np.where(lasting, momdp.bonus, momdp.bonus.clip(0.0)),
        bonus_limit=np.full_like(momdp.bonus_limit, np.inf),
    )

"""How the object in front is put down: the cheapest paths to where it can be left."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, shaped_array
from meal_bayes.momdp import MOMDP


class PathsBack(NamedTuple):
    """The cheapest paths to the states in which an object can be left, from each x."""

    cost: Floats  # (X,) s, expected, failures repeated; inf where none leads there
    discount: Floats  # (X,) on what follows
    first_action: NDArray[np.int64]  # (X,) -1 where the object can be left, or none leads there


def paths_back(momdp: MOMDP, leave: NDArray[np.bool_], discount: float = 1.0) -> PathsBack:
    """Find the cheapest paths back to where an object can be left.

    Parameters
    ----------
    momdp : MOMDP
        The problem.
    leave : NDArray[np.bool_]
        (X,) whether an object can be left in x.
    discount : float
        Factor a step.
    """
    leave = shaped_array("leave", leave, len(momdp.x_names)) != 0
    cost = np.where(leave, 0.0, np.inf)
    factor = np.ones(len(leave))
    first = np.full(len(leave), -1)
    stays = np.einsum("exx->ex", momdp.transition)  # (E,X)
    reached = momdp.transition > 0

    def onward(value: Floats) -> Floats:
        return np.asarray(momdp.transition @ value - stays * value)

    for _ in range(len(leave)):
        # c(x) = min over e of (cost_e + g sum over x' != x of Pr(x') c(x')) / (1 - g Pr(x))
        leads_back = np.isfinite(cost)
        lost = (reached & ~leads_back).sum(axis=2) - ((stays > 0) & ~leads_back)
        moves = momdp.legal.T & (stays < 1.0) & (lost == 0)
        remaining = 1.0 - discount * np.where(moves, stays, 0.0)
        price = momdp.expected_cost().T + discount * onward(np.where(leads_back, cost, 0.0))
        price = np.where(moves, price / remaining, np.inf)
        best = price.argmin(axis=0)
        better = price.min(axis=0) < cost
        after = (discount * onward(factor) / remaining)[best, np.arange(len(leave))]
        factor = np.where(better, after, factor)
        first = np.where(better, best, first)
        cost = np.where(better, price.min(axis=0), cost)
    return PathsBack(cost, factor, first)

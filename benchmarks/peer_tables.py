"""A MOMDP as what other libraries' planners draw from: numbers, laid out before they search."""

from bisect import bisect
from itertools import accumulate
from random import random

import numpy as np

from meal_bayes.momdp import MOMDP
from meal_bayes.momdp.flat_pomdp import file_tables, percept_probabilities


class PeerTables:
    """What an action at (x, y) leads to: x', a percept or none, and a reward.

    Percepts are numbered by their levels, the first attribute leading, and `none` is the last.

    Parameters
    ----------
    momdp : MOMDP
        Of known rates (Eq. 8), and of percepts whose coming depends on behavior and x' only;
        `file_tables` refuses any other.
    """

    def __init__(self, momdp: MOMDP) -> None:
        tables = file_tables(momdp)
        self.n_e = momdp.n_behaviors
        self.n_y = momdp.query.n_values
        self.end = momdp.terminal
        self.percepts = [percept_probabilities(momdp, e) for e in range(self.n_e)]  # E times (Y,Z)
        self.none = self.percepts[0].shape[1]
        self.reward: list[list[list[float]]] = tables.reward.tolist()  # by x, y, action
        self.comes: list[list[float]] = tables.comes.tolist()  # by behavior, x'
        self.moves = [
            [list(accumulate(row)) for row in rows] for rows in tables.transition.tolist()
        ]
        self.limits = [[list(accumulate(row)) for row in rows.tolist()] for rows in self.percepts]
        answers = range(self.n_e, momdp.n_actions)
        legal = [np.flatnonzero(row).tolist() for row in momdp.legal[: self.end]]
        self.allowed: list[list[int]] = [[*behaviors, *answers] for behaviors in legal]
        self.allowed.append([0])  # nothing is left to do

    def next_x(self, x: int, action: int) -> int:
        """Draw x'."""
        if action >= self.n_e or x == self.end:
            return self.end
        return min(bisect(self.moves[action][x], random()), self.end)

    def percept(self, next_x: int, y: int, action: int) -> int:
        """Draw a percept, or none."""
        comes = self.comes[action][next_x] if action < self.n_e else 0.0
        if not comes or random() >= comes:
            return self.none
        return min(bisect(self.limits[action][y], random()), self.none - 1)

"""A MOMDP as what planners of other libraries draw from: numbers, laid out before they search."""

from bisect import bisect
from itertools import accumulate
from random import random

import numpy as np

from meal_bayes.errors import SettingsError
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


class Steps:
    """Steps of a MOMDP of any size, drawn attribute by attribute: to x', a percept, a reward.

    Percepts are numbered as those of `PeerTables`; attributes of which a behavior tells nothing are
    left at level 0, so that fewer percepts are told apart.

    Parameters
    ----------
    momdp : MOMDP
        Of known rates (Eq. 8), asked for values, with percepts of yes or no and no bonus.
    """

    def __init__(self, momdp: MOMDP) -> None:
        known = np.isinf(momdp.precision).all() and momdp.class_is_truth
        if not known or momdp.query.event or momdp.levels > 2 or momdp.bonus.any():
            raise SettingsError(
                "Steps are drawn of values, of known rates of yes and no, without a bonus; not of "
                "finite precision."
            )
        n = len(momdp.query)
        self.n_e = momdp.n_behaviors
        self.n_y = momdp.query.n_values
        self.end = momdp.terminal
        self.none = self.n_y  # after one number for each yes and no of the attributes
        self.ends = (momdp.incorrect, momdp.correct, 0.0)  # rewards: wrong, right, abstained
        self.cost = momdp.expected_cost()[: self.end].tolist()
        self.moves = [[list(accumulate(row)) for row in rows] for rows in momdp.transition.tolist()]
        self.comes = momdp.observation_probability.tolist()  # by behavior, x, x'
        yes = momdp.confusion[..., 1]  # (N,E,2)
        informs = yes[..., 0] != yes[..., 1]  # (N,E)
        self.rates = [  # of each behavior: the bit of an attribute, and Pr(yes | false or true)
            [(n - 1 - i, yes[i, e].tolist()) for i in np.flatnonzero(informs[:, e]).tolist()]
            for e in range(self.n_e)
        ]
        answers = range(self.n_e, momdp.n_actions)
        legal = [np.flatnonzero(row).tolist() for row in momdp.legal[: self.end]]
        self.allowed: list[list[int]] = [[*behaviors, *answers] for behaviors in legal]
        self.allowed.append([0])  # nothing is left to do

    def step(self, x: int, y: int, action: int) -> tuple[int, int, float]:
        """Draw x', a percept or none, and return them with the reward."""
        if x == self.end:
            return x, self.none, 0.0
        if action >= self.n_e:
            report = action - self.n_e
            return self.end, self.none, self.ends[2 if report == self.n_y else report == y]
        next_x = min(bisect(self.moves[action][x], random()), self.end)
        percept = self.none
        if random() < self.comes[action][x][next_x]:
            percept = 0
            for bit, rates in self.rates[action]:
                percept |= (random() < rates[y >> bit & 1]) << bit
        return next_x, percept, -self.cost[x][action]

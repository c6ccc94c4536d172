"""One of several objects: each one's question of yes or no, with an outside value in place of no.

Objects are independent given what was learned, and one is explored at a time. So to an object the
others are no more than a value L for which it can be left at any time, and its problem is the
question in which "no" pays L whatever is true. Let V(L) be what that problem is worth. Then
[Weitzman1979, Whittle1980]

- an object's *index* is the largest L at which to explore or to claim it is worth more than L. The
  object of the largest index comes next; where none has an index above what "none of them" earns,
  that is the answer;
- V'(L) is the discounted probability that the object is left for L in the end. All are left for L
  with probability prod_k V_k'(L), so the others are a random outside value, and an action of this
  object is worth, beside them,

      E Q(L) = Q(r+) - integral over L of prod_{others k} V_k'(L) Q'(L).

  No joint table is needed: work grows with the number of objects, not exponentially.

With one behavior an object this is exact. With several, which one is best may depend on L (a bandit
superprocess, [Brown2013]); then the integral is an estimate, near the joint optimum in the tests.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, FrozenArrays
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, expected_reward
from meal_bayes.momdp.model import ARRAYS
from meal_bayes.planners.solver import History, Policy, Remembering

POINTS = 17  # outside values, from what "none" earns to r+
_SETTLED = 1e-9  # of r+ - r-: an object is worth nothing more than L where it gains less

Solve = Callable[[MOMDP], Policy]


@dataclass(frozen=True, slots=True)
class Prospect(FrozenArrays):
    """What an object is worth at its belief, beside each outside value.

    Attributes
    ----------
    outside : NDArray[np.float64]
        (L,) the outside values, ascending, s of reward.
    explored : NDArray[np.float64]
        (L,E) value of each behavior where the object can be left for so much; -inf where it is not
        legal, or not valued.
    claim_value : float
        Expected reward of claiming the object.
    turning : float
        Cost of turning to the object, s, before it can be explored; not to claim it.
    """

    outside: Floats
    explored: Floats
    claim_value: float
    turning: float = 0.0

    @property
    def value(self) -> Floats:
        """V(L), (L,): the best of exploring, claiming, and leaving."""
        best = self.explored.max(axis=1) - self.turning
        return np.asarray(np.maximum(np.maximum(best, self.claim_value), self.outside))

    @property
    def leaving(self) -> Floats:
        """Probability (L-1,) that the object is left, between each two outside values.

        Searches err a little: V is convex, with slopes in [0, 1].
        """
        slopes = np.diff(self.value) / np.diff(self.outside)
        return np.maximum.accumulate(slopes.clip(0.0, 1.0))

    @property
    def index(self) -> float:
        """The largest outside value at which the object is worth more; -inf where at none."""
        gain = self.value - self.outside
        worth = np.flatnonzero(gain > _SETTLED * (self.outside[-1] - self.outside[0]))
        if not len(worth):
            return -np.inf
        last = int(worth[-1])
        if last + 1 == len(gain):
            return float(self.outside[-1])
        fraction = gain[last] / (gain[last] - gain[last + 1])
        return float(self.outside[last] + fraction * (self.outside[last + 1] - self.outside[last]))


def beside(prospect: Prospect, values: Floats, others: Sequence[Prospect]) -> Floats:
    """Compute what values (L,...) of an object come to beside other objects: E of them over L."""
    left = np.ones(len(prospect.outside) - 1)
    for other in others:
        left = left * other.leaving
    return np.asarray(values[-1] - np.tensordot(left, np.diff(values, axis=0), axes=1))


class Move(NamedTuple):
    """What to do next with several objects.

    Attributes
    ----------
    place : int
        Of the object; -1: none of them is claimed.
    behavior : int
        To execute on it; -1: it is claimed.
    values : NDArray[np.float64]
        (E,) what its behaviors are worth beside the other objects; -inf where not valued.
    """

    place: int
    behavior: int
    values: Floats


def values_beside(prospects: Sequence[Prospect], place: int) -> Floats:
    """Value the behaviors (E,) of one object beside the others; -inf where not valued."""
    explored = prospects[place].explored
    valued = np.isfinite(explored).all(axis=0)
    others = [prospect for other, prospect in enumerate(prospects) if other != place]
    values = beside(prospects[place], np.where(valued, explored, 0.0), others)
    return np.where(valued, values, -np.inf) - prospects[place].turning


def best_move(prospects: Sequence[Prospect], front: int = -1) -> Move:
    """Choose the object of the largest index, and to explore it, to claim it, or none.

    Parameters
    ----------
    prospects : Sequence[Prospect]
        Of each object.
    front : int
        The object in front of the robot, which is chosen among equals.
    """
    indices = [prospect.index for prospect in prospects]
    place = int(np.argmax(indices))
    if front >= 0 and indices[front] == indices[place]:
        place = front
    values = values_beside(prospects, place)
    if indices[place] == -np.inf:
        return Move(-1, -1, values)
    behavior = int(values.argmax())
    return Move(place, behavior if values[behavior] > prospects[place].claim_value else -1, values)


class Prospector:
    """Values one object's question of yes or no at outside values, by any planner.

    Problems are solved when they are first needed, one for each outside value.

    Parameters
    ----------
    momdp : MOMDP
        Of yes or no; "no" pays what "none of them" earns.
    solve : Solve
        The planner.
    """

    def __init__(self, momdp: MOMDP, solve: Solve) -> None:
        none = momdp.reports.payoffs.right_no
        best = momdp.reports.payoffs.right_yes
        self.momdp = momdp
        self.outside = np.linspace(none, best, POINTS)
        self._solve = solve
        self._policies: list[Policy] = []

    def prospect(self, history: History, rng: np.random.Generator) -> Prospect:
        """Return what the object is worth after a history; see `Prospect`.

        Raises
        ------
        SettingsError
            The planner compares no values.
        """
        if not self._policies:
            self._policies = [self._policy(float(value)) for value in self.outside]
        explored = np.full((POINTS, self.momdp.n_behaviors), -np.inf)
        for row, policy in zip(explored, self._policies, strict=True):
            decision = policy.decide(history, rng)
            values = decision.values[:-1]
            if decision.action < len(values) and np.isnan(values[decision.action]):
                raise SettingsError(
                    "This agent compares no values, by which objects could be told apart; find by "
                    "one that does, such as bayes, morc, olfc or greedy."
                )
            row[:] = np.where(np.isnan(values), -np.inf, values)
        return Prospect(self.outside, explored, claim_value(self.momdp, history.belief))

    def _policy(self, outside: float) -> Policy:
        """Return the policy of the problem in which "no" pays so much."""
        payoffs = self.momdp.reports.payoffs._replace(right_no=outside, wrong_no=outside)
        problem = replace(
            self.momdp, payoffs=payoffs, correct=max(payoffs), incorrect=min(payoffs), abstain=False
        )
        return self._solve(problem)


class SharedPlans:
    """Solves problems: equal ones once, and those that differ in payoffs alone by the same plans.

    Decisions are remembered by belief, so that objects of one problem share them, too.

    Parameters
    ----------
    solve : Solve
        The planner.
    """

    def __init__(self, solve: Solve) -> None:
        self._solve = solve
        self._solved: dict[tuple[bytes, ...], dict[object, Remembering]] = {}

    def __call__(self, momdp: MOMDP) -> Policy:
        """Return the policy of a problem."""
        arrays = (np.ascontiguousarray(getattr(momdp, name)) for name in ARRAYS)
        key = tuple(array.tobytes() for array in arrays)
        policies = self._solved.setdefault(key, {})
        if momdp.payoffs not in policies:
            planner = self._solve
            if policies:  # plans that are grown for one payoff are as good for the others
                first = next(iter(policies.values()))
                planner = getattr(first.policy, "sharing_plans", planner)
            policies[momdp.payoffs] = Remembering(planner(momdp))
        return policies[momdp.payoffs]


def claim_value(momdp: MOMDP, belief: Belief) -> float:
    """Compute the expected reward of claiming that the answer is yes."""
    yes = momdp.query.report_of(1)
    return expected_reward(momdp, belief, yes)


def ways_back(momdp: MOMDP, leave: NDArray[np.bool_]) -> tuple[Floats, NDArray[np.int64]]:
    """Compute the cheapest ways to the states in which an object can be left.

    Parameters
    ----------
    momdp : MOMDP
        The problem.
    leave : NDArray[np.bool_]
        (X,) whether an object can be left in x.

    Returns
    -------
    tuple
        Expected seconds (X,), failures repeated, and the first behavior of the way (X,); inf and -1
        where there is none.
    """
    cost = np.where(leave, 0.0, np.inf)
    first = np.full(len(leave), -1)
    stays = np.einsum("exx->ex", momdp.transition)  # (E,X)
    for _ in range(len(leave)):
        # c(x) = min over e of (cost_e + sum over x' != x of Pr(x') c(x')) / (1 - Pr(x))
        reached = momdp.transition > 0
        onward = np.where(reached, momdp.transition, 0.0) @ np.where(np.isinf(cost), 0.0, cost)
        onward -= stays * np.where(np.isinf(cost), 0.0, cost)
        lost = (reached & np.isinf(cost)).sum(axis=2) - ((stays > 0) & np.isinf(cost))
        moves = momdp.legal.T & (stays < 1.0) & (lost == 0)
        way = np.full(stays.shape, np.inf)
        np.divide(momdp.cost[:, None] + onward, 1.0 - stays, out=way, where=moves)
        better = way.min(axis=0) < cost
        first = np.where(better, way.argmin(axis=0), first)
        cost = np.where(better, way.min(axis=0), cost)
    return cost, first

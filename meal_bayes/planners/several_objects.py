"""One of several objects: each one's question of yes or no, with an outside value in place of no.

Objects are independent given what was learned, and one is explored at a time. So to an object the
others are no more than a value L for which it can be left, and its problem is the question in which
"no" pays L whatever is true, less what it takes to put the object down. Let V(L) be what that
problem is worth, and Q(L) one of its behaviors. An object's *index* is the largest L at which to
explore or to claim it is worth more than L [Weitzman1979, Whittle1980].

To explore the objects one after another, each until it is claimed or left for good, is worth

    W = V_1(V_2(... V_n(none))),

with falling indices: left at any time, for what is left. The search does better, as it chooses
anew after every step: the behavior of the object that is worth most where the others are worth W
after it, Q_k(W of all but k). What it chooses is worth W at least, and this only grows from step to
step (policy improvement [Howard1960]). So a search earns what asking in turn does, or more; and it
does not go to and fro between objects, as what it costs to take one up and to put it down is part
of V. To compare indices alone is optimal with one behavior an object and free hands; with several
the best one depends on L [Brown2013], and with full hands no index is optimal [Asawa1996].
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from meal_bayes.arrays import Floats, FrozenArrays
from meal_bayes.errors import SettingsError

POINTS = 17  # outside values
_SETTLED = 1e-9  # of r+ - r-: an object is worth nothing more than L where it gains less


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


class Hand(NamedTuple):
    """What it takes to leave the object in front.

    Attributes
    ----------
    cost : float
        Of putting it down, s; inf where no path leads there.
    behavior : int
        By which that begins; -1 where the hand is empty.
    discount : float
        On what follows.
    """

    cost: float
    behavior: int
    discount: float = 1.0


EMPTY = Hand(0.0, -1)


class Move(NamedTuple):
    """What to do next with several objects.

    Attributes
    ----------
    object : int
        Its number, from 0; -1: none of them is claimed.
    behavior : int
        To execute on it; -1: it is claimed.
    values : NDArray[np.float64]
        (E,) what its behaviors are worth beside the other objects; -inf where not valued.
    """

    object: int
    behavior: int
    values: Floats


def outside_values(none: float, best: float) -> Floats:
    """Return the outside values (L,), from what "none of them" earns to r+.

    They lie closer near "none": seconds count most there, and V bends where putting down is paid.
    """
    return none + (best - none) * np.linspace(0.0, 1.0, POINTS) ** 2


def between(outside: Floats, values: Floats, at: Floats | float) -> Floats:
    """Bound values (L,...), known at outside values (L,), from below at others, `at`.

    They are convex, with slopes in [0, 1]: beyond two points the line through them lies below. To
    go up to the chord would promise what no behavior earns, and a search would go round for it.
    """
    gap = np.diff(outside).reshape(-1, *(1 for _ in values.shape[1:]))
    slope = (np.diff(values, axis=0) / gap).clip(0.0, 1.0)
    slope = np.concatenate([np.zeros_like(slope[:1]), slope, np.ones_like(slope[:1])])
    low = np.clip(np.searchsorted(outside, at, side="right") - 1, 0, len(outside) - 2)
    above = at - outside[low]
    below = outside[low + 1] - at
    chord = (values[low] * below + values[low + 1] * above) / (above + below)
    line = np.maximum(values[low] + above * slope[low], values[low + 1] - below * slope[low + 2])
    return np.asarray(np.minimum(line, chord))


def worth_of_others(prospects: Sequence[Prospect], none: float) -> Floats:
    """Compute what all objects but each are worth, (n,): W of them, and `none` without any."""
    worth = np.full(len(prospects), none)
    for number in np.argsort([prospect.index for prospect in prospects]):
        others = np.arange(len(prospects)) != number
        prospect = prospects[number]
        worth[others] = between(prospect.outside, prospect.value, worth[others])
    return worth


def values_beside(prospect: Prospect, others: float) -> Floats:
    """Value the behaviors (E,) of an object beside the others' worth; -inf where not valued."""
    valued = np.asarray(np.isfinite(prospect.explored).all(axis=0))
    values = np.full(len(valued), -np.inf)
    values[valued] = between(prospect.outside, prospect.explored[:, valued], others)
    return values - prospect.turning


def best_move(prospects: Sequence[Prospect], front: int = -1, hand: Hand = EMPTY) -> Move:
    """Choose to explore an object, to put one down, to claim one, or none.

    Parameters
    ----------
    prospects : Sequence[Prospect]
        Of each object.
    front : int
        The object in front of the robot, which is chosen among equals; -1 where there is none.
    hand : Hand
        What it takes to leave that one.
    """
    if not len(prospects):
        raise SettingsError("There are no prospects; give one of each object.")
    hand_is_full = hand.behavior >= 0 or np.isinf(hand.cost)
    if hand_is_full and front < 0:
        raise SettingsError(f"{hand} holds an object, but none is in front; give its number.")
    if hand_is_full:
        return _go_on_or_put_down(prospects, front, hand)
    return _turn_or_answer(prospects, front)


class _Answer(NamedTuple):
    """The best answer: the object that is claimed, -1 for none of them, and what that earns."""

    object: int
    value: float
    margin: float  # by which a behavior must be worth more


def _best_answer(prospects: Sequence[Prospect]) -> _Answer:
    outside = prospects[0].outside
    none = float(outside[0])
    claims = np.array([prospect.claim_value for prospect in prospects])
    return _Answer(
        object=int(claims.argmax()) if claims.max() > none else -1,
        value=max(none, float(claims.max())),
        margin=_SETTLED * float(outside[-1] - none),
    )


def _go_on_or_put_down(prospects: Sequence[Prospect], front: int, hand: Hand) -> Move:
    """Choose with an object in hand: explore it on, put it down, or answer."""
    none = float(prospects[0].outside[0])
    answer = _best_answer(prospects)
    others = float(worth_of_others(prospects, none)[front])
    values = values_beside(prospects[front], others)
    # Left for the others it may still be claimed: they are worth more where its claim is.
    best_claim_with_front = max(none, prospects[front].claim_value)
    others_or_claim = worth_of_others(prospects, best_claim_with_front)[front]
    leaving = hand.discount * others_or_claim - hand.cost
    best = int(values.argmax())
    if max(values[best], leaving) <= answer.value + answer.margin:
        return Move(answer.object, -1, values)
    # Both begin with a behavior of the object in front.
    return Move(front, best if values[best] > leaving else hand.behavior, values)


def _turn_or_answer(prospects: Sequence[Prospect], front: int) -> Move:
    """Choose with an empty hand: explore any object, or answer."""
    none = float(prospects[0].outside[0])
    answer = _best_answer(prospects)
    others = worth_of_others(prospects, none)
    values = [values_beside(prospects[k], float(others[k])) for k in range(len(prospects))]
    move = Move(answer.object, -1, values[max(answer.object, 0)])
    best_value = answer.value
    # The object in front comes first, and keeps its place among equals.
    for k in sorted(range(len(prospects)), key=lambda k: k != front):
        best = int(values[k].argmax())
        # It must be worth more than to be left for the others, too.
        if values[k][best] > max(best_value, others[k]) + answer.margin:
            move = Move(k, best, values[k])
            best_value = float(values[k][best])
    return move

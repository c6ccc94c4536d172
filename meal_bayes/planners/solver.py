"""The seams of planning: a `Solver` (the paper's Sol) makes a `Policy`, which makes `Decision`s."""

import hashlib
from dataclasses import dataclass, field
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, FrozenArrays
from meal_bayes.momdp import MOMDP, Belief, answer_value, best_answer
from meal_bayes.seeds import stream


class TreeEdge(NamedTuple):
    """One edge of the first two levels of a search tree.

    Attributes
    ----------
    level : int
        1 or 2.
    parent : int
        Position of the parent edge in the list, -1 for the root.
    action : int
        Behavior index, E for the best answer.
    observation : tuple[int, ...]
        Percept levels on the way to the parent's node, () for none.
    visits : int
        Simulations through the edge.
    value : float
        Estimate of the edge's value.
    """

    level: int
    parent: int
    action: int
    observation: tuple[int, ...]
    visits: int
    value: float


@dataclass(frozen=True, slots=True)
class Decision(FrozenArrays):
    """A chosen action with its evidence.

    Attributes
    ----------
    action : int
        Below E a behavior; E + y the report of value vector y of Y; E + Y abstains.
    values : NDArray[np.float64]
        (E+1,) by behavior, then of the best answer; nan = not valued.
    value_se : NDArray[np.float64]
        (E+1,) standard errors, 0 where exact, nan = unknown.
    visits : NDArray[np.int64]
        (E+1,) simulations by first action.
    tree : tuple[TreeEdge, ...]
        First two levels of the search tree.
    simulations : int
        Of the search.
    sampled_rows : NDArray[np.float64] | None
        (M,N,K) rows of the chosen behavior in M sampled MOMDPs.
    gap : float | None
        s of reward that the best action may be worth more than following this decision, at most;
        None where no upper bound is known.
    """

    action: int
    values: NDArray[np.float64]
    value_se: NDArray[np.float64]
    visits: NDArray[np.int64]
    tree: tuple[TreeEdge, ...] = ()
    simulations: int = 0
    sampled_rows: NDArray[np.float64] | None = None
    gap: float | None = None

    @classmethod
    def exact(cls, action: int, values: NDArray[np.float64]) -> "Decision":
        """Return a decision whose values (E+1,), nan where not valued, have no standard errors."""
        return cls(action, values, no_errors(values), np.zeros(len(values), dtype=np.int64))


def no_errors(values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the standard errors of exact values: 0, and nan where one is not valued."""
    return np.where(np.isnan(values), np.nan, 0.0)


@dataclass(frozen=True, slots=True)
class History:
    """What a policy may depend on: the steps so far.

    Attributes
    ----------
    belief : Belief
        After them.
    actions : tuple[int, ...]
        Executed behaviors.
    perceived : tuple[bool, ...]
        Whether a percept came, by action.
    moved : tuple[int, ...]
        The x after each action.
    cost : float
        s.
    """

    belief: Belief
    actions: tuple[int, ...] = ()
    perceived: tuple[bool, ...] = ()
    moved: tuple[int, ...] = ()
    cost: float = 0.0

    def after(self, belief: Belief, action: int, perceived: bool, cost: float) -> "History":
        """Return the history one step on, of a behavior that cost so much and led to a belief."""
        actions = (*self.actions, action)
        came = (*self.perceived, perceived)
        return History(belief, actions, came, (*self.moved, belief.x), self.cost + cost)


class Policy(Protocol):
    """A plan of action for one MOMDP; online search happens in `decide`.

    A policy may have an attribute `deterministic`: true where a decision depends on the belief
    alone (and on the generator), so that it may be remembered; a policy without one is asked again.
    """

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action."""
        ...


class Solver(Protocol):
    """The paper's Sol."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Policy:
        """Return a policy for a MOMDP."""
        ...


@dataclass(slots=True)
class Remembering:
    """A deterministic policy whose decisions are kept by what they depend on: x and percept counts.

    Searches draw from a stream of that place, so that it does not matter which trial comes first.
    """

    policy: Policy
    _made: dict[tuple[int, bytes], Decision] = field(default_factory=dict)

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action, as the last time in the same place."""
        belief = history.belief
        key = belief.x, belief.percept_counts.tobytes()
        if key not in self._made:
            place = hashlib.blake2b(key[1], digest_size=8).hexdigest()
            luck = stream(0, "remembered decisions", belief.x, place)
            self._made[key] = self.policy.decide(history, luck)
        return self._made[key]


def unvalued(momdp: MOMDP, action: int) -> Decision:
    """Return the decision of a policy that compares no values."""
    return Decision.exact(action, np.full(momdp.n_behaviors + 1, np.nan))


def choose(momdp: MOMDP, belief: Belief, values: Floats) -> tuple[int, Floats]:
    """Choose the most valuable behavior, or answer where none is worth more.

    Of values (E,), -inf where not legal; return the action, and the values (E+1,) of all behaviors
    (nan for -inf) and of the best answer.
    """
    best = int(values.argmax())
    every = np.append(values, answer_value(momdp, belief))
    action = best if values[best] > every[-1] else best_answer(momdp, belief)
    return action, np.where(np.isneginf(every), np.nan, every)

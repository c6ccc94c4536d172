"""The transition diagram of the observed states (the paper's Fig. 5)."""

import heapq
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence, Set
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import equal_values, freeze, hash_of, plain_fields
from meal_bayes.errors import DomainError
from meal_bayes.look import short_repr

TERMINAL = "term"
ANY_STATE = "*"


@dataclass(frozen=True, slots=True)
class Effect:
    """One transition of a diagram.

    If the probabilities of a behavior's transitions from a state sum to less than 1, the behavior
    fails with the remaining probability: the state does not change, and there is no percept.

    Attributes
    ----------
    source, target : str
        Names of the states before and after the behavior. As the source, "*" means every state
        except `term`; as the target, "*" means the source.
    behavior : str
        Name of the behavior.
    probability : float
        Pr(target | source, behavior).
    senses : bool
        Whether the transition gives a percept, if the behavior has modalities.
    """

    source: str
    behavior: str
    target: str
    probability: float = 1.0
    senses: bool = True

    def __post_init__(self) -> None:
        plain_fields(self)


class TransitionArrays(NamedTuple):
    """Arrays of a diagram for a list of behaviors.

    `transition` (E,X,X) is Pr(x' | x, behavior); `TransitionDiagram.illegal` determines the rows of
    illegal behaviors. `observation_probability` (E,X,X) is Pr(percept | behavior, x, x'); it is
    below 1 on the diagonal if a behavior that does not change x may fail. `legal` (X,E) says
    whether a behavior can be executed. `cumulative` (E,X,X) is the cumulative sum of `transition`
    over x', from which outcomes are drawn.
    """

    transition: NDArray[np.float64]
    observation_probability: NDArray[np.float64]
    legal: NDArray[np.bool_]
    cumulative: NDArray[np.float64]

    def __eq__(self, other: object) -> bool:
        return equal_values(self, other)

    def __ne__(self, other: object) -> bool:
        return not equal_values(self, other)

    def __hash__(self) -> int:
        return hash_of(self)


@dataclass(frozen=True, slots=True)
class TransitionDiagram:
    """Observed states, the state at the start of a trial, and the transitions of behaviors.

    Attributes
    ----------
    states : tuple[str, ...]
        (X,) names of the states; the last one is "term".
    start : str
        State at the start of a trial.
    effects : tuple[Effect, ...]
        Transitions.
    illegal : str
        Effect of an illegal behavior in the model: "terminate" or "stay". Agents never execute
        illegal behaviors. With "stay", as in the published ROC36, no agent abstains.
    labels : tuple[str, ...]
        (X-1,) text that people read in place of the name of each state except `term`; or empty.

    Raises
    ------
    DomainError
        A transition has an unknown state, probabilities are outside (0, 1] or their sum is above 1,
        a transition is listed twice, or no behavior reaches a state.
    """

    states: tuple[str, ...]
    start: str
    effects: tuple[Effect, ...]
    illegal: str = "terminate"
    labels: tuple[str, ...] = ()

    __repr__ = short_repr

    def __post_init__(self) -> None:
        plain_fields(self)
        if fault := next(self._faults(), None):
            raise DomainError(fault)

    def _faults(self) -> Iterator[str]:
        states = list(self.states[:-1])
        if self.illegal not in ("terminate", "stay"):
            yield f"illegal = {self.illegal!r}; expected 'terminate' or 'stay'."
        if len(set(self.states)) != len(self.states) or self.states[-1:] != (TERMINAL,):
            yield f"States {list(self.states)} must be distinct, with {TERMINAL!r} as the last."
        if self.labels and len(self.labels) != len(states):
            yield f"labels = {list(self.labels)}; expected one for each of {states}."
        for label in self.labels:
            if self.labels.count(label) > 1:
                yield f"Two states have the label {label!r}; give each its own."
        if self.start not in states:
            yield f"start = {self.start!r} is none of the states {states}."
        outgoing: dict[tuple[str, str], dict[str, float]] = {}
        for effect in self.effects:
            for name in sorted({effect.source, effect.target} - {*states, ANY_STATE}):
                yield f"An effect of {effect.behavior!r} names {name!r}; expected one of {states}."
            if not 0.0 < effect.probability <= 1.0:
                arrow = f"{effect.behavior!r} in {effect.source!r}"
                yield f"{arrow} has probability {effect.probability}; expected one in (0, 1]."
            for source, target in self._expand(effect):
                outcomes = outgoing.setdefault((source, effect.behavior), {})
                if target in outcomes:
                    yield f"{source} --{effect.behavior}--> {target} is listed twice; keep one."
                outcomes[target] = effect.probability
        for (source, behavior), outcomes in outgoing.items():
            total = sum(outcomes.values())
            if total > 1 + 1e-9:
                yield f"{behavior!r} in {source!r} has total probability {total}; lower it to 1."
        # A state that nothing leads to is a misspelled name more often than not.
        arrows = {(x, target) for (x, _), outcomes in outgoing.items() for target in outcomes}
        reached = closure(self.start, lambda state: (to for x, to in arrows if x == state))
        lost = [repr(state) for state in states if state not in reached]
        if lost:
            message = f"No behavior ever leads from {self.start!r} to {', '.join(lost)}"
            yield f"{message}; add an effect that does, or remove the state."

    def _expand(self, effect: Effect) -> list[tuple[str, str]]:
        sources = self.states[:-1] if effect.source == ANY_STATE else (effect.source,)
        return [(s, s if effect.target == ANY_STATE else effect.target) for s in sources]

    def successes(self, state: str) -> dict[str, str]:
        """Return the legal behaviors of a state, and the most probable next state after each."""
        likeliest: dict[str, tuple[float, str]] = {}
        for effect in self.effects:
            target = dict(self._expand(effect)).get(state)
            if target and effect.probability > likeliest.get(effect.behavior, (0.0, ""))[0]:
                likeliest[effect.behavior] = effect.probability, target
        return {name: target for name, (_, target) in likeliest.items()}

    def cheapest_first(self, cost: Mapping[str, float], wanted: Set[str]) -> tuple[str, ...]:
        """Build a sequence of legal behaviors that contains every wanted behavior.

        The cheapest behavior comes first, unless other wanted behaviors could not be reached after
        it. A behavior is repeated only if it leads to another wanted one.
        """
        after = {x: self.successes(x) for x in self.states}
        reachable = {  # behaviors that can still be executed from a state on
            x: {name for to in closure(x, lambda y: after[y].values()) for name in after[to]}
            for x in self.states
        }
        missing = set(wanted)
        state = self.start
        sequence = list[str]()

        def lost_by(path: BehaviorPath) -> int:
            """Count the wanted behaviors that can no longer be reached after a path."""
            return len(missing - {path.behaviors[-1]} - reachable[path.state])

        while paths := list(_cheapest_paths(after, state, missing, cost)):
            path = min(paths, key=lost_by)  # the cheapest of those that lose least
            sequence += path.behaviors
            state = path.state
            missing.discard(path.behaviors[-1])
        return tuple(sequence)

    @property
    def abstain(self) -> bool:
        """Whether a trial may end without a report."""
        return self.illegal == "terminate"

    def compile(self, behaviors: Sequence[str]) -> TransitionArrays:
        """Return the diagram as arrays for the named behaviors, in the given order."""
        return _compile(self, tuple(behaviors))


@lru_cache(maxsize=64)
def _compile(diagram: TransitionDiagram, behaviors: tuple[str, ...]) -> TransitionArrays:
    """Compute the arrays of a diagram, which are cached."""
    size = len(diagram.states)
    index = {name: i for i, name in enumerate(diagram.states)}
    row = {name: e for e, name in enumerate(behaviors)}
    transition = np.zeros((len(behaviors), size, size))
    sensed = np.zeros((len(behaviors), size, size))
    for effect in diagram.effects:
        for source, target in diagram._expand(effect):
            e = row[effect.behavior]
            x = index[source]
            next_x = index[target]
            transition[e, x, next_x] += effect.probability
            sensed[e, x, next_x] += effect.probability * effect.senses
    legal = np.asarray(transition.any(axis=2))  # (E,X)
    # What the arrows leave of each row is failure: x stays, nothing is perceived. Rounding must
    # not make it negative.
    rest = np.maximum(1.0 - transition.sum(axis=2), 0.0)
    ends = ~legal & diagram.abstain
    ends[:, -1] = True
    stays = np.arange(size)
    transition[:, stays, stays] += np.where(ends, 0.0, rest)
    transition[:, :, -1] += np.where(ends, rest, 0.0)
    # Pr(a percept | behavior, x, next x): the arrows that sense, of all that lead there.
    probability = np.divide(sensed, transition, out=np.zeros_like(sensed), where=transition > 0)
    cumulative = transition.cumsum(axis=2)
    cumulative[cumulative > 1 - 1e-12] = 1.0  # or rounding makes states possible
    return TransitionArrays(
        freeze(transition), freeze(probability), freeze(legal.T, np.bool_), freeze(cumulative)
    )


def closure(start: str, follow: Callable[[str], Iterable[str]]) -> set[str]:
    """Return a state and all states that can be reached from it."""
    reached = {start}
    frontier = [start]
    while frontier:
        new = set(follow(frontier.pop())) - reached
        reached |= new
        frontier += new
    return reached


class BehaviorPath(NamedTuple):
    """A sequence of behaviors, and the most probable state after it."""

    behaviors: tuple[str, ...]
    state: str


def _cheapest_paths(
    after: Mapping[str, Mapping[str, str]], start: str, wanted: Set[str], cost: Mapping[str, float]
) -> Iterator[BehaviorPath]:
    """Yield the paths that end with a wanted behavior, cheapest first (Dijkstra's algorithm)."""
    waiting: list[tuple[float, tuple[str, ...], str]] = [(0.0, (), start)]
    reached = set[str]()
    ended = set[str]()
    while waiting:
        spent, names, state = heapq.heappop(waiting)
        if names and names[-1] in wanted:
            if names[-1] not in ended:
                ended.add(names[-1])
                yield BehaviorPath(names, state)
        elif state not in reached:
            reached.add(state)
            for name, target in after[state].items():
                heapq.heappush(waiting, (spent + cost[name], (*names, name), target))

"""Baselines: Random, Random Legal, Predefined and Predefined Plus (Sect. 7.1), and two others.

The others are Greedy, and Untouched, which answers without executing a behavior. An agent whose
mean reward is not above that of Untouched is not worth its costs.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats, plain_fields
from meal_bayes.domain.domain import LEGAL_BUDGET
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, answer_value, best_answer, best_report
from meal_bayes.momdp.belief import next_percept, percepts_left
from meal_bayes.momdp.model import nothing_happened
from meal_bayes.planners.momdp_arrays import dynamics_of
from meal_bayes.planners.plans.paths import ShortestPaths, diagram_of
from meal_bayes.planners.solver import Decision, History, unvalued


@dataclass(frozen=True, slots=True)
class Baseline:
    """Policy of a baseline: a function of history and generator."""

    choose: Callable[[History, np.random.Generator], Decision]
    deterministic: bool = False

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the next action."""
        return self.choose(history, rng)


@dataclass(frozen=True, slots=True)
class Random:
    """Draws uniformly from the reports and the behaviors that are legal in the state."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Return the policy."""
        return Baseline(partial(_report_or_behavior, momdp))


def _report_or_behavior(momdp: MOMDP, history: History, rng: np.random.Generator) -> Decision:
    legal = np.flatnonzero(momdp.legal[history.belief.x])
    query = momdp.query
    if rng.random() * (float(query.n_reports) + len(legal)) < len(legal):
        return unvalued(momdp, int(rng.choice(legal)))
    if query.event is not None:
        return unvalued(momdp, momdp.n_behaviors + int(rng.integers(query.n_reports)))
    # Drawn bit by bit, because the number of reports may be larger than a machine integer.
    values = rng.random(len(query)) < 0.5  # a fair coin
    for group in query.groups:
        values[list(group)] = np.arange(len(group)) == rng.integers(len(group))
    return unvalued(momdp, momdp.n_behaviors + query.index_of(values))


@dataclass(frozen=True, slots=True)
class RandomLegal:
    """Draws legal behaviors uniformly until the cost exceeds a budget, then reports.

    Attributes
    ----------
    budget : float
        Budget in seconds; the last behavior may exceed it.
    barred : tuple[str, ...]
        Behaviors that are never drawn, such as those that ask a person.
    """

    budget: float = LEGAL_BUDGET[0]
    barred: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        plain_fields(self)

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Return the policy."""
        allowed = np.array([name not in self.barred for name in momdp.behavior_names])
        return Baseline(partial(draw_legal, momdp, self.budget, momdp.legal & allowed))


def draw_legal(
    momdp: MOMDP,
    budget: float,
    allowed: NDArray[np.bool_],
    history: History,
    rng: np.random.Generator,
) -> Decision:
    """Draw a behavior that is `allowed` (X,E), or report once the budget (s) is spent."""
    legal = np.flatnonzero(allowed[history.belief.x])
    if history.cost >= budget or not len(legal):
        return unvalued(momdp, best_report(momdp, history.belief))
    return unvalued(momdp, int(rng.choice(legal)))


@dataclass(frozen=True, slots=True)
class Predefined:
    """Executes a fixed sequence of behaviors until one is not legal, then reports.

    With `persistent` (Predefined Plus), a behavior is repeated until it succeeds. On a real robot,
    a behavior that keeps failing is given up; see `trials.faults.FaultTolerant`.

    Raises
    ------
    SettingsError
        If the sequence names a behavior that the MOMDP does not have.
    """

    sequence: tuple[str, ...]
    persistent: bool = False

    def __post_init__(self) -> None:
        plain_fields(self)

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Return the policy."""
        missing = [name for name in self.sequence if name not in momdp.behavior_names]
        if missing or not self.sequence:
            raise SettingsError(
                f"The predefined sequence {list(self.sequence)} does not fit the behaviors "
                f"{list(momdp.behavior_names)}; give `predefined` in the domain table."
            )
        return Baseline(partial(self._next, momdp))

    def _next(self, momdp: MOMDP, history: History, rng: np.random.Generator) -> Decision:
        position = 0
        x = momdp.start
        for perceived, next_x in zip(history.perceived, history.moved, strict=True):
            failed = nothing_happened(x, next_x, perceived=perceived)
            position += not (failed and self.persistent)
            x = next_x
        if position < len(self.sequence):
            behavior = momdp.behavior_names.index(self.sequence[position])
            if momdp.legal[history.belief.x, behavior]:
                return unvalued(momdp, behavior)
        return unvalued(momdp, best_report(momdp, history.belief))


@dataclass(frozen=True, slots=True)
class Untouched:
    """Reports the values that are most probable a priori, at once and without cost."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Return the policy."""
        return Baseline(partial(_likeliest, momdp), deterministic=True)


def _likeliest(momdp: MOMDP, history: History, rng: np.random.Generator) -> Decision:
    return unvalued(momdp, best_report(momdp, history.belief))


@dataclass(frozen=True, slots=True)
class Greedy:
    """Maximizes the expected information per second of the next percept.

    The policy reports when a bit of information costs more than its value. The cost of a behavior
    that is not legal in the state includes the cheapest path to it. The value of a bit is the
    expected loss by a wrong report, (r+ - r-) Pr(best report wrong), divided by the entropy of the
    belief.
    """

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> Baseline:
        """Return the policy."""
        shortest = diagram_of(dynamics_of(momdp)).shortest
        return Baseline(partial(_most_bits, momdp, shortest), deterministic=True)


def _most_bits(
    momdp: MOMDP, shortest: ShortestPaths, history: History, rng: np.random.Generator
) -> Decision:
    """Choose the first behavior on the path to the most bits per second."""
    belief = history.belief
    stop = answer_value(momdp, belief)
    entropy = belief.entropy
    values = np.append(np.full(momdp.n_behaviors, np.nan), stop)
    # Seconds per bit: the gain of a certain answer, divided by the entropy.
    bit_value = (momdp.correct - stop) / entropy if entropy > 0 else 0.0
    # If the path to a percept cannot be completed, there is no information.
    gain = information_gain(momdp, belief) * (1.0 - shortest.lost[belief.x])
    first = shortest.first_action[belief.x]
    price = shortest.cost[belief.x]
    goal = (first >= 0) & (gain > 0)
    net = np.where(goal, gain * bit_value - price, -np.inf)
    np.fmax.at(values, first[goal], stop + net[goal])
    rate = np.where(net > 0, gain / np.maximum(price, 1e-9), 0.0)
    best = int(rate.argmax())
    action = int(first[best]) if rate[best] > 0 else best_answer(momdp, belief)
    return Decision.exact(action, values)


def information_gain(momdp: MOMDP, belief: Belief) -> Floats:
    """Compute the mutual information (E,) in bits of each behavior's next percept and the truth."""
    joint = next_percept(momdp, belief)  # (N,E,2,K)
    true = joint.sum(axis=3)
    n, e = joint.shape[:2]
    # I(Y; Z) = H(Y) + H(Z) - H(Y, Z)
    gain = _entropy(true) + _entropy(joint.sum(axis=2)) - _entropy(joint.reshape(n, e, -1))
    available = percepts_left(momdp, belief) > 0
    return np.where(available, gain.clip(0.0).sum(axis=0), 0.0)


def _entropy(rows: Floats) -> Floats:
    return np.asarray(-(rows * np.log2(np.clip(rows, 1e-300, None))).sum(axis=-1))

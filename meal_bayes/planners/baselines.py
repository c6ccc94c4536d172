"""The paper's baselines (Sect. 7.1): Random, Random Legal, Predefined, Predefined Plus; Greedy."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Floats
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, answer_value, best_answer, best_report
from meal_bayes.momdp.belief import next_percept
from meal_bayes.planners.compiled import dynamics_of
from meal_bayes.planners.open_loop.growth import Ways
from meal_bayes.planners.open_loop.library import diagram_of
from meal_bayes.planners.solver import Decision, History, unvalued


@dataclass(frozen=True, slots=True)
class Random:
    """Uniform over the reports and the legal behaviors of x."""

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "RandomPolicy":
        """Return the policy."""
        return RandomPolicy(momdp)


@dataclass(frozen=True, slots=True)
class RandomPolicy:
    """Policy of `Random`."""

    momdp: MOMDP

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Draw a report or a legal behavior."""
        legal = np.flatnonzero(self.momdp.legal[history.belief.x])
        query = self.momdp.query
        if rng.random() * (float(query.n_values) + len(legal)) < len(legal):
            return unvalued(self.momdp, int(rng.choice(legal)))
        # Drawn bit by bit, as 2^81 reports fit in no machine integer.
        values = rng.random(len(query)) < 0.5  # a fair coin
        for group in query.groups:
            values[list(group)] = np.arange(len(group)) == rng.integers(len(group))
        return unvalued(self.momdp, self.momdp.n_behaviors + self.momdp.query.index_of(values))


@dataclass(frozen=True, slots=True)
class RandomLegal:
    """Uniform over the legal behaviors while the cost is below a budget; then the best report.

    Attributes
    ----------
    budget : float
        s; the last behavior may overrun it.
    barred : tuple[str, ...]
        Behaviors that are never drawn, such as those that ask a person.
    """

    budget: float = 50.0
    barred: tuple[str, ...] = ()

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "RandomLegalPolicy":
        """Return the policy."""
        allowed = np.array([name not in self.barred for name in momdp.behavior_names])
        return RandomLegalPolicy(momdp, self.budget, momdp.legal & allowed)


@dataclass(frozen=True, slots=True)
class RandomLegalPolicy:
    """Policy of `RandomLegal`; `allowed` (X,E) are the legal behaviors that are not barred."""

    momdp: MOMDP
    budget: float
    allowed: NDArray[np.bool_]

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Draw a legal behavior, or report once the budget is spent."""
        legal = np.flatnonzero(self.allowed[history.belief.x])
        if history.cost >= self.budget or not len(legal):
            return unvalued(self.momdp, best_report(self.momdp, history.belief))
        return unvalued(self.momdp, int(rng.choice(legal)))


@dataclass(frozen=True, slots=True)
class Predefined:
    """A fixed sequence, each behavior once; ends before one that is not legal, then reports.

    With `persistent` (Predefined Plus) a behavior is repeated until it succeeds.

    Raises
    ------
    SettingsError
        The sequence names a behavior that the MOMDP does not have.
    """

    sequence: tuple[str, ...]
    persistent: bool = False

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "PredefinedPolicy":
        """Return the policy."""
        missing = [name for name in self.sequence if name not in momdp.behavior_names]
        if missing or not self.sequence:
            raise SettingsError(
                f"The predefined sequence {list(self.sequence)} does not fit the behaviors "
                f"{list(momdp.behavior_names)}; give `predefined` in the domain table."
            )
        indices = tuple(momdp.behavior_names.index(name) for name in self.sequence)
        return PredefinedPolicy(momdp, indices, self.persistent)


@dataclass(frozen=True, slots=True)
class PredefinedPolicy:
    """Policy of `Predefined`."""

    momdp: MOMDP
    sequence: tuple[int, ...]
    persistent: bool

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Return the next behavior of the sequence, or report."""
        position, before = 0, self.momdp.start
        for perceived, after in zip(history.perceived, history.moved, strict=True):
            failed = not perceived and after == before
            position += not (failed and self.persistent)
            before = after
        if position < len(self.sequence):
            behavior = self.sequence[position]
            if self.momdp.legal[history.belief.x, behavior]:
                return unvalued(self.momdp, behavior)
        return unvalued(self.momdp, best_report(self.momdp, history.belief))


@dataclass(frozen=True, slots=True)
class Greedy:
    """Maximizes bits per second, one percept ahead; reports when a bit costs more than its value.

    A behavior that is not legal at x is priced with the cheapest way to it. The value of a bit
    is the expected cost of the present error, (r+ - r-) Pr(best report wrong), over the entropy.
    """

    def solve(self, momdp: MOMDP, rng: np.random.Generator) -> "GreedyPolicy":
        """Return the policy."""
        return GreedyPolicy(momdp, diagram_of(dynamics_of(momdp)).ways)


@dataclass(frozen=True, slots=True)
class GreedyPolicy:
    """Policy of `Greedy`."""

    momdp: MOMDP
    ways: Ways
    deterministic: bool = True

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the first behavior on the way to the most bits per second."""
        momdp, belief = self.momdp, history.belief
        stop = answer_value(momdp, belief)
        values = np.full(momdp.n_behaviors + 1, np.nan)
        values[-1] = stop
        entropy = belief.entropy
        bit_value = (momdp.correct - stop) / entropy if entropy > 0 else 0.0
        best_rate, action = 0.0, best_answer(momdp, belief)
        for e, gained in enumerate(information_gain(momdp, belief)):
            first = int(self.ways.hop[belief.x, e])
            price = float(self.ways.cost[belief.x, e])
            if first < 0 or gained <= 0:
                continue
            net = gained * bit_value - price
            values[first] = np.fmax(values[first], stop + net)
            rate = gained / max(price, 1e-9)
            if net > 0 and rate > best_rate:
                best_rate, action = rate, first
        return Decision.exact(action, values)


def information_gain(momdp: MOMDP, belief: Belief) -> Floats:
    """Compute the mutual information (E,), bits, of each behavior's next percept and the truth."""
    joint = next_percept(momdp, belief)  # (N,E,2,K)
    true, (n, e) = joint.sum(axis=3), joint.shape[:2]
    gain = _entropy(true) + _entropy(joint.sum(axis=2)) - _entropy(joint.reshape(n, e, -1))
    left = belief.percept_counts[0].sum(axis=1) < momdp.limit
    return np.where(left, gain.clip(0.0).sum(axis=0), 0.0)


def _entropy(rows: Floats) -> Floats:
    return np.asarray(-(rows * np.log2(np.clip(rows, 1e-300, None))).sum(axis=-1))

"""Greedy: the percept with the most expected information per second, one percept ahead."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.momdp import MOMDP, Belief, answer_value, best_answer
from meal_bayes.momdp.belief import next_percept
from meal_bayes.planners.compiled import dynamics_of
from meal_bayes.planners.open_loop.growth import Ways
from meal_bayes.planners.open_loop.library import diagram_of
from meal_bayes.planners.solver import Decision, History


@dataclass(frozen=True, slots=True)
class Greedy:
    """Maximizes bits per second; reports when a bit costs more than its value.

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


def information_gain(momdp: MOMDP, belief: Belief) -> NDArray[np.float64]:
    """Compute the mutual information (E,), bits, of each behavior's next percept and the truth."""
    joint = next_percept(momdp, belief)  # (N,E,2,K)
    true, (n, e) = joint.sum(axis=3), joint.shape[:2]
    gain = _entropy(true) + _entropy(joint.sum(axis=2)) - _entropy(joint.reshape(n, e, -1))
    left = belief.percept_counts[0].sum(axis=1) < momdp.limit
    return np.where(left, gain.clip(0.0).sum(axis=0), 0.0)


def _entropy(rows: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(-(rows * np.log2(np.clip(rows, 1e-300, None))).sum(axis=-1))

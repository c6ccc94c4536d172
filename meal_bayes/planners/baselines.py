"""The paper's baselines (Sect. 7.1): Random, Random Legal, Predefined, Predefined Plus."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, best_report
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

"""Alpha vectors, one set for each observed x: what point-based solvers of MOMDPs come to."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, answer_value, initial_belief
from meal_bayes.planners.solver import Decision, History, choose


@dataclass(frozen=True, slots=True)
class AlphaVectors:
    """V(x, b) = max over the vectors of x of their product with b; each stands for a plan.

    Plans have a value by truth (V,Y), an x where they begin (V,), and a first action (V,).

    Raises
    ------
    SettingsError
        Arrays whose lengths differ, or no vector at all.
    """

    vectors: NDArray[np.float64]
    x: NDArray[np.int64]
    action: NDArray[np.int64]

    def __post_init__(self) -> None:
        x, action = freeze(self.x, np.int64), freeze(self.action, np.int64)
        set_frozen(self, vectors=freeze(self.vectors), x=x, action=action)
        shape = self.vectors.shape
        if self.vectors.ndim != 2 or not len(x) or not x.shape == action.shape == shape[:1]:
            raise SettingsError(
                f"Alpha vectors of shape {shape} with {x.shape} x and {action.shape} actions; "
                "expected (V,Y), (V,) and (V,), with V at least 1."
            )


@dataclass(frozen=True, slots=True)
class AlphaVectorPolicy:
    """Policy that starts the best plan of several, each an alpha vector.

    Answers need no vector, as their value is exact, and those of illegal behaviors are left out. A
    behavior that keeps x and whose percepts have run out (`limit`, which vectors know nothing of)
    is passed over. Truths are in the query's bit order, actions numbered as in the MOMDP.

    Raises
    ------
    SettingsError
        Vectors of another MOMDP.
    """

    momdp: MOMDP
    alpha: AlphaVectors
    _here: tuple[tuple[NDArray[np.float64], NDArray[np.int64]], ...] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        momdp, alpha = self.momdp, self.alpha
        n, n_y = len(momdp.query), alpha.vectors.shape[1]
        if n_y != 2**n:
            raise SettingsError(
                f"Alpha vectors of {n_y} values; {n} attributes have {2**n} (they may belong to "
                "another query)."
            )
        for name, numbers, count in (
            ("x", alpha.x, len(momdp.x_names)),
            ("actions", alpha.action, momdp.n_actions),
        ):
            if numbers.min() < 0 or numbers.max() >= count:
                raise SettingsError(
                    f"Alpha vectors with {name} from {numbers.min()} to {numbers.max()}; the MOMDP "
                    f"has {count} (they may belong to another one)."
                )
        allowed = np.zeros((len(momdp.x_names), momdp.n_actions), dtype=bool)
        allowed[:, : momdp.n_behaviors] = momdp.legal
        kept = allowed[alpha.x, alpha.action]
        rows = [np.flatnonzero(kept & (alpha.x == x)) for x in range(momdp.terminal)]
        set_frozen(self, _here=tuple((alpha.vectors[r], alpha.action[r]) for r in rows))

    @property
    def lower_bound(self) -> float:
        """Value of the best plan at the start of a trial.

        A lower bound on the optimum where each vector is the value of a plan, as point-based
        solvers' are: exact, but for `limit`.
        """
        belief = initial_belief(self.momdp)
        vectors, _ = self._here[belief.x]
        planned = float((vectors @ belief.joint).max(initial=-np.inf))
        return max(planned, answer_value(self.momdp, belief))

    def decide(self, history: History, rng: np.random.Generator) -> Decision:
        """Choose the best plan, or the best answer."""
        momdp, belief = self.momdp, history.belief
        vectors, actions = self._here[belief.x]
        values = np.full(momdp.n_behaviors, -np.inf)
        np.maximum.at(values, actions, vectors @ belief.joint)
        used_up = belief.percept_counts[0].sum(axis=1) >= momdp.limit
        stays = momdp.transition[:, belief.x, belief.x] == 1
        values[used_up & stays] = -np.inf
        return Decision.exact(*choose(momdp, belief, values))

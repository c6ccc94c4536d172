"""What one object of several is worth, by any planner: its question at each outside value."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP, Belief, expected_reward
from meal_bayes.momdp.numbers import ARRAYS
from meal_bayes.planners.boundary import decide
from meal_bayes.planners.returning import paths_back
from meal_bayes.planners.several_objects import Hand, Prospect, outside_values
from meal_bayes.planners.solver import History, MemoizedPolicy, Policy

Solve = Callable[[MOMDP], Policy]


class Prospector:
    """Values one object's question of yes or no at outside values, by any planner.

    Problems are solved when they are first needed, one for each outside value.

    Parameters
    ----------
    momdp : MOMDP
        Of yes or no; "no" pays what "none of them" earns.
    solve : Solve
        The planner.
    leave : NDArray[np.bool_]
        (X,) whether the object can be left in x.
    """

    def __init__(self, momdp: MOMDP, solve: Solve, leave: NDArray[np.bool_]) -> None:
        none = momdp.reports.payoffs.right_no
        best = momdp.reports.payoffs.right_yes
        self.momdp = momdp
        self.outside = outside_values(none, best)
        self._back = paths_back(momdp, leave, momdp.discount)
        self._solve = solve
        self._policies: list[Policy] = []

    def hand(self, belief: Belief) -> Hand:
        """Return what it takes to leave the object at a belief."""
        back = self._back
        x = belief.x
        return Hand(
            cost=float(back.cost[x]),
            behavior=int(back.first_action[x]),
            discount=float(back.discount[x]),
        )

    def prospect(self, history: History, rng: np.random.Generator) -> Prospect:
        """Return what the object is worth after a history; see `Prospect`.

        Raises
        ------
        SettingsError
            The planner compares no values.
        """
        if not self._policies:
            self._policies = [self._policy(float(value)) for value in self.outside]
        explored = np.full((len(self.outside), self.momdp.n_behaviors), -np.inf)
        for row, policy in zip(explored, self._policies, strict=True):
            decision = decide(policy, history, rng)
            values = decision.values[:-1]
            if decision.action < len(values) and np.isnan(values[decision.action]):
                raise SettingsError(
                    "This agent compares no values, by which objects could be told apart; find by "
                    "one that does, such as bayes, morc, olfc or greedy."
                )
            row[:] = np.where(np.isnan(values), -np.inf, values)
        return Prospect(self.outside, explored, claim_value(self.momdp, history.belief))

    def _policy(self, outside: float) -> Policy:
        """Return the policy of the problem in which "no" pays so much, less putting down."""
        payoffs = self.momdp.reports.payoffs._replace(right_no=outside, wrong_no=outside)
        worth_leaving = self._back.discount * outside - self._back.cost
        problem = replace(
            self.momdp,
            payoffs=payoffs,
            correct=max(payoffs),
            incorrect=min(payoffs),
            abstain=False,
            # "None of them" can be answered with a full hand, too.
            no_cost=outside - np.maximum(worth_leaving, self.outside[0]),
        )
        return self._solve(problem)


class SharedPlans:
    """Solves problems: equal ones once, those that differ in what answers earn by the same plans.

    Decisions are remembered by belief, so that objects of one problem share them, too.

    Parameters
    ----------
    solve : Solve
        The planner.
    """

    def __init__(self, solve: Solve) -> None:
        self._solve = solve
        self._solved: dict[tuple[bytes, ...], dict[object, MemoizedPolicy]] = {}

    def __call__(self, momdp: MOMDP) -> Policy:
        """Return the policy of a problem."""
        arrays = {name: np.ascontiguousarray(getattr(momdp, name)).tobytes() for name in ARRAYS}
        arrays["joint"] = b"" if momdp.joint is None else momdp.joint.tobytes()
        answers = momdp.payoffs, arrays.pop("no_cost")
        policies = self._solved.setdefault(tuple(arrays.values()), {})
        if answers not in policies:
            planner = self._solve
            if policies:  # plans that are grown for one payoff are as good for the others
                first = next(iter(policies.values()))
                planner = getattr(first.policy, "sharing_plans", planner)
            policies[answers] = MemoizedPolicy(planner(momdp))
        return policies[answers]


def claim_value(momdp: MOMDP, belief: Belief) -> float:
    """Compute the expected reward of claiming that the answer is yes."""
    yes = momdp.query.report_of(1)
    return expected_reward(momdp, belief, yes)

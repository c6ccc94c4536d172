"""The boundary to planners of one's own: what they return is checked where it enters."""

from typing import Any

import numpy as np

from meal_bayes.errors import SettingsError
from meal_bayes.momdp import MOMDP
from meal_bayes.planners.solver import Decision, History, Policy, Solver


def checked_solver(value: object, agent: str) -> Solver:
    """Return what plans for an agent; `SettingsError` where it cannot."""
    if not callable(getattr(value, "solve", None)):
        raise SettingsError(
            f"The planner of agent {agent!r} is {value!r:.60}; expected an object with a method "
            "solve(momdp, rng)."
        )
    solver: Any = value
    return solver  # type: ignore[no-any-return]


def solve(solver: Solver, momdp: MOMDP, rng: np.random.Generator) -> Policy:
    """Return a planner's policy; `SettingsError` where it returns none."""
    policy: Any = solver.solve(momdp, rng)
    if not callable(getattr(policy, "decide", None)):
        raise SettingsError(
            f"solve() of the planner {type(solver).__name__} returned {policy!r:.60}; expected a "
            "policy, an object with a method decide(history, rng)."
        )
    return policy  # type: ignore[no-any-return]


def decide(policy: Policy, history: History, rng: np.random.Generator) -> Decision:
    """Return a policy's decision; `SettingsError` where it is none."""
    decision: object = policy.decide(history, rng)
    if not isinstance(decision, Decision):
        raise SettingsError(
            f"decide() of the policy {type(policy).__name__} returned {decision!r:.60}; expected a "
            "Decision, as of `unvalued(momdp, action)`."
        )
    return decision

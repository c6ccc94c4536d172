"""Decisions that need neither plans nor search: where one behavior is legal, and worth it."""

import numpy as np

from meal_bayes.momdp import MOMDP, Belief, answer_value
from meal_bayes.momdp.belief import next_percept
from meal_bayes.planners.compiled import dynamics_of
from meal_bayes.planners.open_loop.library import diagram_of
from meal_bayes.planners.solver import Decision


def certain_behavior(momdp: MOMDP, belief: Belief) -> Decision | None:
    """Return the decision for the only legal behavior if a report is worse for certain, else None.

    It is, if the report is worth less than going for a first percept of some behavior and then
    reporting, where each attribute is judged by the one percept on the way that tells most of it.
    """
    dynamics = dynamics_of(momdp)
    legal = np.flatnonzero(dynamics.step["legal"][belief.x])
    if len(legal) != 1 or momdp.bonus.any():
        return None
    ways = diagram_of(dynamics).ways
    error = next_percept(momdp, belief).min(axis=2).sum(axis=2)  # (N,E) Bayes error of a percept
    used = (ways.observation_counts[belief.x] > 0) & (
        belief.percept_counts[0].sum(axis=1) < momdp.limit
    )  # (goal,E)
    least = np.where(used[:, None], error, 1.0 - belief.right[:, None]).min(axis=2)  # (goal,N)
    value = momdp.report_reward(1.0 - least)
    value = ways.discount[belief.x] * value - ways.cost[belief.x]
    best = float(np.where(ways.hop[belief.x] >= 0, value, -np.inf).max(initial=-np.inf))
    ending = answer_value(momdp, belief)
    if best <= ending:
        return None
    values = np.full(momdp.n_behaviors + 1, np.nan)
    values[legal[0]], values[-1] = best, ending
    return Decision.exact(int(legal[0]), values)

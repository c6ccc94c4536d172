"""The decision problem of one query.

In: a `Domain`, a `Query`, and two arrays (`confusion`, `precision`) of what perception is worth.
Out: a `MOMDP`, and the exact factored `Belief` that is filtered in it.
"""

from meal_bayes.momdp.belief import (
    Belief,
    Transition,
    best_report,
    initial_belief,
    report_value,
    update_belief,
)
from meal_bayes.momdp.build import build_momdp
from meal_bayes.momdp.flat import FlatPOMDP, flatten, percept_probabilities
from meal_bayes.momdp.model import MOMDP
from meal_bayes.momdp.shaping import ITRS, observation_entropy, shape_reward

__all__ = [
    "ITRS",
    "MOMDP",
    "Belief",
    "FlatPOMDP",
    "Transition",
    "best_report",
    "build_momdp",
    "flatten",
    "initial_belief",
    "observation_entropy",
    "percept_probabilities",
    "report_value",
    "shape_reward",
    "update_belief",
]

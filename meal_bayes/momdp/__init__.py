"""The decision problem of one query.

The input is a `Domain`, a `Query`, and the observation model, which consists of two arrays
(`confusion`, `precision`). The output is a `MOMDP`, and the exact factored `Belief` in it.
"""

from meal_bayes.momdp.belief import (
    Belief,
    Transition,
    answer_value,
    belief_of,
    best_answer,
    best_report,
    expected_reward,
    initial_belief,
    next_percept,
    report_certainty,
    report_value,
    update_belief,
)
from meal_bayes.momdp.build import (
    Objective,
    add_itrs_bonus,
    build_momdp,
    observation_entropy,
    with_joint_prior,
)
from meal_bayes.momdp.flat_pomdp import FlatPOMDP, flatten, percept_probabilities
from meal_bayes.momdp.model import MOMDP
from meal_bayes.momdp.observation import predictive
from meal_bayes.momdp.reports import Reports
from meal_bayes.momdp.solver_files import write_pomdp, write_pomdpx

__all__ = [
    "MOMDP", "Belief", "FlatPOMDP", "Objective", "Reports", "Transition", "add_itrs_bonus",
    "answer_value", "belief_of", "best_answer", "best_report", "build_momdp", "expected_reward",
    "flatten", "initial_belief", "next_percept", "observation_entropy", "percept_probabilities",
    "predictive", "report_certainty", "report_value", "update_belief", "with_joint_prior",
    "write_pomdp", "write_pomdpx",
]  # fmt: skip

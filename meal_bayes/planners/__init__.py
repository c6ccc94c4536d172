"""Solvers of the MOMDP of a query: they take a `MOMDP` and return a `Policy`.

A policy returns a `Decision`, the next action of a trial.
"""

from meal_bayes.planners.baselines import Greedy, Predefined, Random, RandomLegal, Untouched
from meal_bayes.planners.jit import Compiling, watch_compilation
from meal_bayes.planners.plans.policy import OpenLoop, OpenLoopPolicy
from meal_bayes.planners.precompile import warm_up
from meal_bayes.planners.search.policy import POMCP
from meal_bayes.planners.solver import (
    RULE,
    Decision,
    GoingOn,
    History,
    MemoizedPolicy,
    Policy,
    Solver,
    TreeEdge,
    unvalued,
)
from meal_bayes.planners.table.batched import batched_value_iteration
from meal_bayes.planners.table.policy import Factored

__all__ = [
    "POMCP", "RULE", "Compiling", "Decision", "Factored", "GoingOn", "Greedy", "History",
    "MemoizedPolicy", "OpenLoop", "OpenLoopPolicy", "Policy", "Predefined", "Random", "RandomLegal",
    "Solver", "TreeEdge", "Untouched", "batched_value_iteration", "unvalued", "warm_up",
    "watch_compilation",
]  # fmt: skip

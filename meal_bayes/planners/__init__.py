"""Solvers of the query MOMDP: what to do next.

In: a `MOMDP`. Out: `Policy`, `Decision`.
"""

from meal_bayes.planners.baselines import Greedy, Predefined, Random, RandomLegal, Untouched
from meal_bayes.planners.factored.batched import batched_value_iteration
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.jit import Compiling, watch_compilation
from meal_bayes.planners.open_loop.policy import OpenLoop, OpenLoopPolicy
from meal_bayes.planners.pomcp.policy import POMCP
from meal_bayes.planners.precompile import warm_up
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

__all__ = [
    "POMCP", "RULE", "Compiling", "Decision", "Factored", "GoingOn", "Greedy", "History",
    "MemoizedPolicy", "OpenLoop", "OpenLoopPolicy", "Policy", "Predefined", "Random", "RandomLegal",
    "Solver", "TreeEdge", "Untouched", "batched_value_iteration", "unvalued", "warm_up",
    "watch_compilation",
]  # fmt: skip

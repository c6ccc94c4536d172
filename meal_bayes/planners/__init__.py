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
from meal_bayes.planners.prospector import Prospector, SharedPlans
from meal_bayes.planners.returning import paths_back
from meal_bayes.planners.several_objects import (
    EMPTY,
    Hand,
    Move,
    Prospect,
    best_move,
)
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
    "EMPTY", "POMCP", "RULE", "Compiling", "Decision", "Factored", "GoingOn", "Greedy", "Hand",
    "History", "MemoizedPolicy", "Move", "OpenLoop", "OpenLoopPolicy", "Policy", "Predefined",
    "Prospect", "Prospector", "Random", "RandomLegal", "SharedPlans", "Solver", "TreeEdge",
    "Untouched", "batched_value_iteration", "best_move", "paths_back", "unvalued", "warm_up",
    "watch_compilation",
]  # fmt: skip

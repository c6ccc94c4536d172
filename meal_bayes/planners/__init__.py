"""Solvers of the query MOMDP: what to do next.

In: a `MOMDP`. Out: `Policy`, `Decision`.
"""

from meal_bayes.planners.baselines import Greedy, Predefined, Random, RandomLegal, Untouched
from meal_bayes.planners.factored.batched import batched_value_iteration
from meal_bayes.planners.factored.policy import Factored
from meal_bayes.planners.kernels import watch_compilation
from meal_bayes.planners.open_loop.policy import OpenLoop, OpenLoopPolicy
from meal_bayes.planners.pomcp.policy import POMCP
from meal_bayes.planners.precompile import warm_up
from meal_bayes.planners.several_objects import (
    Move,
    Prospect,
    Prospector,
    SharedPlans,
    best_move,
    values_beside,
    ways_back,
)
from meal_bayes.planners.solver import (
    RULE,
    Decision,
    GoingOn,
    History,
    Policy,
    Remembering,
    Solver,
    TreeEdge,
    unvalued,
)

__all__ = [
    "POMCP", "RULE", "Decision", "Factored", "GoingOn", "Greedy", "History", "Move", "OpenLoop",
    "OpenLoopPolicy", "Policy", "Predefined", "Prospect", "Prospector", "Random", "RandomLegal",
    "Remembering", "SharedPlans", "Solver", "TreeEdge", "Untouched", "batched_value_iteration",
    "best_move", "unvalued", "values_beside", "warm_up", "watch_compilation", "ways_back",
]  # fmt: skip

"""Solvers of the query MOMDP: what to do next.

In: a `MOMDP` (two arrays say what perception is worth). Out: `Policy`, `Decision`.
"""

from meal_bayes.planners.baselines import Predefined, Random, RandomLegal
from meal_bayes.planners.greedy import Greedy
from meal_bayes.planners.pomcp import POMCP, compile_kernels
from meal_bayes.planners.solver import (
    Decision,
    History,
    Policy,
    Solver,
    TreeEdge,
    unvalued,
)

__all__ = [
    "POMCP",
    "Decision",
    "Greedy",
    "History",
    "Policy",
    "Predefined",
    "Random",
    "RandomLegal",
    "Solver",
    "TreeEdge",
    "compile_kernels",
    "unvalued",
]

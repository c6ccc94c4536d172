"""Open-loop plans with exact error rates: a planner of its own, and the leaf of the tree search."""

from meal_bayes.planners.open_loop.policy import OpenLoop, OpenLoopPolicy

__all__ = ["OpenLoop", "OpenLoopPolicy"]

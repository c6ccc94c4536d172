"""POMCP: Monte Carlo tree search in sampled MOMDPs, from the exact belief."""

from meal_bayes.planners.pomcp.policy import POMCP, compile_kernels

__all__ = ["POMCP", "compile_kernels"]

"""POMCP: Monte Carlo tree search in sampled MOMDPs, from the exact belief."""

from meal_bayes.planners.pomcp.policy import POMCP, POMCPPolicy

__all__ = ["POMCP", "POMCPPolicy"]

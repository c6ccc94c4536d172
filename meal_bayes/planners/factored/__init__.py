"""Factored value iteration: the paper's problem solved on a grid of marginal beliefs."""

from meal_bayes.planners.factored.batched import batched_value_iteration
from meal_bayes.planners.factored.policy import Factored, FactoredPolicy

__all__ = ["Factored", "FactoredPolicy", "batched_value_iteration"]

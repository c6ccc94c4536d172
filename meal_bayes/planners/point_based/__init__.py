"""Policies of alpha vectors, and SARSOP, which makes them."""

from meal_bayes.planners.point_based.alpha_vectors import AlphaVectorPolicy, AlphaVectors
from meal_bayes.planners.point_based.policy_file import read_policy
from meal_bayes.planners.point_based.sarsop import Sarsop

__all__ = ["AlphaVectorPolicy", "AlphaVectors", "Sarsop", "read_policy"]

"""Point-based value iteration over joint beliefs, and policies of alpha vectors."""

from meal_bayes.planners.point_based.alpha_vectors import AlphaVectorPolicy, AlphaVectors
from meal_bayes.planners.point_based.pbvi import PBVI
from meal_bayes.planners.point_based.policy_file import read_policy
from meal_bayes.planners.point_based.sarsop import Sarsop

__all__ = ["PBVI", "AlphaVectorPolicy", "AlphaVectors", "Sarsop", "read_policy"]

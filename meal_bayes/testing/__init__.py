"""Checks that a solver or a robot of one's own keeps to what the package expects.

In: the object, and for a robot its domain. Out: nothing, or a `ConformanceError` that says what was
found, what was expected, and how to mend it. The package's own solvers and robots pass the same
checks in its tests.
"""

from meal_bayes.testing.problems import example_problems
from meal_bayes.testing.robot import check_robot
from meal_bayes.testing.solver import check_solver

__all__ = ["check_robot", "check_solver", "example_problems"]

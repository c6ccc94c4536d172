"""Checks of your own solver or robot.

The input is the solver, or the robot and its domain. If a check fails, it raises a
`ConformanceError` that says what was found, what was expected, and how to correct it. The solvers
and robots of the package pass the same checks in its tests.
"""

from meal_bayes.testing.problems import example_problems
from meal_bayes.testing.robot import check_robot
from meal_bayes.testing.solver import check_solver

__all__ = ["check_robot", "check_solver", "example_problems"]

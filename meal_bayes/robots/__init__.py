"""Robots: execute a behavior, observe the next state, return the features that were sensed.

In: a `Domain`, and recordings. Out: `Outcome`s, by names. A real robot
implements `Robot`; `CheckedRobot` checks what it returns.
"""

from meal_bayes.robots.boundary import CheckedRobot, Execution
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import Outcome, Robot

__all__ = ["CheckedRobot", "Execution", "Outcome", "RecordedRobot", "Robot"]

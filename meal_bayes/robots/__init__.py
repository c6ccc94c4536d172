"""Robots: execute a behavior, observe the next state, return the features that were sensed.

In: a `Domain`, and recordings. Out: `Outcome`s, by names. A real robot
implements `Robot`; `Boundary` checks what it returns.
"""

from meal_bayes.robots.robot import Boundary, Outcome, Robot

__all__ = ["Boundary", "Outcome", "Robot"]

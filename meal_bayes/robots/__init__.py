"""Robots: execute a behavior, observe the next state, return the features that were sensed.

In: a `Domain`, and recordings. Out: `Outcome`s, by names. A real robot
implements `Robot`; `OutcomeChecker` checks what it returns.
"""

from meal_bayes.robots.robot import Frame, Outcome, OutcomeChecker, Robot

__all__ = ["Frame", "Outcome", "OutcomeChecker", "Robot"]

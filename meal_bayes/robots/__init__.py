"""Robots, which execute behaviors and return the next state and features.

The input is a `Domain`, and recordings for replayed robots. The output is an `Outcome` for each
behavior. The driver of a real robot implements the protocol `Robot`; `OutcomeChecker` checks the
outcomes that it returns.
"""

from meal_bayes.robots.robot import Frame, Outcome, OutcomeChecker, Robot

__all__ = ["Frame", "Outcome", "OutcomeChecker", "Robot"]

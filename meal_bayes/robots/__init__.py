"""Bodies: execute a behavior, observe the next state, hand over what was felt.

In: a `Domain`, and recordings or a synthetic model. Out: `Outcome`s, by names. A real robot
implements `Robot`; `CheckedRobot` is the boundary behind which all is checked.
"""

from meal_bayes.robots.boundary import CheckedRobot, Execution
from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import Outcome, Robot
from meal_bayes.robots.simulated import SimulatedRobot

__all__ = ["CheckedRobot", "Execution", "Outcome", "RecordedRobot", "Robot", "SimulatedRobot"]

"""Bodies: execute a behavior, observe the next x, hand over the instance.

In: a `Domain`, and recordings or a synthetic model. Out: `Execution`s. A real robot implements
`Robot`.
"""

from meal_bayes.robots.recorded import RecordedRobot
from meal_bayes.robots.robot import Execution, Robot
from meal_bayes.robots.simulated import SimulatedRobot

__all__ = ["Execution", "RecordedRobot", "Robot", "SimulatedRobot"]

"""Several objects, each with a robot of its own in front of it, as replays and simulations have."""

from collections.abc import Mapping

from meal_bayes.domain import unknown
from meal_bayes.errors import SettingsError
from meal_bayes.robots.robot import Outcome, Robot


class RobotPerObject:
    """A robot that turns from one object to another: each has a `Robot`, by the object's name.

    Objects stay in the state in which they were left.

    Parameters
    ----------
    robots : Mapping[str, Robot]
        By object.
    states : Mapping[str, str]
        Of the objects that were explored before, where each was left; others are started.
    """

    def __init__(
        self, robots: Mapping[str, Robot], states: Mapping[str, str] | None = None
    ) -> None:
        self._robots = dict(robots)
        self._states = dict(states or {})
        self._front = ""

    def turn_to(self, name: str) -> str:
        """Turn to an object, and return its state; errors where there is none of this name."""
        if name not in self._robots:
            raise SettingsError(unknown("object", name, self._robots))
        if name not in self._states:
            self._states[name] = self._robots[name].start()
        self._front = name
        return self._states[name]

    def execute(self, behavior: str) -> Outcome:
        """Execute a behavior on the object in front, and return its outcome."""
        if not self._front:
            raise SettingsError("No object is in front of the robot; call turn_to(name) first.")
        outcome = self._robots[self._front].execute(behavior)
        self._states[self._front] = outcome.state
        return outcome

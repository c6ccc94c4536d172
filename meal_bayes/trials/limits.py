"""Limits of a trial, or of a whole search, at which the best answer so far is given."""

from dataclasses import dataclass

from meal_bayes.arrays import check_seconds, check_whole, plain_fields


@dataclass(frozen=True, slots=True)
class Limits:
    """How long a trial may be.

    Attributes
    ----------
    max_steps : int
        Behaviors.
    max_cost : float | None
        s; None: no limit.
    """

    max_steps: int
    max_cost: float | None = None

    def __post_init__(self) -> None:
        plain_fields(self)
        check_whole("max_steps", self.max_steps)
        check_seconds("max_cost", self.max_cost, or_none=True)

    def reached(self, steps: int, cost: float) -> str:
        """Return which limit forbids a behavior after so many steps, in words; empty: none.

        The cost, s, is that of the trial with this behavior.

        >>> Limits(100, 60.0).reached(3, 61.5)
        'max_cost = 60 s'
        """
        if steps >= self.max_steps:
            return f"max_steps = {self.max_steps}"
        if self.max_cost is not None and cost > self.max_cost:
            return f"max_cost = {self.max_cost:g} s"
        return ""

"""The closing record of a log: how much its writer wrote."""

import math
from typing import NamedTuple

from meal_bayes.errors import LogCorruptError
from meal_bayes.trials import Trial, TrialOutcomes
from meal_bayes.untrusted import read_json


class End(NamedTuple):
    """Contents of a file, as its writer counted them."""

    trials: int = 0
    steps: int = 0
    cost: float = 0.0  # s, of all trials

    def after(self, found: Trial | TrialOutcomes) -> "End":
        """Count what comes next."""
        if isinstance(found, Trial):
            return End(self.trials + 1, self.steps + len(found.steps), self.cost + found.cost)
        steps, cost = int(found.steps.sum()), math.fsum(found.cost.tolist())
        return End(self.trials + len(found), self.steps + steps, self.cost + cost)

    @classmethod
    def of_json(cls, data: bytes) -> "End":
        """Read a closing record."""
        facts = read_json(data.decode())
        types = {"trials": int, "steps": int, "cost": float}
        if not isinstance(facts, dict) or {name: type(v) for name, v in facts.items()} != types:
            raise LogCorruptError("the closing record holds no counts")
        return cls(**facts)

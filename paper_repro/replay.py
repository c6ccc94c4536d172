"""Trials that the paper prints belief by belief, replayed through our filter."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

import meal_bayes
from meal_bayes.momdp import MOMDP, Belief, Transition

Rates = Mapping[str, Mapping[str, Sequence[float]]]  # attribute: behavior: true, false positive


def momdp_of(dataset: str, rates: Rates) -> MOMDP:
    """Build the MOMDP of a query whose confusion matrices are given by their rates."""
    domain = meal_bayes.load_domain(dataset)
    confusion = np.full((len(rates), len(domain.behaviors), 2, 2), 0.5)
    for attribute, behaviors in zip(confusion, rates.values(), strict=True):
        for name, (true, false) in behaviors.items():
            attribute[domain.behavior_index(name)] = [[1 - false, false], [1 - true, true]]
    return meal_bayes.build_momdp(domain, meal_bayes.Query(tuple(rates)), confusion)


def replay(momdp: MOMDP, steps: Sequence[Mapping[str, Any]]) -> list[Belief]:
    """Return the belief before the trial and after each step.

    A step names its behavior, the percept levels that came, if any, and the x where it led, if it
    moved.
    """
    beliefs = [meal_bayes.initial_belief(momdp)]
    for step in steps:
        action = momdp.behavior_names.index(step["behavior"])
        last = beliefs[-1]
        next_x = momdp.x_names.index(step["x"]) if "x" in step else last.x
        percept = np.array(step["percept"], np.int8) if "percept" in step else None
        beliefs.append(meal_bayes.update_belief(last, momdp, Transition(action, next_x, percept)))
    return beliefs


def cost_of(momdp: MOMDP, steps: Sequence[Mapping[str, Any]]) -> float:
    """Sum the seconds of the steps."""
    return float(sum(momdp.cost[momdp.behavior_names.index(step["behavior"])] for step in steps))

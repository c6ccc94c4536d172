"""How often behaviors succeed, learned from what the robot has executed."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import shaped_array
from meal_bayes.domain.domain import Domain

_PRIOR = 2.0  # executions at the domain's own probability


def learn_success(domain: Domain, attempts: NDArray[np.float64]) -> Domain:
    """Return the domain with the posterior mean of every behavior's success probability.

    The prior is worth two executions at the domain's own probability. Outcomes keep their shares.

    Parameters
    ----------
    attempts : NDArray[np.float64]
        (E,2) legal executions that failed, and that succeeded, by their weights.
    """
    attempts = shaped_array("attempts", attempts, len(domain.behaviors), 2)
    diagram = domain.diagram
    effects = []
    for effect in diagram.effects:
        failed, succeeded = attempts[domain.behavior_index(effect.behavior)]
        arrow = effect.source, effect.behavior
        stated = sum(e.probability for e in diagram.effects if (e.source, e.behavior) == arrow)
        learned = float((_PRIOR * stated + succeeded) / (_PRIOR + failed + succeeded))
        changed = replace(effect, probability=effect.probability * learned / stated)
        effects.append(effect if learned == stated else changed)
    return replace(domain, diagram=replace(diagram, effects=tuple(effects)))

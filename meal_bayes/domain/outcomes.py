"""How often behaviors succeed, learned from executions."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain.domain import Domain

_PRIOR = 2.0  # executions at the domain's own probability


def learn_success(domain: Domain, attempts: NDArray[np.int64]) -> Domain:
    """Return the domain with the posterior mean of every behavior's success probability.

    The prior is worth two executions at the domain's own probability.

    Parameters
    ----------
    attempts : NDArray[np.int64]
        (E,2) legal executions that failed, and that succeeded.
    """

    def mean(behavior: str, prior: float) -> float:
        failed, succeeded = attempts[domain.behavior_index(behavior)]
        return float((_PRIOR * prior + succeeded) / (_PRIOR + failed + succeeded))

    return replace(domain, diagram=domain.diagram.succeeding(mean))

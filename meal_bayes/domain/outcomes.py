"""How often behaviors succeed, learned from what happened.

`learn_diagram` learns each arrow from the states before and after. Where a behavior keeps its state
these do not show whether it failed, but percepts do: `learn_success` learns one rate a behavior.
"""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain.diagram import Effect, TransitionDiagram
from meal_bayes.domain.domain import Domain

_PSEUDO_COUNT = 0.5  # of each outcome: Jeffreys' prior
_PRIOR = 2.0  # executions at the domain's own probability

Outcomes = Mapping[tuple[str, str, str], int]  # (state, behavior, state after) -> times


def learn_diagram(diagram: TransitionDiagram, happened: Outcomes) -> TransitionDiagram:
    """Return the diagram with the posterior mean of every arrow's probability.

    The outcomes of a behavior in a state are the arrows that the diagram lists, and, where none of
    them keeps the state, failing there; their prior is Jeffreys'. The arrows stay those that are
    listed: what happened otherwise is not counted.

    >>> from meal_bayes.domain import load_domain
    >>> toy = load_domain("toy").diagram
    >>> arrow = next(e for e in toy.effects if e.source != e.target and e.source != "*")
    >>> happened = {(arrow.source, arrow.behavior, arrow.target): 9}
    >>> learned = learn_diagram(toy, happened)
    >>> next(e.probability for e in learned.effects if e.behavior == arrow.behavior)
    0.95
    """
    effects: list[Effect] = []
    for state in diagram.states[:-1]:
        arrows = [
            replace(effect, source=state, target=state if effect.target == "*" else effect.target)
            for effect in diagram.effects
            if effect.source in (state, "*")
        ]
        for behavior in dict.fromkeys(arrow.behavior for arrow in arrows):
            own = [arrow for arrow in arrows if arrow.behavior == behavior]
            effects += _learned(own, happened)
    return replace(diagram, effects=tuple(effects))


def _learned(arrows: list[Effect], happened: Outcomes) -> list[Effect]:
    """Learn the probabilities of the arrows of one behavior in one state."""
    state, behavior = arrows[0].source, arrows[0].behavior
    ends = list(dict.fromkeys([*(arrow.target for arrow in arrows), state]))
    counts = {end: _PSEUDO_COUNT + happened.get((state, behavior, end), 0) for end in ends}
    total = sum(counts.values())
    return [replace(arrow, probability=counts[arrow.target] / total) for arrow in arrows]


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

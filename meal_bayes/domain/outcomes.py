"""How often behaviors succeed, learned from what happened."""

from collections.abc import Mapping
from dataclasses import replace

from meal_bayes.domain.diagram import Effect, TransitionDiagram

_PSEUDO_COUNT = 0.5  # of each outcome: Jeffreys' prior

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

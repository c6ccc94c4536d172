"""How often behaviors succeed, and people who are asked are right, learned from what happened."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import shaped_array
from meal_bayes.domain.domain import Domain

_PRIOR = 2.0  # executions, or answers, at the domain's own probability


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


def learn_answers(domain: Domain, answers: NDArray[np.float64]) -> Domain:
    """Return the domain with the posterior mean of how often each behavior's answers are right.

    The prior is worth two answers at the domain's own `answer_accuracy`.

    Parameters
    ----------
    answers : NDArray[np.float64]
        (E,2) answers that were wrong, and right, by the labels of their objects.

    Examples
    --------
    >>> from meal_bayes import load_domain
    >>> asked = np.zeros((10, 2))
    >>> asked[9] = 10, 30
    >>> learn_answers(load_domain("ispy32"), asked).behaviors[9].answer_accuracy
    0.7476190476190476
    """
    answers = shaped_array("answers", answers, len(domain.behaviors), 2)
    behaviors = []
    for behavior, (wrong, right) in zip(domain.behaviors, answers.tolist(), strict=True):
        stated = behavior.answer_accuracy
        if stated is not None and wrong + right:
            learned = (_PRIOR * stated + right) / (_PRIOR + wrong + right)
            behavior = replace(behavior, answer_accuracy=learned)  # noqa: PLW2901
        behaviors.append(behavior)
    return replace(domain, behaviors=tuple(behaviors))

"""Labels of an object from all that was told of it: what holds, and what that makes of it.

Feedback is never erased: a row of value -1 withdraws the earlier ones of its trial.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.domain import Domain
from meal_bayes.errors import QueryError
from meal_bayes.learner.columns import FeedbackRow, Labels


class LabelCall(NamedTuple):
    """Labels (P,) that were told together in a trial; -1 unknown."""

    trial: int
    labels: Labels


def no_labels(domain: Domain) -> Labels:
    """Return labels (P,) of which none is known."""
    return np.full(len(domain.attributes), -1, np.int8)


def calls_that_hold(domain: Domain, feedback: NDArray[Any]) -> list[LabelCall]:
    """Return what holds of the feedback (l,) of an object, in the order in which it was told."""
    rows = [FeedbackRow(*row) for row in feedback.tolist()]
    withdrawn: dict[tuple[int, int], int] = {}  # position of the last withdrawal
    for position, row in enumerate(rows):
        if row.value < 0:
            withdrawn[row.trial, row.attribute] = position
    calls: dict[int, LabelCall] = {}
    # A label holds where no withdrawal of its trial follows.
    for position, row in enumerate(rows):
        if row.value < 0 or position < withdrawn.get((row.trial, row.attribute), -1):
            continue
        if row.call not in calls:
            calls[row.call] = LabelCall(row.trial, no_labels(domain))
        calls[row.call].labels[row.attribute] = row.value
    return list(calls.values())


def fold(domain: Domain, calls: Iterable[LabelCall]) -> Labels:
    """Return the labels (P,) after calls, in order.

    Where what a denial referred to was withdrawn, so that none of a group is left, it holds
    alone.
    """
    folded = no_labels(domain)
    for _, labels in calls:
        try:
            folded = domain.replace(folded, labels)
        except QueryError:
            groups = map(domain.columns, domain.groups.values())
            denied = [columns for columns in groups if (labels[columns] >= 0).any()]
            rest = folded.copy()
            rest[[p for columns in denied for p in columns]] = -1
            folded = domain.replace(rest, labels)
    return folded


def fold_by_trial(domain: Domain, calls: Iterable[LabelCall]) -> Labels:
    """Return the labels (trials,P) of each trial after its calls, in order."""
    calls_of: dict[int, list[LabelCall]] = {}
    for call in calls:
        calls_of.setdefault(call.trial, []).append(call)
    rows = [fold(domain, of_trial) for of_trial in calls_of.values()]
    return np.array(rows, np.int8).reshape(-1, len(domain.attributes))

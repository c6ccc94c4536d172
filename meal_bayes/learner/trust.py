r"""How far labels are trusted: learned by attribute, from labels of one object that agree or not.

A label of attribute p is right with probability t_p, whatever the truth; labels that were told of
one object in different trials err independently given the truth, of which either value is equally
likely before any label. With n1 labels that say yes and n0 that say no of an object,

    t_p ~ Beta(99, 1)
    Pr(labels of an object | t) = (t^n1 (1 - t)^n0 + t^n0 (1 - t)^n1) / 2
    Pr(true | labels of it, t)  = 1 / (1 + ((1 - t) / t)^(n1 - n0))

and both are integrated over t on a grid in log-odds of t. A single label of an object says nothing
of t, so that it is believed by .99, the mean of the prior, until labels contradict each other.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.special import expit

from meal_bayes.arrays import Floats
from meal_bayes.domain import Query
from meal_bayes.learner.experience import NONE, Experience

_PRIOR = 99.0, 1.0  # of the Beta distribution of t: as many labels that were right, and wrong
MOST_VOTES = 5  # of one side more than of the other, beyond which a belief could not be moved
_LOG_ODDS = np.arange(0.0, 24.0, 0.125)  # of t, (G,); below one half labels would be denials
_LOG_RIGHT = np.log(expit(_LOG_ODDS))
_LOG_WRONG = np.log(expit(-_LOG_ODDS))


def learn_trust(yes: NDArray[np.int64], no: NDArray[np.int64]) -> Floats:
    """Compute Pr(t) (P,G) from the numbers (O,P) of labels of objects that say yes, and no.

    >>> nothing = np.zeros((1, 1), int)
    >>> float((learn_trust(nothing, nothing) @ expit(_LOG_ODDS))[0].round(6))
    0.99
    """
    log_weight = _PRIOR[0] * _LOG_RIGHT + _PRIOR[1] * _LOG_WRONG  # t (1 - t) by the log-odds' step
    # Objects of equal numbers have equal factors, and those of one label say nothing.
    several = yes + no > 1
    total = np.tile(log_weight, (yes.shape[1], 1))
    for p in range(yes.shape[1]):
        rows = np.stack([yes[several[:, p], p], no[several[:, p], p]], axis=1)
        numbers, times = np.unique(rows, axis=0, return_counts=True)
        n1 = numbers[:, :1]
        n0 = numbers[:, 1:]
        if_true = n1 * _LOG_RIGHT + n0 * _LOG_WRONG
        if_false = n0 * _LOG_RIGHT + n1 * _LOG_WRONG
        total[p] += times @ np.logaddexp(if_true, if_false)
    weights = np.exp(total - total.max(axis=1, keepdims=True))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def prob_true(trust: Floats, votes: NDArray[np.int64]) -> Floats:
    """Return Pr(attribute is true) (N,), by labels for it less those against it, (N,).

    `trust` (N,G) includes what the object's own labels say of t. Where as many labels say yes as
    no, they tell nothing, and it is NaN.
    """
    lead = np.clip(votes, -MOST_VOTES, MOST_VOTES)
    chance = (trust * expit(lead[:, None] * _LOG_ODDS)).sum(axis=1)
    return np.where(votes == 0, np.nan, chance)


def told_prior(record: Experience, query: Query, object_name: str) -> Floats | None:
    """Return Pr(attribute is true) (N,) by what was told of an object in its trials.

    NaN where labels tell nothing of an attribute; None where none was told of the object.
    """
    o = record.objects.get(object_name, NONE)
    columns = record.domain.columns(query.attributes)
    rows = record.labels_by_trial(o)[:, columns]
    if not (rows >= 0).any():
        return None
    told = [record.labels_by_trial(other)[:, columns] for other in _told_twice(record)]
    shape = (len(told), len(columns))
    yes = np.array([(labels == 1).sum(axis=0) for labels in told], np.int64).reshape(shape)
    no = np.array([(labels == 0).sum(axis=0) for labels in told], np.int64).reshape(shape)
    votes = (rows == 1).sum(axis=0) - (rows == 0).sum(axis=0)
    return prob_true(learn_trust(yes, no), votes.astype(np.int64))


def _told_twice(record: Experience) -> list[int]:
    """Return the objects of which labels were told in two trials or more, by their numbers."""
    feedback = record.feedback.values
    pairs = np.unique(np.stack([feedback["object"], feedback["trial"]], axis=1), axis=0)
    objects, trials = np.unique(pairs[:, 0], return_counts=True)
    return [int(o) for o in objects[trials > 1]]

"""Confusion counts (O,P,E,2,K): how often each object showed each percept level, by its truth.

Counts are kept for each object, because percepts of one object are not independent (see
`posterior.grid`). One labeled instance is one count.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import check_place, yes_of
from meal_bayes.datasets.percepts import PerceptTable


def by_truth(levels: NDArray[np.int64], labels: NDArray[np.int8]) -> NDArray[np.int64]:
    """Assign level counts (O,P,E,K) to the rows of the objects' known labels (O,P)."""
    rows = np.stack([labels == 0, labels == 1], axis=-1)  # (O,P,2)
    return np.asarray(levels[:, :, :, None, :] * rows[:, :, None, :, None], np.int64)


def table_counts(table: PerceptTable, held_out: int, *, levels: int = 2) -> NDArray[np.int64]:
    """Return the counts of the training objects for a held-out object.

    The counts of object o' come from classifiers that were trained on neither `held_out` nor o'.
    The counts of the held-out object are zero, and unknown labels do not count.

    Parameters
    ----------
    table : PerceptTable
        Percept table with O objects.
    held_out : int
        Position of the held-out object in `table.objects`.
    levels : int
        Number K of levels of a percept.

    Returns
    -------
    NDArray[np.int64]
        (O,P,E,2,K) number of percepts by object, attribute, behavior, truth and level.
    """
    check_place("held_out", held_out, len(table.objects))
    return by_truth(table.training_levels(held_out, levels), table.labels)


def percept_counts(table: PerceptTable, levels: int) -> NDArray[np.int64]:
    """Count each object's percepts (O,P,E,2,K) by classifiers that were not trained on it."""
    level = table.levels_of(table.log_odds, levels)  # (O,R,E,P)
    computed = ~np.isnan(table.log_odds)
    is_level = (level[..., None] == np.arange(levels)) & computed[..., None]
    return by_truth(is_level.sum(axis=1).swapaxes(1, 2), table.labels)


def youden(counts: NDArray[Any]) -> NDArray[np.float64]:
    """Return Youden's J = TPR - FPR (...) of counts (...,2,K) [truth, level]; 0 where undefined.

    Leaving out a true object lowers the base rate of the training set, so an uninformative
    classifier predicts the opposite of the held-out label. Counts with J < 0 then look like those
    of a perfect sensor with inverted output.
    """
    number = counts.sum(axis=-1)
    rates = yes_of(counts) / np.where(number > 0, number, 1.0)
    return np.where((number > 0).all(axis=-1), rates[..., 1] - rates[..., 0], 0.0)


def informative(counts: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether Youden's J of counts (...,2,K) is above 0, (...).

    Percepts of other pairs do not change the belief, and are not used to learn common priors.
    """
    return np.asarray(youden(counts) > 0)

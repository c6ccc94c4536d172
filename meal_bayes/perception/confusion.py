"""Confusion counts (O,P,E,2,K): how often each object showed each percept level, by its truth.

They are kept object by object, as percepts of one object are not independent (see the posterior's
dispersion). One labeled instance is one count.
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
    """Return training-side counts for a held-out object, by classifiers that never saw it.

    The row of object o' comes from classifiers that saw neither `held_out` nor o'; the held-out
    row is zero, and unknown labels do not count.

    Parameters
    ----------
    table : PerceptTable
        Of O objects.
    held_out : int
        Place of the object in `table.objects`.
    levels : int
        K, of a percept.

    Returns
    -------
    NDArray[np.int64]
        (O,P,E,2,K) percepts by object, attribute, behavior, truth and level.
    """
    check_place("held_out", held_out, len(table.objects))
    return by_truth(table.training_levels(held_out, levels), table.labels)


def percept_counts(table: PerceptTable, levels: int) -> NDArray[np.int64]:
    """Count each object's percepts (O,P,E,2,K) by classifiers that never saw it."""
    level = table.levels_of(table.log_odds, levels)  # (O,R,E,P)
    computed = ~np.isnan(table.log_odds)
    is_level = (level[..., None] == np.arange(levels)) & computed[..., None]
    return by_truth(is_level.sum(axis=1).swapaxes(1, 2), table.labels)


def youden(counts: NDArray[Any]) -> NDArray[np.float64]:
    """Return Youden's J = TPR - FPR (...) of counts (...,2,K) [truth, level]; 0 where undefined.

    Leaving a positive object out lowers the base rate, so an uninformative classifier votes against
    the held-out label: a table of J < 0 looks like a perfect, inverted sensor.
    """
    number = counts.sum(axis=-1)
    rates = yes_of(counts) / np.where(number > 0, number, 1.0)
    return np.where((number > 0).all(axis=-1), rates[..., 1] - rates[..., 0], 0.0)


def informative(counts: NDArray[Any]) -> NDArray[np.bool_]:
    """Return whether percepts of counts (...,2,K) tell anything (...): Youden's J above 0.

    All that counts percepts asks this; what tells nothing is at even odds, and has no vote.
    """
    return np.asarray(youden(counts) > 0)

"""Confusion counts per object: percepts of objects whose truth is known."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets.percepts import PerceptTable
from meal_bayes.display import short_repr
from meal_bayes.errors import DataError


@dataclass(frozen=True, slots=True)
class ConfusionCounts:
    """How often each object showed each percept level, by its true value.

    Kept object by object, as percepts of one object are not independent (see the posterior's
    dispersion). One labelled instance is one count.

    Attributes
    ----------
    counts : NDArray[np.int64]
        (O,P,E,2,K) [truth, level].
    """

    counts: NDArray[np.int64]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        set_frozen(self, counts=freeze(self.counts, np.int64))
        if self.counts.ndim != 5 or self.counts.shape[3] != 2:
            raise DataError(
                f"Confusion counts have shape {self.counts.shape}; expected (O,P,E,2,K)."
            )

    @property
    def levels(self) -> int:
        """K, the number of percept levels."""
        return int(self.counts.shape[-1])

    def total(self) -> NDArray[np.int64]:
        """Sum over the objects, (P,E,2,K)."""
        return freeze(self.counts.sum(axis=0), np.int64)


def cohens_kappa(table: NDArray[Any]) -> NDArray[np.float64]:
    """Return Cohen's kappa (...) of counts (...,2,2) [truth, yes]; 0 where it is undefined."""
    number = table.sum(axis=-1)
    everything = np.maximum(number.sum(axis=-1), 1)
    agree = (table[..., 1, 1] + table[..., 0, 0]) / everything
    p_yes, p_true = table[..., 1].sum(axis=-1) / everything, number[..., 1] / everything
    chance = p_yes * p_true + (1 - p_yes) * (1 - p_true)
    defined = (number.min(axis=-1) > 0) & (chance < 1)
    return np.where(defined, (agree - chance) / np.where(chance < 1, 1 - chance, 1), 0.0)


def by_truth(levels: NDArray[np.int64], labels: NDArray[np.int8]) -> ConfusionCounts:
    """Assign level counts (O,P,E,K) to the rows of the objects' known labels (O,P)."""
    rows = np.stack([labels == 0, labels == 1], axis=-1)  # (O,P,2)
    return ConfusionCounts(levels[:, :, :, None, :] * rows[:, :, None, :, None])


def table_counts(table: PerceptTable, held_out: int, *, levels: int = 2) -> ConfusionCounts:
    """Return training-side counts for a held-out object, by classifiers that never saw it.

    The row of object o' comes from classifiers that saw neither `held_out` nor o'; the held-out
    row is zero, and unknown labels do not count.
    """
    return by_truth(table.training_levels(held_out, levels), table.labels)


def youden(counts: NDArray[Any]) -> NDArray[np.float64]:
    """Return Youden's J = TPR - FPR (...) of counts (...,2,K) [truth, level]; 0 where undefined.

    The upper half of the levels is "yes". Leaving a positive object out lowers the base rate, so an
    uninformative classifier votes against the held-out label: a table of J < 0 looks like a
    perfect, inverted sensor.
    """
    number = counts.sum(axis=-1)
    yes = counts[..., counts.shape[-1] // 2 :].sum(axis=-1)
    rates = yes / np.where(number > 0, number, 1.0)
    return np.where((number > 0).all(axis=-1), rates[..., 1] - rates[..., 0], 0.0)

"""What a robot knows when it meets an object it has never learned from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Domain
from meal_bayes.perception import ConfusionCounts, table_counts
from meal_bayes.posterior import ConfusionPosterior


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Confusion posterior and base rates, learned without the object at hand."""

    domain: Domain
    posterior: ConfusionPosterior
    base_rates: NDArray[np.float64]  # (P,) (n+ + 1) / (n + 2) of the training objects

    def __post_init__(self) -> None:
        set_frozen(self, base_rates=freeze(self.base_rates))


def knowledge_without(
    table: PerceptTable, held_out: int, *, levels: int = 2, object_level: bool = True
) -> Knowledge:
    """Learn from every object but one: its recordings and labels enter nowhere.

    Parameters
    ----------
    table : held-out percepts of a data set.
    held_out : index of the object that is left out.
    levels : K of the percepts.
    object_level : let objects differ from each other (ours), or take all percepts as independent
        (the paper).
    """
    counts = table_counts(table, held_out, levels=levels)
    return Knowledge(
        table.domain, _posterior(counts, object_level), _base_rates(table.labels, held_out)
    )


def _posterior(counts: ConfusionCounts, object_level: bool) -> ConfusionPosterior:
    if object_level:
        return ConfusionPosterior.from_objects(counts)
    return ConfusionPosterior.from_counts(counts)


def _base_rates(labels: NDArray[np.int8], held_out: int) -> NDArray[np.float64]:
    others = np.delete(labels, held_out, axis=0)
    positive, known = (others == 1).sum(axis=0), (others >= 0).sum(axis=0)
    return np.asarray((positive + 1) / (known + 2))

"""What a robot knows when it meets an object it has never learned from."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Domain
from meal_bayes.perception import table_counts
from meal_bayes.posterior import ConfusionPosterior, SharedDegree, learn_degree


@dataclass(frozen=True, slots=True)
class Knowledge:
    """Confusion posterior and base rates, learned without the object at hand."""

    domain: Domain
    posterior: ConfusionPosterior
    base_rates: NDArray[np.float64]  # (P,) (n+ + 1) / (n + 2) of the training objects
    degree: SharedDegree | None = None  # what all percepts of an object share; None: only the truth

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
    object_level : let objects differ from each other and percepts of one object err together
        (ours), or take all percepts as independent (the paper).
    """
    counts = table_counts(table, held_out, levels=levels)
    base_rates = _base_rates(table.labels, held_out)
    if not object_level:
        return Knowledge(table.domain, ConfusionPosterior.from_counts(counts), base_rates)
    posterior = ConfusionPosterior.from_objects(counts)
    shown = table.training_levels(held_out, levels)  # the held-out object's row is zero
    degree = learn_degree(posterior, shown, table.labels, base_rates)
    return Knowledge(table.domain, posterior, base_rates, degree)


def _base_rates(labels: NDArray[np.int8], held_out: int) -> NDArray[np.float64]:
    others = np.delete(labels, held_out, axis=0)
    positive, known = (others == 1).sum(axis=0), (others >= 0).sum(axis=0)
    return np.asarray((positive + 1) / (known + 2))

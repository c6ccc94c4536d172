"""What a robot knows of an object that it was not trained on."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import FrozenArrays
from meal_bayes.datasets import PerceptTable
from meal_bayes.display import best_html, percent, short_repr
from meal_bayes.domain import Domain
from meal_bayes.perception import table_counts
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.trait import SharedTrait, learn_trait


@dataclass(frozen=True, slots=True)
class Knowledge(FrozenArrays):
    """Confusion posterior and base rates, learned without the object at hand.

    Attributes
    ----------
    domain : Domain
        Of the attributes and behaviors.
    posterior : ConfusionPosterior
        Of the confusion matrices.
    base_rates : NDArray[np.float64]
        (P,) (n+ + 1) / (n + 2) of the training objects.
    trait : SharedTrait | None
        Latent trait that percepts of an object share; None: they share the truth alone.
    """

    domain: Domain
    posterior: ConfusionPosterior
    base_rates: NDArray[np.float64]
    trait: SharedTrait | None = None

    __repr__ = short_repr

    def _repr_html_(self) -> str:
        """Return what each behavior tells of each attribute, TPR - FPR of the mean, as HTML."""
        names = zip(self.domain.attributes, map(percent, self.base_rates), strict=True)
        header = ("attribute", "Pr", *self.domain.behavior_names)
        title = f"{self.domain.name}: TPR - FPR of each behavior that was perceived"
        return best_html(title, header, names, self.posterior.youden)


def knowledge_without(
    table: PerceptTable, held_out: int, *, levels: int = 2, object_level: bool = True
) -> Knowledge:
    """Learn from every object but one: its recordings and labels enter nowhere.

    Parameters
    ----------
    table : PerceptTable
        Held-out percepts of a data set.
    held_out : int
        Index of the object that is left out.
    levels : int
        K of the percepts.
    object_level : bool
        Let objects differ from each other and percepts of one object err together (ours), or take
        all percepts as independent (the paper).
    """
    counts = table_counts(table, held_out, levels=levels)
    labels = table.labels.copy()
    labels[held_out] = -1
    return knowledge_of(table.domain, counts, labels, object_level=object_level)


def knowledge_of(
    domain: Domain,
    counts: NDArray[np.int64],
    labels: NDArray[np.int8],
    *,
    object_level: bool = True,
) -> Knowledge:
    """Learn from percepts of held-out classifiers, and labels (O,P) of the objects; -1 unknown.

    Counts are (O,P,E,2,K). Of objects in no training set all labels are unknown; `object_level` is
    as in `knowledge_without`.
    """
    rates = base_rates(labels)
    if not object_level:
        return Knowledge(domain, ConfusionPosterior.from_counts(counts), rates)
    posterior = ConfusionPosterior.from_objects(counts)
    percepts = counts.sum(axis=3)  # (O,P,E,K)
    return Knowledge(domain, posterior, rates, learn_trait(posterior, percepts, labels, rates))


def base_rates(labels: NDArray[np.int8]) -> NDArray[np.float64]:
    """Compute the posterior mean of Pr(attribute), (P,), from labels (O,P) of objects."""
    return np.asarray(((labels == 1).sum(axis=0) + 1) / ((labels >= 0).sum(axis=0) + 2))

"""What a robot knows of an object that it was not trained on."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents.base_rates import BaseRates, learn_base_rates
from meal_bayes.arrays import FrozenArrays, check_place, no_and_yes_of
from meal_bayes.datasets import PerceptTable
from meal_bayes.domain import Domain
from meal_bayes.look import short_repr
from meal_bayes.perception import table_counts
from meal_bayes.posterior import ConfusionPosterior
from meal_bayes.posterior.trait import SharedTrait, learn_trait

if TYPE_CHECKING:
    import pandas as pd


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
        (P,) Pr(attribute) of a new object; over the values of a group they sum to 1.
    labels : NDArray[np.int8]
        (O,P) of the labeled objects, -1 unknown, which say which attributes exclude or imply each
        other.
    trait : SharedTrait | None
        Latent trait that percepts of an object share; None: they share the truth alone.
    rates : BaseRates | None
        Posterior of the base rates, of which `base_rates` are the means; None: they are known.
    """

    domain: Domain
    posterior: ConfusionPosterior
    base_rates: NDArray[np.float64]
    labels: NDArray[np.int8]
    trait: SharedTrait | None = None
    rates: BaseRates | None = None

    __repr__ = short_repr

    def to_frame(self) -> "pd.DataFrame":
        """Return a pandas data frame with a row for each attribute and its best behavior.

        Columns are `base_rate`; `behavior`, of the largest Youden's J among those that were
        perceived, None where none tells anything; `youden`, how often its percepts say yes where
        that is true, less where it is not; and `right`, how often they are right at the base rate.
        """
        import pandas as pd  # noqa: PLC0415  takes half a second

        names = ("base_rate", "behavior", "youden", "right")
        rows = []
        for attribute, rate in enumerate(self.base_rates.tolist()):
            best = self.most_telling(attribute)
            rows.append((rate, *(best or (None, np.nan, np.nan))))
        index = pd.Index(self.domain.attributes, name="attribute")
        return pd.DataFrame(rows, index=index, columns=list(names))

    def most_telling(self, attribute: int) -> tuple[str, float, float] | None:
        """Return the behavior that tells most of an attribute, Youden's J, and Pr(right).

        None where no behavior tells anything.
        """
        informative = self.posterior.informative[attribute]
        if not informative.any():
            return None
        youden = np.where(informative, self.posterior.youden[attribute], -np.inf)
        best = int(youden.argmax())
        rows = self.posterior.mean[attribute, best]  # (2,K) [truth, level]
        said = no_and_yes_of(rows)  # (2,2) [truth, no and yes]
        rate = float(self.base_rates[attribute])
        accuracy = float(rate * said[1, 1] + (1.0 - rate) * said[0, 0])
        return self.domain.behavior_names[best], float(youden[best]), accuracy

    def with_labels(self, labels: NDArray[np.int8], *, pool: bool = True) -> "Knowledge":
        """Return the same knowledge with the priors that labels (O,P) tell.

        Unless they are to `pool` rates anew, how far these are pooled stays as it was learned.
        """
        weights = None if pool or self.rates is None else self.rates.weights
        accuracy = 1.0 if self.rates is None else self.rates.label_accuracy
        rates = learn_base_rates(self.domain, labels, weights, accuracy)
        return replace(self, base_rates=rates.mean, labels=_labeled(labels), rates=rates)


def knowledge_without(
    table: PerceptTable,
    held_out: int,
    *,
    levels: int = 2,
    object_level: bool = True,
    unlabeled: Sequence[int] = (),
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
    unlabeled : Sequence[int]
        Indices of further objects of which no label is known.
    """
    counts = table_counts(table, held_out, levels=levels)
    labels = table.labels.copy()
    labels[held_out] = -1
    for o in unlabeled:
        check_place("unlabeled", o, len(labels))
        counts[o] = 0  # percepts are counted by the truth
        labels[o] = -1
    return knowledge_of(table.domain, counts, labels, object_level=object_level)


def knowledge_of(
    domain: Domain,
    counts: NDArray[np.int64],
    labels: NDArray[np.int8],
    *,
    object_level: bool = True,
    given: NDArray[np.bool_] | None = None,
    label_accuracy: float = 1.0,
) -> Knowledge:
    """Learn from percepts of held-out classifiers, and labels (O,P) of the objects; -1 unknown.

    Counts are (O,P,E,2,K). Of objects in no training set all labels are unknown; `object_level` is
    as in `knowledge_without`, `given` as in `ConfusionPosterior.from_objects`, and `label_accuracy`
    as in `learn_base_rates`.
    """
    rates = learn_base_rates(domain, labels, label_accuracy=label_accuracy)
    mean = rates.mean
    labeled = _labeled(labels)
    if not object_level:
        posterior = ConfusionPosterior.from_counts(counts)
        return Knowledge(domain, posterior, mean, labeled, rates=rates)
    posterior = ConfusionPosterior.from_objects(counts, given=given)
    percepts = counts.sum(axis=3)  # (O,P,E,K)
    trait = learn_trait(posterior, percepts, labels, mean)
    return Knowledge(domain, posterior, mean, labeled, trait, rates)


def _labeled(labels: NDArray[np.int8]) -> NDArray[np.int8]:
    """Return the rows of objects of which something is known."""
    return labels[(labels >= 0).any(axis=1)]

"""What a robot knows about an object on which it was not trained."""

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
    """Confusion posterior and base rates, learned without the object in the question.

    Attributes
    ----------
    domain : Domain
        Domain with the attributes and behaviors.
    posterior : ConfusionPosterior
        Posterior of the confusion matrices.
    base_rates : NDArray[np.float64]
        (P,) prior probability that each attribute of a new object is true. The probabilities of a
        group's values sum to 1.
    labels : NDArray[np.int8]
        (O,P) label of each labeled object and attribute: 1 true, 0 false, -1 unknown. The labels
        show which attributes exclude or imply each other.
    trait : SharedTrait | None
        Latent trait on which all percepts of an object depend; None if percepts are independent
        given the truth.
    rates : BaseRates | None
        Posterior of the base rates; its means are `base_rates`. None if the rates are known.
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

        Columns are `base_rate`; `behavior`, the behavior with the largest Youden's J, or None if no
        behavior is informative; `youden`, the true positive rate of its percepts minus the false
        positive rate; and `right`, the probability that a percept is right, given the base rate.
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
        """Return the behavior with the largest Youden's J for an attribute, this J, and Pr(right).

        The result is None if no behavior is informative.
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
        """Return the same knowledge with priors that are learned from labels (O,P).

        If `pool` is False, the weights with which base rates are pooled do not change.
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
    """Learn from all objects except one; its recordings and labels are not used.

    Parameters
    ----------
    table : PerceptTable
        Held-out percepts of a data set.
    held_out : int
        Index of the object that is left out.
    levels : int
        Number K of levels of percepts.
    object_level : bool
        Whether objects have their own confusion matrices and percepts of one object have dependent
        errors. If False, all percepts are independent given the truth, as in the paper.
    unlabeled : Sequence[int]
        Indices of further objects whose labels are treated as unknown.
    """
    counts = table_counts(table, held_out, levels=levels)
    labels = table.labels.copy()
    labels[held_out] = -1
    for o in unlabeled:
        check_place("unlabeled", o, len(labels))
        counts[o] = 0  # percepts without a known truth cannot be counted
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
    """Learn from counts of percepts by held-out classifiers, and labels of the objects.

    Counts are (O,P,E,2,K) and labels (O,P), -1 unknown; an object that is in no training set has
    only unknown labels. `object_level` is as in `knowledge_without`, `given` as in
    `ConfusionPosterior.from_objects`, and `label_accuracy` as in `learn_base_rates`.
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
    """Return the rows of objects with at least one known label."""
    return labels[(labels >= 0).any(axis=1)]

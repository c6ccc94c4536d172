"""Perceivers: percepts of executed behaviors, from classifiers, percept tables or random draws.

If a behavior asks a person, the simulated person knows the labels.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Bools, Floats, FrozenArrays, Levels, tiny_is_zero
from meal_bayes.datasets import Instance
from meal_bayes.datasets.percepts import PerceptTable, classifier_levels, round_log_odds
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import DataError, SettingsError
from meal_bayes.look import short_repr
from meal_bayes.perception.feature_spaces import FeatureSpace


@runtime_checkable
class Perceiver(Protocol):
    """Source of the percepts of an executed behavior: an object with the method `observe`.

    Examples
    --------
    >>> import meal_bayes
    >>> class Nothing:
    ...     def observe(self, instance, query, rng):
    ...         return None
    >>> isinstance(Nothing(), meal_bayes.Perceiver)
    True
    """

    @tiny_is_zero
    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels | None:
        """Return percept levels (N,) of the queried attributes, from 0 (no) to K-1 (yes).

        Parameters
        ----------
        instance : Instance
            The executed behavior with the features or the recording that it gave.
        query : Query
            The question, about N attributes.
        rng : np.random.Generator
            Random generator to use.

        Returns
        -------
        levels : Levels | None
            (N,) percept levels; -1 for attributes without a percept. The value is None if the
            behavior yields no percept of any queried attribute.
        """
        ...


def answer(
    labels: NDArray[np.int8], accuracy: float, levels: int, rng: np.random.Generator
) -> Levels:
    """Draw a person's answer about N attributes, each right with probability `accuracy`.

    Yes and no are the two extreme levels. For unknown attributes (label -1), the answer is yes or
    no with probability 1/2.
    """
    # Always draw both, so that the state of the generator does not depend on the labels.
    is_right = rng.random(len(labels)) < accuracy
    coin = rng.random(len(labels)) < 0.5
    yes = np.where(labels < 0, coin, (labels == 1) == is_right)
    return np.where(yes, levels - 1, 0).astype(np.int8)


def person_says(
    domain: Domain,
    labels: NDArray[np.int8],
    instance: Instance,
    query: Query,
    *,
    levels: int,
    rng: np.random.Generator,
) -> Levels | None:
    """Draw a person's answer from labels (O,P); return None if the behavior asks no person."""
    accuracy = domain.behaviors[domain.behavior_index(instance.behavior)].answer_accuracy
    if accuracy is None:
        return None
    truth = labels[instance.object_index, domain.columns(query.attributes)]
    return answer(truth, accuracy, levels, rng)


@dataclass(frozen=True, slots=True)
class RecordedPercepts:
    """Percepts of recordings by classifiers that were not trained on the recorded object.

    Attributes
    ----------
    table : PerceptTable
        Outputs of the classifiers, and the labels from which a person's answers are taken.
    levels : int
        Number K of levels of a percept.
    """

    table: PerceptTable
    levels: int = 2

    @tiny_is_zero
    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels:
        """Return the levels of the classifier outputs, or a person's answer, (N,).

        Raises
        ------
        SettingsError
            If the table has no outputs for the recording.
        """
        table = self.table
        domain = self.table.domain
        said = person_says(domain, table.labels, instance, query, levels=self.levels, rng=rng)
        if said is not None:
            return said
        e = domain.behavior_index(instance.behavior)
        columns = domain.columns(query.attributes)
        log_odds = table.log_odds[instance.object_index, instance.recording, e, columns]
        if np.isnan(log_odds).any():
            missing = np.array(query.attributes)[np.isnan(log_odds)].tolist()
            raise SettingsError(
                f"The percept table has no percepts of {missing} by {instance.behavior!r} for "
                f"object {instance.object_index}; build the table again."
            )
        return table.levels_of(log_odds, self.levels)


@dataclass(frozen=True, slots=True)
class SampledPercepts(FrozenArrays):
    """Percepts drawn from the confusion matrices themselves.

    The authors' published simulator does this. Accuracies that are measured in this way do not test
    the observation model.

    Attributes
    ----------
    domain : Domain
        Domain with the behaviors and attributes.
    labels : NDArray[np.int8]
        (O,P) labels: 1 for true, 0 for false, -1 for unknown.
    confusion : NDArray[np.float64]
        (P,E,2,K) confusion matrix of each attribute and behavior; the row of each truth sums to 1.
    """

    domain: Domain
    labels: NDArray[np.int8]
    confusion: NDArray[np.float64]

    @tiny_is_zero
    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels:
        """Draw each level from the row of the true value, or draw a person's answer.

        If the true value is unknown, it is first drawn: true or false, with probability 1/2 each.
        """
        levels = self.confusion.shape[-1]
        said = person_says(self.domain, self.labels, instance, query, levels=levels, rng=rng)
        if said is not None:
            return said
        behavior = self.domain.behavior_index(instance.behavior)
        columns = self.domain.columns(query.attributes)
        labels = self.labels[instance.object_index, columns]
        truth = np.where(labels < 0, rng.integers(2, size=len(labels)), labels)
        # Invert the cumulative distribution of the rows: the level is the number of lower edges.
        edges = np.cumsum(self.confusion[columns, behavior, truth], axis=-1)[:, :-1]
        return np.asarray((rng.random((len(edges), 1)) >= edges).sum(axis=-1), np.int8)


@dataclass(frozen=True, slots=True)
class BehaviorClassifier(FrozenArrays):
    """The fitted classifiers Psi(f_a, .) of one behavior.

    Attributes
    ----------
    spaces : Mapping[str, FeatureSpace]
        Feature spaces by modality.
    fit : Any
        A `KernelFit` or `ClassifierFit`, which scores rows of the spaces.
    used : Bools
        (P,) attributes for which the outputs are used; for all others, log-odds are 0.
    """

    spaces: Mapping[str, FeatureSpace]
    fit: Any
    used: Bools

    __repr__ = short_repr

    def log_odds(self, features: Mapping[str, NDArray[np.floating]]) -> Floats:
        """Return the log-odds of all attributes, (B,P), for raw features {modality: (B,D)}."""
        rows = [
            space.standardize(features[modality]) if modality in features else None
            for modality, space in self.spaces.items()
        ]
        return np.where(self.used, self.fit.scored(list(self.spaces.values()), rows), 0.0)


@dataclass(frozen=True, slots=True)
class Perception(FrozenArrays):
    """The fitted classifiers Psi of all behaviors; a `Perceiver`.

    Percepts of a behavior without an instance in the training set have even odds.

    Attributes
    ----------
    domain : Domain
        Domain with the behaviors and attributes.
    classifiers : Mapping[str, BehaviorClassifier]
        Classifiers by behavior.
    labels : NDArray[np.int8]
        (O,P) label of each object and attribute. Only answers of a person use the labels.
    levels : int
        Number K of levels of a percept.
    """

    domain: Domain
    classifiers: Mapping[str, BehaviorClassifier]
    labels: NDArray[np.int8]
    levels: int = 2

    __repr__ = short_repr

    def log_odds(self, instance: Instance, query: Query) -> Floats:
        """Return the log-odds of "true", (N,), for an instance of a behavior that senses.

        Only the modalities with finite features in the instance are used.

        Raises
        ------
        DataError
            If no modality of the behavior has finite features.
        """
        classifier = self.classifiers.get(instance.behavior)
        if classifier is None:
            return np.zeros(len(query))
        features = {
            name: np.asarray(values)[None]
            for name, values in (instance.features or {}).items()
            if name in classifier.spaces and np.isfinite(values).all()
        }
        if not features:
            raise DataError(
                f"An instance of {instance.behavior!r} has no finite features; give features of "
                f"at least one of the modalities {list(classifier.spaces)}."
            )
        columns = self.domain.columns(query.attributes)
        return round_log_odds(classifier.log_odds(features)[0, columns]).astype(np.float64)

    @tiny_is_zero
    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels:
        """Return percept levels of the queried attributes, (N,), or a person's answer."""
        said = person_says(self.domain, self.labels, instance, query, levels=self.levels, rng=rng)
        if said is not None:
            return said
        return classifier_levels(self.log_odds(instance, query), self.levels)

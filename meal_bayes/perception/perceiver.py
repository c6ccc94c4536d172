"""Perceivers: what an executed behavior shows, by classifiers, scored recordings or draws.

Behaviors that ask are answered by a person, who knows the labels.
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
    """Source of the percepts of an executed behavior.

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
            (N,) percept levels; -1 for attributes without a percept. None if no attribute has a
            percept.
        """
        ...


def answer(
    labels: NDArray[np.int8], accuracy: float, levels: int, rng: np.random.Generator
) -> Levels:
    """Draw a person's answer on N attributes, each right with `accuracy`.

    Yes and no are the two extreme levels. Unknown attributes (label -1) are answered by a fair
    coin.
    """
    # Both are drawn always, so that the stream stands at one place whatever is known.
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
    """Draw the answer of a person who knows labels (O,P); None of behaviors that do not ask."""
    accuracy = domain.behaviors[domain.behavior_index(instance.behavior)].answer_accuracy
    if accuracy is None:
        return None
    truth = labels[instance.object_index, domain.columns(query.attributes)]
    return answer(truth, accuracy, levels, rng)


@dataclass(frozen=True, slots=True)
class RecordedPercepts:
    """Percepts of real recordings, by classifiers that never saw the object.

    Attributes
    ----------
    table : PerceptTable
        Outputs of the classifiers, and what a person knows who is asked.
    levels : int
        K.
    """

    table: PerceptTable
    levels: int = 2

    @tiny_is_zero
    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels:
        """Return the levels of the outputs, or a person's answer, (N,).

        Raises
        ------
        SettingsError
            A recording that was not scored.
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
                f"No percepts of {missing} by {instance.behavior!r} were computed for object "
                f"{instance.object_index}; build the table again."
            )
        return table.levels_of(log_odds, self.levels)


@dataclass(frozen=True, slots=True)
class SampledPercepts(FrozenArrays):
    """Percepts drawn from the confusion matrices themselves.

    The authors' published simulator does so; accuracies obtained from it do not test the model.

    Attributes
    ----------
    domain : Domain
        Behaviors and attributes.
    labels : NDArray[np.int8]
        (O,P) 1 true, 0 false, -1 unknown.
    confusion : NDArray[np.float64]
        (P,E,2,K) rows = truth, sum to 1.
    """

    domain: Domain
    labels: NDArray[np.int8]
    confusion: NDArray[np.float64]

    @tiny_is_zero
    def observe(self, instance: Instance, query: Query, rng: np.random.Generator) -> Levels:
        """Draw each level from the row of the true value (of a coin if unknown), or an answer."""
        levels = self.confusion.shape[-1]
        said = person_says(self.domain, self.labels, instance, query, levels=levels, rng=rng)
        if said is not None:
            return said
        behavior = self.domain.behavior_index(instance.behavior)
        columns = self.domain.columns(query.attributes)
        labels = self.labels[instance.object_index, columns]
        truth = np.where(labels < 0, rng.integers(2, size=len(labels)), labels)
        # Inverse of the rows' cumulative distribution: the level is how many edges lie below.
        edges = np.cumsum(self.confusion[columns, behavior, truth], axis=-1)[:, :-1]
        return np.asarray((rng.random((len(edges), 1)) >= edges).sum(axis=-1), np.int8)


@dataclass(frozen=True, slots=True)
class BehaviorClassifier(FrozenArrays):
    """Psi(f_a, .): a fitted behavior, the spaces of its modalities, and which attributes are used.

    The fit is a `KernelFit` or `ClassifierFit`, which scores rows of the spaces. Log-odds are 0 of
    attributes that are not used, (P,).
    """

    spaces: Mapping[str, FeatureSpace]
    fit: Any
    used: Bools

    __repr__ = short_repr

    def log_odds(self, features: Mapping[str, NDArray[np.floating]]) -> Floats:
        """Return log-odds of all attributes, (B,P), of raw features {modality: (B,D)}."""
        rows = [
            space.standardize(features[modality]) if modality in features else None
            for modality, space in self.spaces.items()
        ]
        return np.where(self.used, self.fit.scored(list(self.spaces.values()), rows), 0.0)


@dataclass(frozen=True, slots=True)
class Perception(FrozenArrays):
    """The fitted Psi of all behaviors; a `Perceiver`.

    Percepts of a behavior without an instance in the training set are at even odds.

    Attributes
    ----------
    domain : Domain
        Behaviors and attributes.
    classifiers : Mapping[str, BehaviorClassifier]
        By behavior.
    labels : NDArray[np.int8]
        (O,P) from which a person answers; nothing else uses them.
    levels : int
        Number of levels of its percepts, K.
    """

    domain: Domain
    classifiers: Mapping[str, BehaviorClassifier]
    labels: NDArray[np.int8]
    levels: int = 2

    __repr__ = short_repr

    def log_odds(self, instance: Instance, query: Query) -> Floats:
        """Return log-odds of "true", (N,), of a behavior that senses.

        They are those of the behavior's modalities that the instance has; others are ignored.

        Raises
        ------
        DataError
            An instance without finite features of any of the behavior's modalities.
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
                f"An instance of {instance.behavior!r} has finite features of none of "
                f"{list(classifier.spaces)}; one is enough."
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

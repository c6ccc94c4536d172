"""Perceivers: what an executed behavior shows; scored recordings, draws, a person's answers."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import FrozenArrays
from meal_bayes.datasets import Instance
from meal_bayes.datasets.percepts import PerceptTable
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError


class Perceiver(Protocol):
    """Source of the percepts of an executed behavior."""

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return percept levels (N,) of the queried attributes, from 0 (no) to K-1 (yes)."""
        ...


def answer(
    labels: NDArray[np.int8], accuracy: float, levels: int, rng: np.random.Generator
) -> NDArray[np.int8]:
    """Draw a person's answer on N attributes, each right with `accuracy`.

    Yes and no are the two extreme levels. Unknown attributes (label -1) are answered by a fair
    coin.
    """
    right = rng.random(len(labels)) < accuracy
    coin = rng.random(len(labels)) < 0.5
    yes = np.where(labels < 0, coin, (labels == 1) == right)
    return np.where(yes, levels - 1, 0).astype(np.int8)


def person_says(
    domain: Domain, labels: NDArray[np.int8], instance: Instance, query: Query, levels: int,
    rng: np.random.Generator,
) -> NDArray[np.int8] | None:  # fmt: skip
    """Draw the answer of a person who knows labels (O,P); None of behaviors that do not ask."""
    accuracy = domain.behaviors[domain.behavior_index(instance.behavior)].answer_accuracy
    if accuracy is None:
        return None
    return answer(
        labels[instance.object_index, domain.columns(query.attributes)], accuracy, levels, rng
    )


@dataclass(frozen=True, slots=True)
class RecordedPercepts:
    """Percepts of real recordings, by classifiers that never saw the object.

    Attributes
    ----------
    table : PerceptTable
        Outputs of the classifiers, and what a person knows who is asked.
    """

    table: PerceptTable
    levels: int = 2

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return the levels of the outputs, or a person's answer, (N,).

        Raises
        ------
        SettingsError
            A recording that was not scored.
        """
        table, domain = self.table, self.table.domain
        said = person_says(domain, table.labels, instance, query, self.levels, rng)
        if said is not None:
            return said
        e, columns = domain.behavior_index(instance.behavior), domain.columns(query.attributes)
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
    labels : NDArray[np.int8]
        (O,P) 1 true, 0 false, -1 unknown.
    confusion : NDArray[np.float64]
        (P,E,2,K) rows = truth, sum to 1.
    """

    domain: Domain
    labels: NDArray[np.int8]
    confusion: NDArray[np.float64]

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Draw each level from the row of the true value (of a coin if unknown), or an answer."""
        levels = self.confusion.shape[-1]
        said = person_says(self.domain, self.labels, instance, query, levels, rng)
        if said is not None:
            return said
        behavior = self.domain.behavior_index(instance.behavior)
        columns = self.domain.columns(query.attributes)
        labels = self.labels[instance.object_index, columns]
        truth = np.where(labels < 0, rng.integers(2, size=len(labels)), labels)
        edges = np.cumsum(self.confusion[columns, behavior, truth], axis=-1)[:, :-1]
        return np.asarray((rng.random((len(edges), 1)) >= edges).sum(axis=-1), np.int8)

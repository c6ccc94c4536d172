"""Percepts of an execution: recorded outputs, random draws, or a person's answer."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Instance
from meal_bayes.datasets.percepts import BIN_EDGES, PerceptTable, level_edges, levels_of
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import DataError, SettingsError


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
    """Draw a person's answer on N attributes, the whole right with `accuracy`.

    Each attribute is right with accuracy^(1/N); yes and no are the two extreme levels. Unknown
    attributes (label -1) are answered by a fair coin.
    """
    right = rng.random(len(labels)) < accuracy ** (1.0 / len(labels))
    coin = rng.random(len(labels)) < 0.5  # noqa: PLR2004
    yes = np.where(labels < 0, coin, (labels == 1) == right)
    return np.where(yes, levels - 1, 0).astype(np.int8)


def person_says(
    domain: Domain,
    labels: NDArray[np.int8],
    instance: Instance,
    query: Query,
    levels: int,
    rng: np.random.Generator,
) -> NDArray[np.int8] | None:
    """Draw the answer of a person who knows labels (O,P); None of behaviors that do not ask."""
    accuracy = domain.behaviors[domain.behavior_index(instance.behavior)].answer_accuracy
    if accuracy is None:
        return None
    return answer(
        labels[instance.object_index, domain.columns(query.attributes)], accuracy, levels, rng
    )


@dataclass(frozen=True, slots=True)
class RecordedPercepts:
    """Percepts of real recordings by classifiers that never saw the object, K levels."""

    table: PerceptTable
    levels: int = 2

    def __post_init__(self) -> None:
        level_edges(self.table.edges, self.levels)

    def log_odds(self, instance: Instance, query: Query) -> NDArray[np.float64]:
        """Return class-balanced log-odds, (N,); NaN where a person answers."""
        behavior = self.table.domain.behavior_index(instance.behavior)
        columns = self.table.domain.columns(query.attributes)
        recorded = self.table.log_odds[instance.object_index, instance.recording, behavior, columns]
        return freeze(recorded, np.float64)

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return levels of the recorded outputs, or a drawn answer.

        Raises
        ------
        SettingsError : an attribute or object for which the table was not computed.
        """
        table = self.table
        said = person_says(table.domain, table.labels, instance, query, self.levels, rng)
        if said is not None:
            return said
        recorded = self.log_odds(instance, query)
        if np.isnan(recorded).any():
            missing = np.array(query.attributes)[np.isnan(recorded)].tolist()
            raise SettingsError(
                f"The percept table holds nothing on {missing} of "
                f"{self.table.objects[instance.object_index]!r} by {instance.behavior!r}; "
                "build it with these attributes and objects."
            )
        return self.table.levels_of(recorded, self.levels)


@dataclass(frozen=True, slots=True)
class FittedPercepts:
    """Percepts of recordings that a fitted Psi has scored all at once.

    Attributes
    ----------
    labels : (O,P) from which a person answers; nothing else uses them.
    log_odds : (O,R,E,P).
    levels : K.
    """

    domain: Domain
    labels: NDArray[np.int8]
    log_odds: NDArray[np.float16]
    levels: int = 2

    def __post_init__(self) -> None:
        set_frozen(self, log_odds=freeze(self.log_odds, np.float16))

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return levels of the outputs, or a drawn answer."""
        said = person_says(self.domain, self.labels, instance, query, self.levels, rng)
        if said is not None:
            return said
        e, columns = (
            self.domain.behavior_index(instance.behavior),
            self.domain.columns(query.attributes),
        )
        scored = self.log_odds[instance.object_index, instance.recording, e, columns]
        return levels_of(scored, BIN_EDGES, self.levels)


@dataclass(frozen=True, slots=True)
class ConfusionSampler:
    """Percepts drawn from the confusion matrices themselves.

    The authors' published simulator does so: accuracies obtained from it do not validate the model.

    Attributes
    ----------
    labels : (O,P) 1 true, 0 false, -1 unknown.
    confusion : (P,E,2,K) rows = truth, sum to 1.
    """

    domain: Domain
    labels: NDArray[np.int8]
    confusion: NDArray[np.float64]

    def __post_init__(self) -> None:
        set_frozen(self, labels=freeze(self.labels, np.int8), confusion=freeze(self.confusion))
        p, e = len(self.domain.attributes), len(self.domain.behaviors)
        if self.confusion.ndim != 4 or self.confusion.shape[:3] != (p, e, 2):  # noqa: PLR2004
            raise DataError(
                f"Confusion matrices have shape {self.confusion.shape}; expected ({p},{e},2,K)."
            )

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Draw each attribute's level from the row of its true value, or of a coin if unknown."""
        levels = self.confusion.shape[-1]
        said = person_says(self.domain, self.labels, instance, query, levels, rng)
        if said is not None:
            return said
        behavior = self.domain.behavior_index(instance.behavior)
        columns = self.domain.columns(query.attributes)
        labels = self.labels[instance.object_index, columns]
        truth = np.where(labels < 0, rng.integers(2, size=len(labels)), labels)
        rows = self.confusion[columns, behavior, truth]  # (N,K)
        return draw_levels(rows, rng)


def draw_levels(rows: ArrayLike, rng: np.random.Generator) -> NDArray[np.int8]:
    """Draw one level from each row of probabilities (N,K)."""
    edges = np.cumsum(np.asarray(rows, dtype=np.float64), axis=-1)[:, :-1]
    return np.asarray((rng.random((len(edges), 1)) >= edges).sum(axis=-1), np.int8)

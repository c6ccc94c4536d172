"""Perceivers: what an executed behavior shows; scored recordings, draws, a person's answers."""

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
    """Draw a person's answer on N attributes, each right with `accuracy`.

    Yes and no are the two extreme levels. Unknown attributes (label -1) are answered by a fair
    coin.
    """
    right = rng.random(len(labels)) < accuracy
    coin = rng.random(len(labels)) < 0.5
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
class Oracle:
    """A perceiver beside a person, who answers behaviors that ask.

    Attributes
    ----------
    perceiver : of all other behaviors.
    domain : behaviors and attributes.
    labels : (O,P) what the person knows; nothing else uses them.
    levels : K of the answers.
    """

    perceiver: Perceiver
    domain: Domain
    labels: NDArray[np.int8]
    levels: int

    def __post_init__(self) -> None:
        set_frozen(self, labels=freeze(self.labels, np.int8))

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return the percept levels of the queried attributes, or a drawn answer, (N,)."""
        said = person_says(self.domain, self.labels, instance, query, self.levels, rng)
        return self.perceiver.observe(instance, query, rng) if said is None else said


@dataclass(frozen=True, slots=True)
class ScoredPercepts:
    """Percepts of recordings that classifiers have scored.

    Attributes
    ----------
    domain : behaviors and attributes.
    log_odds : (O,R,E,P) class-balanced log-odds; NaN where nothing was scored.
    edges : (L-1,) between the fine bins that levels merge.
    levels : K.
    """

    domain: Domain
    log_odds: NDArray[np.float16]
    edges: NDArray[np.float64]
    levels: int

    def __post_init__(self) -> None:
        set_frozen(self, log_odds=freeze(self.log_odds, np.float16))
        level_edges(self.edges, self.levels)

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return the levels of the scored outputs, (N,).

        Raises
        ------
        SettingsError : an attribute or object that was not scored.
        """
        e, columns = (
            self.domain.behavior_index(instance.behavior),
            self.domain.columns(query.attributes),
        )
        scored = self.log_odds[instance.object_index, instance.recording, e, columns]
        if np.isnan(scored).any():
            missing = np.array(query.attributes)[np.isnan(scored)].tolist()
            raise SettingsError(
                f"No percepts of {missing} by {instance.behavior!r} were computed for object "
                f"{instance.object_index}; build the table with these attributes and objects."
            )
        return levels_of(scored, self.edges, self.levels)


@dataclass(frozen=True, slots=True)
class ConfusionSampler:
    """Percepts drawn from the confusion matrices themselves.

    The authors' published simulator does so; accuracies obtained from it do not test the model.

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
        if self.confusion.ndim != 4 or self.confusion.shape[:3] != (p, e, 2):
            raise DataError(
                f"Confusion matrices have shape {self.confusion.shape}; expected ({p},{e},2,K)."
            )

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Draw each attribute's level from the row of its true value, or of a coin if unknown."""
        behavior = self.domain.behavior_index(instance.behavior)
        columns = self.domain.columns(query.attributes)
        labels = self.labels[instance.object_index, columns]
        truth = np.where(labels < 0, rng.integers(2, size=len(labels)), labels)
        return draw_levels(self.confusion[columns, behavior, truth], rng)


def scored_percepts(
    domain: Domain, labels: NDArray[np.int8], log_odds: NDArray[np.float16], levels: int
) -> Oracle:
    """Return a perceiver of recordings that a fitted Psi has scored, (O,R,E,P)."""
    return Oracle(ScoredPercepts(domain, log_odds, BIN_EDGES, levels), domain, labels, levels)


def recorded_percepts(table: PerceptTable, levels: int = 2) -> Oracle:
    """Return a perceiver of real recordings, by classifiers that never saw the object."""
    scored = ScoredPercepts(table.domain, table.log_odds, table.edges, levels)
    return Oracle(scored, table.domain, table.labels, levels)


def sampled_percepts(
    domain: Domain, labels: NDArray[np.int8], confusion: NDArray[np.float64]
) -> Oracle:
    """Return a perceiver that draws from confusion matrices (P,E,2,K)."""
    levels = confusion.shape[-1]
    return Oracle(ConfusionSampler(domain, labels, confusion), domain, labels, levels)


def draw_levels(rows: ArrayLike, rng: np.random.Generator) -> NDArray[np.int8]:
    """Draw one level from each row of probabilities (N,K)."""
    edges = np.cumsum(np.asarray(rows, dtype=np.float64), axis=-1)[:, :-1]
    return np.asarray((rng.random((len(edges), 1)) >= edges).sum(axis=-1), np.int8)

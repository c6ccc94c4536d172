"""Psi(f_a, p): the percept of a behavior, pooled from its modalities."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets import Dataset, Instance
from meal_bayes.datasets.training_set import TrainingSet
from meal_bayes.datasets.percepts import BIN_EDGES, levels_of, round_log_odds
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import DataError
from meal_bayes.perception.confusion import ConfusionCounts, believable, by_truth
from meal_bayes.perception.leave_out import (
    all_objects,
    each_object,
    kernel_problem,
    known_patterns,
)
from meal_bayes.perception.modality import FeatureSpace, ModalityClassifier, fit_space
from meal_bayes.perception.perceiver import answer, columns_of
from meal_bayes.perception.settings import DEFAULT, PerceptionSettings

Floats = NDArray[np.float64]


class Pool(Protocol):
    """Pools the modalities' decisions (B,M,P) into log-odds (B,P)."""

    def log_odds(self, decisions: Floats) -> Floats:
        """Log-odds of "true", (B,P)."""
        ...


@dataclass(frozen=True, slots=True)
class Stacker:
    """A class-balanced logistic regression on the modalities' decisions."""

    weights: Floats  # (P,1+M) intercept and slopes

    def __post_init__(self) -> None:
        set_frozen(self, weights=freeze(self.weights))

    def log_odds(self, decisions: Floats) -> Floats:
        """Log-odds with prior 1/2, (B,P)."""
        slopes: Floats = np.einsum("bmp,pm->bp", decisions, self.weights[:, 1:])
        return slopes + self.weights[:, 0]


@dataclass(frozen=True, slots=True)
class BehaviorClassifier:
    """The classifiers of one behavior's modalities and the rule that pools them."""

    modalities: tuple[ModalityClassifier, ...]
    pool: Pool
    believed: NDArray[np.bool_]  # (P,) elsewhere the percept says nothing

    def __post_init__(self) -> None:
        set_frozen(self, believed=freeze(self.believed, np.bool_))

    def log_odds(self, features: Mapping[str, NDArray[np.floating]]) -> Floats:
        """Log-odds of all attributes for raw features {modality: (B,D)}, (B,P)."""
        decisions = np.stack(
            [phi.decisions(features[phi.modality]) for phi in self.modalities], axis=1
        )
        return np.where(self.believed, self.pool.log_odds(decisions), 0.0)


@dataclass(frozen=True, slots=True)
class Perception:
    """The fitted Psi of all behaviors; a `Perceiver`.

    A behavior of which the training set has no instance gives percepts that say nothing.
    """

    domain: Domain
    classifiers: Mapping[str, BehaviorClassifier]  # by behavior
    labels: NDArray[np.int8]  # (O,P) what a person who is asked knows; nothing else uses them
    levels: int = 2  # K

    def __post_init__(self) -> None:
        set_frozen(self, labels=freeze(self.labels, np.int8))

    def log_odds(self, instance: Instance, query: Query) -> Floats:
        """Log-odds of "true", (N,); NaN where a person answers.

        Raises
        ------
        DataError : an instance without features of one of the behavior's modalities.
        """
        columns = columns_of(self.domain, query)
        behavior = self.domain.behaviors[self.domain.behavior_index(instance.behavior)]
        if behavior.answer_accuracy is not None:
            return np.full(len(query), np.nan)
        classifier = self.classifiers.get(instance.behavior)
        if classifier is None:
            return np.zeros(len(query))
        features = instance.features or {}
        for modality in behavior.modalities:
            if modality not in features:
                raise DataError(
                    f"An instance of {instance.behavior!r} has no features of {modality!r}; "
                    f"expected {list(behavior.modalities)}."
                )
        single = {name: np.asarray(values)[None] for name, values in features.items()}
        return round_log_odds(classifier.log_odds(single)[0, columns]).astype(np.float64)

    def probabilities(self, instance: Instance, query: Query) -> Floats:
        """Probability of "true" under even prior odds, (N,)."""
        return 1.0 / (1.0 + np.exp(-self.log_odds(instance, query)))

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Percept levels of the queried attributes, (N,), or a person's answer."""
        behavior = self.domain.behaviors[self.domain.behavior_index(instance.behavior)]
        if behavior.answer_accuracy is not None:
            labels = self.labels[instance.object_index, columns_of(self.domain, query)]
            return answer(labels, behavior.answer_accuracy, self.levels, rng)
        return levels_of(self.log_odds(instance, query), BIN_EDGES, self.levels)


@dataclass(frozen=True, slots=True)
class BehaviorData:
    """What a training set holds of one behavior, sorted by object."""

    objects: NDArray[np.int64]  # (n,)
    labels: NDArray[np.int8]  # (n,P)
    spaces: Mapping[str, FeatureSpace]  # by modality

    def grams(self) -> Floats:
        """Kernels between the recordings, (M,n,n)."""
        return np.stack([space.gram() for space in self.spaces.values()])


def behavior_data(
    dataset: Dataset, training_set: TrainingSet, behavior: str, kernel: str
) -> BehaviorData | None:
    """Collect a behavior's recordings; None where the training set has none."""
    rows = np.flatnonzero(training_set.behavior == dataset.domain.behavior_index(behavior))
    if not len(rows):
        return None
    order = np.lexsort((training_set.recording[rows], training_set.object[rows]))
    rows = rows[order]
    objects, recordings = training_set.object[rows], training_set.recording[rows]
    spaces = {
        modality: fit_space(values[objects, recordings], kernel)
        for (name, modality), values in dataset.features.items()
        if name == behavior
    }
    return BehaviorData(objects.astype(np.int64), training_set.labels[rows], spaces)


def fit_behavior(
    data: BehaviorData, settings: PerceptionSettings
) -> tuple[tuple[ModalityClassifier, ...], Pool, Floats]:
    """Fit one behavior: its classifiers, their pool, and the nested outputs (n,P).

    The nested output on a recording comes from classifiers and pool that never saw its object;
    it is NaN where the label is unknown.
    """
    if settings.recipe == "paper":
        from meal_bayes.perception.paper import fit_paper  # noqa: PLC0415  scikit-learn is slow

        return fit_paper(data, settings)
    grams = data.grams()
    n_modalities, n, n_attributes = len(grams), len(data.objects), data.labels.shape[1]
    dual = np.zeros((n_modalities, n_attributes, n))
    weights = np.zeros((n_attributes, 1 + n_modalities))
    nested = np.full((n, n_attributes), np.nan)
    for known, attributes in known_patterns(data.labels >= 0):
        problem = kernel_problem(
            grams[:, known][:, :, known],
            data.labels[np.ix_(known, attributes)] == 1,
            data.objects[known],
            settings.noise,
        )
        weights[attributes] = all_objects(problem, settings)
        nested[np.ix_(known, attributes)] = each_object(problem, settings, weights[attributes])
        for m in range(n_modalities):
            dual[m][np.ix_(attributes, known)] = problem.duals[m]
    classifiers = tuple(
        ModalityClassifier(modality, space, dual[m], np.zeros(n_attributes))
        for m, (modality, space) in enumerate(data.spaces.items())
    )
    return classifiers, Stacker(weights), nested


def fit_and_validate(
    dataset: Dataset, training_set: TrainingSet, *, settings: PerceptionSettings = DEFAULT
) -> tuple[Perception, ConfusionCounts]:
    """Fit Psi on the training set, and count what its like says of objects it never saw.

    The two belong together (a percept is worth what such percepts were worth) and share the work.
    """
    domain, n_objects = dataset.domain, len(dataset.objects)
    shape = (n_objects, len(domain.attributes), len(domain.behaviors), 2, settings.levels)
    counts = np.zeros(shape, np.int64)
    classifiers = {}
    for index, behavior in enumerate(domain.behaviors):
        data = behavior_data(dataset, training_set, behavior.name, settings.kernel)
        if data is None or not behavior.modalities:
            continue
        modalities, pool, nested = fit_behavior(data, settings)
        believed = np.ones(nested.shape[1], np.bool_)
        if settings.believable_only:
            believed = believable(_count(data, nested, 2, n_objects))[:, 0]
        nested = np.where(believed | np.isnan(nested), nested, 0.0)
        counts[:, :, index] = _count(data, nested, settings.levels, n_objects).counts[:, :, 0]
        classifiers[behavior.name] = BehaviorClassifier(modalities, pool, believed)
    perception = Perception(domain, classifiers, dataset.labels, settings.levels)
    return perception, ConfusionCounts(counts)


def _count(data: BehaviorData, nested: Floats, levels: int, n_objects: int) -> ConfusionCounts:
    """Count the levels of nested outputs (n,P) by object and truth, (O,P,1,2,K)."""
    seen = levels_of(round_log_odds(nested), BIN_EDGES, levels)
    counts = np.zeros((n_objects, nested.shape[1], 1, 2, levels), np.int64)
    row, attribute = np.nonzero(data.labels >= 0)
    place = (data.objects[row], attribute, 0, data.labels[row, attribute], seen[row, attribute])
    np.add.at(counts, place, 1)
    return ConfusionCounts(counts)


def fit_perception(
    dataset: Dataset, training_set: TrainingSet, *, settings: PerceptionSettings = DEFAULT
) -> Perception:
    """Fit Psi of every behavior on the training set D."""
    return fit_and_validate(dataset, training_set, settings=settings)[0]

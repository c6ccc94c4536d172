"""A labeled trial: its percepts, and the labels that a person gave to its object."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from meal_bayes.agents import Trial
from meal_bayes.datasets import Dataset, Instance
from meal_bayes.domain import Domain, Query
from meal_bayes.errors import SettingsError
from meal_bayes.perception import Perceiver

Key = tuple[str | int, ...]


class Percept(NamedTuple):
    """One percept of a trial.

    Attributes
    ----------
    behavior : str
        The behavior that it came from.
    levels : (P,) int8
        Level of each attribute; -1 unknown.
    features : mapping or None
        modality -> (D,) float32; None unknown.
    """

    behavior: str
    levels: NDArray[np.int8]
    features: Mapping[str, NDArray[np.float32]] | None


@dataclass(frozen=True, slots=True)
class LabeledTrial:
    """Percepts of one trial and the labels of its object.

    Attributes
    ----------
    key : tuple
        The key of the trial's task.
    object_name : str
        Labeled trials of one name are of one object.
    values : mapping
        Labels, by attribute.
    percepts : tuple of Percept
        Of behaviors with modalities, in their order.
    """

    key: Key
    object_name: str
    values: Mapping[str, bool]
    percepts: tuple[Percept, ...]

    @property
    def refittable(self) -> bool:
        """Whether classifiers can be trained on it: it has percepts, all with features."""
        return bool(self.percepts) and all(p.features is not None for p in self.percepts)


class RecordingPerceiver:
    """A perceiver that records its instances, and their percept levels for every attribute."""

    def __init__(self, domain: Domain, perceiver: Perceiver) -> None:
        self._domain, self._perceiver = domain, perceiver
        self._every = Query(domain.attributes)
        self.percepts: list[Percept] = []

    def observe(
        self, instance: Instance, query: Query, rng: np.random.Generator
    ) -> NDArray[np.int8]:
        """Return percept levels of the queried attributes, (N,)."""
        levels = self._perceiver.observe(instance, self._every, rng)
        self.percepts.append(Percept(instance.behavior, levels, instance.features))
        return levels[self._domain.columns(query.attributes)]


def percepts_of(trial: Trial, domain: Domain) -> tuple[Percept, ...]:
    """Return the percepts of a trial: levels of the queried attributes, no features."""
    columns = domain.columns(trial.task.query.attributes)
    found = []
    for step in trial.steps:
        action = step.decision.action
        if step.observation is None or not domain.behaviors[action].modalities:
            continue
        levels = np.full(len(domain.attributes), -1, np.int8)
        levels[columns] = step.observation
        found.append(Percept(domain.behavior_names[action], levels, None))
    return tuple(found)


def checked_values(values: Mapping[str, bool | None], domain: Domain) -> dict[str, bool]:
    """Return the labels that are not None, by attribute.

    Raises
    ------
    QueryError : an attribute that the domain does not have.
    SettingsError : a value other than True, False and None.
    """
    labels = {}
    for name, value in values.items():
        domain.attribute_index(name)
        if value is None:
            continue
        if not isinstance(value, bool | np.bool_) and value not in (0, 1):
            raise SettingsError(f"{name} is labeled {value!r}; give True, False or None.")
        labels[name] = bool(value)
    return labels


def labels_of(
    labeled_trials: Iterable[LabeledTrial], domain: Domain
) -> dict[str, NDArray[np.int8]]:
    """Return the labels of each object, (P,), -1 unknown; the latest where they differ."""
    labels: dict[str, NDArray[np.int8]] = {}
    for labeled in labeled_trials:
        own = labels.setdefault(labeled.object_name, np.full(len(domain.attributes), -1, np.int8))
        for name, value in labeled.values.items():
            own[domain.attribute_index(name)] = value
    return labels


def level_counts(
    labeled_trials: Iterable[LabeledTrial], labels: NDArray[np.int8], domain: Domain, levels: int
) -> NDArray[np.int64]:
    """Count the percepts of one object with labels (P,); return counts (P,E,2,K)."""
    counts = np.zeros((len(labels), len(domain.behaviors), 2, levels), np.int64)
    for labeled in labeled_trials:
        for percept in labeled.percepts:
            known = np.flatnonzero((labels >= 0) & (percept.levels >= 0))
            e = domain.behavior_index(percept.behavior)
            counts[known, e, labels[known], percept.levels[known]] += 1
    return counts


def extended(dataset: Dataset, labeled_trials: Sequence[LabeledTrial]) -> Dataset:
    """Add the recordings and labels of labeled trials to a data set, which becomes ragged."""
    domain, given = dataset.domain, labels_of(labeled_trials, dataset.domain)
    names = (*dataset.objects, *(name for name in given if name not in dataset.objects))
    place = {name: o for o, name in enumerate(names)}
    labels = np.full((len(names), len(domain.attributes)), -1, np.int8)
    labels[: len(dataset.objects)] = dataset.labels
    for name, own in given.items():
        labels[place[name]] = np.where(own < 0, labels[place[name]], own)
    counts = np.zeros((len(names), len(domain.behaviors)), np.int64)
    counts[: len(dataset.objects)] = dataset.recording_counts
    added: list[tuple[int, str, int, Mapping[str, NDArray[np.float32]]]] = []
    for labeled in labeled_trials:
        for percept in labeled.percepts:
            if percept.features is not None:
                o, e = place[labeled.object_name], domain.behavior_index(percept.behavior)
                added.append((o, percept.behavior, int(counts[o, e]), percept.features))
                counts[o, e] += 1
    most = max(int(counts.max()), dataset.recordings)
    features = {}
    for context, values in dataset.features.items():
        wider = np.full((len(names), most, values.shape[2]), np.nan, np.float32)
        wider[: values.shape[0], : values.shape[1]] = values
        features[context] = wider
    for o, behavior, r, own_features in added:
        for modality, row in own_features.items():
            features[behavior, modality][o, r] = row
    return Dataset(domain, names, features, labels)

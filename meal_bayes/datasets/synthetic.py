"""Synthetic data of any size: class-conditional Gaussian features with object effects."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import freeze, set_frozen
from meal_bayes.datasets.dataset import Dataset, Instance
from meal_bayes.display import short_repr
from meal_bayes.domain import Domain
from meal_bayes.errors import SettingsError


@dataclass(frozen=True, slots=True)
class SyntheticModel:
    """The mean features of each object; recordings scatter around them with variance 1.

    All recordings of an object share its mean, so repeats of a behavior are dependent, as those
    of real objects are.

    Attributes
    ----------
    objects : (O,) names.
    labels : (O,P) int8.
    centers : (behavior, modality) -> (O,D).
    """

    domain: Domain
    objects: tuple[str, ...]
    labels: NDArray[np.int8]
    centers: Mapping[tuple[str, str], NDArray[np.float64]]

    __repr__ = short_repr

    def __post_init__(self) -> None:
        centers = {context: freeze(values) for context, values in self.centers.items()}
        set_frozen(self, labels=freeze(self.labels, np.int8), centers=centers)

    def draw(
        self, object_index: int, behavior: str, rng: np.random.Generator, *, recording: int = 0
    ) -> Instance:
        """Draw a new instance of one execution."""
        features = {}
        for modality in self.domain.behaviors[self.domain.behavior_index(behavior)].modalities:
            center = self.centers[behavior, modality][object_index]
            values = (center + rng.standard_normal(center.shape)).astype(np.float32)
            features[modality] = freeze(values, np.float32)
        return Instance(object_index, behavior, recording, features)

    def record(self, recordings: int, rng: np.random.Generator) -> Dataset:
        """Draw `recordings` instances of every object and behavior."""
        features = {}
        for context, center in self.centers.items():
            shape = (center.shape[0], recordings, center.shape[1])
            values = center[:, None] + rng.standard_normal(shape)
            features[context] = values.astype(np.float32)
        return Dataset(self.domain, self.objects, features, self.labels)


def make_synthetic_model(
    domain: Domain,
    *,
    objects: int,
    rng: np.random.Generator,
    dimensions: int = 8,
    signal: float = 3.0,
    object_effect: float = 1.0,
) -> SyntheticModel:
    """Draw objects with labels, and the means of their features.

    Each attribute of a context has a random direction and a strength uniform in [0, `signal`];
    the mean moves by half of that in the direction if the attribute is true, else against it. So
    behaviors differ in which attributes they discriminate. The object effect is a
    Gaussian shift of that standard deviation, one for each object and context. Of an exclusive
    group of attributes every object has exactly one; values are as balanced as can be.
    """
    for name, value in (("objects", objects), ("dimensions", dimensions)):
        if value < 1:
            raise SettingsError(f"{name} = {value}; expected at least 1.")
    for name, size in (("signal", signal), ("object_effect", object_effect)):
        if not size >= 0 or not np.isfinite(size):
            raise SettingsError(f"{name} = {size}; expected a finite number of at least 0.")
    labels = _draw_labels(domain, objects, rng)
    centers = {}
    for behavior in domain.behaviors:
        for modality in behavior.modalities:
            directions = rng.standard_normal((len(domain.attributes), dimensions))
            directions /= np.linalg.norm(directions, axis=1, keepdims=True)
            strength = rng.uniform(0.0, signal, (len(domain.attributes), 1))
            means = (labels - 0.5) @ (strength * directions)  # (O,D)
            shift = object_effect * rng.standard_normal(means.shape)
            centers[behavior.name, modality] = means + shift
    names = tuple(f"object_{number:0{len(str(objects))}d}" for number in range(1, objects + 1))
    return SyntheticModel(domain, names, labels, centers)


def make_synthetic(
    domain: Domain,
    *,
    objects: int,
    recordings: int,
    rng: np.random.Generator,
    **settings: Any,
) -> Dataset:
    """Draw a synthetic data set; the settings are those of `make_synthetic_model`."""
    if recordings < 1:
        raise SettingsError(f"recordings = {recordings}; expected at least 1.")
    return make_synthetic_model(domain, objects=objects, rng=rng, **settings).record(
        recordings, rng
    )


def _draw_labels(domain: Domain, objects: int, rng: np.random.Generator) -> NDArray[np.int8]:
    labels = np.zeros((objects, len(domain.attributes)), dtype=np.int8)
    grouped: set[str] = set()
    for name, members in domain.groups.items():
        if grouped & set(members):
            raise SettingsError(f"Group {name!r} shares attributes with another; expected none.")
        grouped |= set(members)
        columns = [domain.attribute_index(member) for member in members]
        which = rng.permutation(columns)[rng.permutation(objects) % len(columns)]
        labels[np.arange(objects), which] = 1
    for column, attribute in enumerate(domain.attributes):
        if attribute not in grouped:
            labels[:, column] = rng.permutation(objects) % 2
    return labels

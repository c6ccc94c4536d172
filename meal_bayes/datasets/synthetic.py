"""Synthetic data of any size: class-conditional Gaussian features with object effects."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.domain import Domain, load_domain
from meal_bayes.errors import SettingsError


def make_synthetic(
    domain: str | Path | Mapping[str, Any] | Domain,
    *,
    objects: int,
    recordings: int,
    rng: np.random.Generator,
    dimensions: int = 8,
    signal: float = 3.0,
    object_effect: float = 1.0,
) -> Dataset:
    """Draw synthetic objects with labels, and recordings of every behavior.

    In each context (a behavior and a modality), each attribute has a random direction and a
    strength that is uniform in [0, `signal`]. If the attribute is true, the mean of the features
    moves by half of the strength in this direction, and otherwise in the opposite direction. A
    Gaussian shift with the standard deviation `object_effect` is drawn for each object and context,
    so repeats of a behavior are dependent, as for real objects. The noise of recordings has
    variance 1. Every object has exactly one value of each group; the values are as balanced as
    possible.

    Parameters
    ----------
    domain : str, path, mapping or Domain
        Domain, as for `Learner`.
    objects, recordings : int
        Number O of objects, and number R of recordings of each object and behavior.
    dimensions : int
        Number D of features of each modality.

    Raises
    ------
    SettingsError
        A setting is out of range.
    """
    for name, value, least in (
        ("objects", objects, 1), ("recordings", recordings, 1), ("dimensions", dimensions, 1),
        ("signal", signal, 0), ("object_effect", object_effect, 0),
    ):  # fmt: skip
        if not least <= value < np.inf:
            raise SettingsError(f"{name} = {value}; expected a finite number of at least {least}.")
    domain = load_domain(domain)
    labels = _draw_labels(domain, objects, rng)
    means = {}
    for context in domain.contexts:
        directions = rng.standard_normal((len(domain.attributes), dimensions))
        directions /= np.linalg.norm(directions, axis=1, keepdims=True)
        strength = rng.uniform(0.0, signal, (len(domain.attributes), 1))
        mean = (labels - 0.5) @ (strength * directions)  # (O,D)
        means[context] = mean + object_effect * rng.standard_normal(mean.shape)
    features = {
        context: mean[:, None] + rng.standard_normal((objects, recordings, dimensions))
        for context, mean in means.items()
    }
    names = tuple(f"object_{number:0{len(str(objects))}d}" for number in range(1, objects + 1))
    return Dataset(domain, names, features, labels)  # type: ignore[arg-type]


def _draw_labels(domain: Domain, objects: int, rng: np.random.Generator) -> NDArray[np.int8]:
    labels = np.full((objects, len(domain.attributes)), -1, np.int8)
    for members in domain.groups.values():
        columns = domain.columns(members)
        labels[:, columns] = 0
        which = rng.permutation(columns)[rng.permutation(objects) % len(columns)]
        labels[np.arange(objects), which] = 1
    for column in np.flatnonzero(labels[0] < 0):
        labels[:, column] = rng.permutation(objects) % 2
    return labels

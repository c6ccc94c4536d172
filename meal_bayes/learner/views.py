"""Views of the record: functions of it, which nothing keeps.

With memory an agent recognizes objects: labels of an instance are then those of its object, in any
trial; without, those of the trials that showed it.
"""

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from meal_bayes.arrays import Rows
from meal_bayes.datasets import Dataset, TrainingSet
from meal_bayes.domain import Query
from meal_bayes.learner.experience import GIVEN, Experience, Key, Labels, told


def attempts(record: Experience) -> NDArray[np.int64]:
    """Count the executions of each behavior that failed, and that succeeded, (E,2)."""
    e = len(record.domain.behaviors)
    rows = record.executions.values
    rows = rows[rows["success"] >= 0]
    cells = 2 * rows["behavior"] + rows["success"]
    return np.bincount(cells, minlength=2 * e).reshape(e, 2)


def trials_before(record: Experience, trial: Key) -> int:
    """Count the trials that taught and began before one."""
    first = record.trials.get(trial, len(record.trials))
    began = list(record.trials)[:first]
    return sum(key != told(str(key[-1])) for key in began)


def told_fraction(record: Experience) -> float:
    """Fraction of the labels of objects beyond a first that people told, by Laplace's rule."""
    rows = record.feedback.values
    cells = (len(record.trials), len(record.domain.attributes))
    labels = np.full(cells, -1)
    labels[rows["trial"], rows["attribute"]] = rows["value"]  # the latest of each
    number = (labels >= 0).sum(axis=1)  # of each trial
    beyond = np.maximum(number - 1, 0).sum()
    possible = (number > 0).sum() * (cells[1] - 1)
    return float((beyond + 1) / (possible + 2))


def labels_for(record: Experience, names: Iterable[str]) -> Labels:
    """Return the labels (O,P) of objects by name; -1 unknown."""
    nothing = np.full(len(record.domain.attributes), -1, np.int8)  # of no object
    rows = np.vstack([record.known.values, nothing])
    return rows[[record.objects.get(name, -1) for name in names]]


def recognized(record: Experience, query: Query, object_name: str) -> Labels | None:
    """Return the labels (N,) that people gave to an object, None where they gave none."""
    labels = labels_for(record, [object_name])[0, record.domain.columns(query.attributes)]
    return labels if (labels >= 0).any() else None


def labels_by(record: Experience, trial: tuple[str | int, ...]) -> dict[str, bool]:
    """Return the labels that were given in a trial, by attribute."""
    labels = zip(record.domain.attributes, record.told_in(trial).tolist(), strict=True)
    return {name: value == 1 for name, value in labels if value >= 0}


def labels_of(record: Experience, rows: Any, *, memory: bool) -> Labels:
    """Return the labels (k,P) of instances."""
    if memory:
        return np.asarray(record.known.values[record.instances.values["object"][rows]])
    return np.asarray(record.labels.values[rows])


def labelled(record: Experience, *, memory: bool, given: bool = True) -> NDArray[np.int64]:
    """Count the labelled instances of object, behavior, attribute, (O,E,P).

    Those not gathered in trials count if `given`.
    """
    instances = record.instances.values
    rows = np.flatnonzero(given | (instances["origin"] != GIVEN))
    e = len(record.domain.behaviors)
    p = len(record.domain.attributes)
    counts = np.zeros((len(record.objects), e, p), int)
    labels = labels_of(record, rows, memory=memory) >= 0
    np.add.at(counts, (instances["object"][rows], instances["behavior"][rows]), labels)
    return counts


def training(record: Experience, *, memory: bool) -> tuple[Dataset, NDArray[np.intp], TrainingSet]:
    """Return D: the instances with features as a data set, where each row is, and their labels.

    Returns
    -------
    dataset : Dataset
        Ragged; of all objects that were met.
    rows : NDArray[np.intp]
        (k,) instances, in the order of the training set.
    gathered : TrainingSet
        All of them, labelled or not.
    """
    instances = record.instances.values
    rows = np.flatnonzero(instances["features"] >= 0)
    keys = [instances[name][rows] for name in ("recording", "behavior", "object")]
    rows = rows[np.lexsort(keys)]
    o = instances["object"][rows].astype(np.int32)
    e = instances["behavior"][rows].astype(np.int32)
    context_number = o * len(record.domain.behaviors) + e
    first = np.searchsorted(context_number, context_number)
    r = (np.arange(len(rows)) - first).astype(np.int32)
    objects = tuple(record.objects)
    most = int(r.max(initial=0)) + 1
    features = {}
    for context in record.domain.contexts:
        perceived = record.features.get(context, Rows(np.float32, 1)).values
        values = np.full((len(objects), most, perceived.shape[1]), np.nan, np.float32)
        mask = e == record.domain.behavior_index(context[0])
        values[o[mask], r[mask]] = perceived[instances["features"][rows[mask]]]
        features[context] = values
    dataset = Dataset(record.domain, objects, features, record.known.values, partial=True)
    return dataset, rows, TrainingSet(o, e, r, labels_of(record, rows, memory=memory))

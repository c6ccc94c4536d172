"""Percepts of classifiers that are taught by half of the objects, for the same tasks as by all.

The objects are dealt out into two halves. Classifiers of a half are taught by it alone, each object
left out in turn, and all that an agent learns comes from the object's own half.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets import Dataset, PerceptTable, load_dataset, load_percepts, save_percepts
from meal_bayes.perception import build_percept_table
from meal_bayes.seeds import stream
from paper_repro.frame import Setting


def table_by_halves(setting: Setting, name: str) -> str:
    """Write the percept table of a data set by halves, and return its path."""
    dataset = load_dataset(name)
    whole = load_percepts(name)
    order = stream(setting.seed, "halves", name).permutation(len(dataset.objects))
    middle = len(order) // 2
    parts = [np.sort(part) for part in (order[:middle], order[middle:])]
    tables = [build_percept_table(_part(dataset, part)) for part in parts]
    path = setting.logs / "tables" / f"{name}_halves_{setting.seed}.npz"
    path.parent.mkdir(parents=True, exist_ok=True)
    save_percepts(joined(whole, parts, tables), path)
    return str(path)


def joined(
    whole: PerceptTable, parts: list[NDArray[np.int64]], tables: list[PerceptTable]
) -> PerceptTable:
    """Join the tables of parts of the objects into one of all, for the tasks of all.

    Objects of another part are no experience: their training counts are zero.
    """
    log_odds = np.full(whole.log_odds.shape, np.nan, np.float16)
    objects = len(whole.objects)
    bins = np.zeros((objects, *whole.training_bins.shape[1:]), np.uint8)
    for part, table in zip(parts, tables, strict=True):
        log_odds[part] = table.log_odds
        bins[np.ix_(part, part)] = table.training_bins[table.groups]
    return replace(whole, log_odds=log_odds, training_bins=bins, groups=np.arange(objects))


def _part(dataset: Dataset, part: NDArray[np.int64]) -> Dataset:
    return replace(
        dataset,
        objects=tuple(dataset.objects[o] for o in part),
        labels=dataset.labels[part],
        features={context: values[part] for context, values in dataset.features.items()},
        partial=True,
    )

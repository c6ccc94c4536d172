"""ISPY32: 32 household objects, 81 words people said of them, 5 recordings a behavior."""

import logging
from pathlib import Path

import numpy as np

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_file import (
    Context,
    FeatureRows,
    fault,
    join_features,
    read_contexts,
    read_rows,
)
from meal_bayes.datasets.percept_file import load_percepts
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError

log = logging.getLogger("meal_bayes.datasets")


def load_ispy32(domain: Domain, folder: Path) -> Dataset:
    """Read `object_list.csv` and `corl_features/<behavior>_<modality>.txt`.

    What is done to the files, each logged:

    * Column two, the trial number, is a key and not a feature.
    * Labels are those of the percept table that ships, which come from
      `full_annotations_ijcai2016.pickle`; no pickle is read. The crowd's `labels.csv` was not used
      by the experiments and is not read.
    * Kept as they are: objects 22 and 24 are both heavy and light.
    """
    names: dict[str, str] = {}  # by number
    for place, cells in read_rows(folder / "object_list.csv"):
        expected = f"name,{len(names) + 1}"
        if len(cells) != 2 or cells[1] != str(len(names) + 1):  # name, number
            where = f"{folder / 'object_list.csv'}, {place}"
            raise fault(where, f"{','.join(cells)[:60]!r}", expected, "restore the row")
        names[cells[1]] = cells[0]
    objects = tuple(names.values())

    def named(context: Context, rows: FeatureRows) -> tuple[Context, FeatureRows]:
        keys = [(names.get(number, number), trial) for number, trial in rows.keys]
        return context, rows._replace(keys=keys)

    files = read_contexts(domain, folder / "corl_features", "{}_{}.txt", ("object", "trial"))
    features = join_features(
        objects, (named(*file) for file in files), [str(k) for k in range(1, 6)]
    )
    log.info("ispy32: used column two, the trial number, as key and not as feature")
    table = load_percepts("ispy32")
    for kind, wanted, known in (
        ("object", objects, table.objects),
        ("word", domain.attributes, table.domain.attributes),
    ):
        for name in wanted:
            if name not in known:
                raise DataError(f"ISPY32 has no labels of it. {unknown(kind, name, known)}")
    rows = [table.objects.index(name) for name in objects]
    labels = table.labels[rows][:, table.domain.columns(domain.attributes)]
    if {"heavy", "light"} <= set(domain.attributes):
        heavy, light = (labels[:, domain.attribute_index(name)] for name in ("heavy", "light"))
        both = ", ".join(objects[o] for o in np.flatnonzero(heavy & light))
        log.info("ispy32: kept objects that are both heavy and light: %s", both)
    return Dataset(domain, objects, features, labels)

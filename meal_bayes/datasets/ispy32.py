"""ISPY32: 32 household objects, 81 words people said of them, 5 recordings a behavior."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_file import (
    FeatureRows,
    bad_line,
    check_labeled,
    join_features,
    read_contexts,
    read_rows,
    read_text,
    split_line,
)
from meal_bayes.datasets.label_pickle import read_label_pickle
from meal_bayes.domain import Domain

log = logging.getLogger("meal_bayes.datasets")

RECORDINGS = ("1", "2", "3", "4", "5")


def load_ispy32(domain: Domain, folder: Path) -> Dataset:
    """Read `object_list.csv`, the annotations, and `corl_features/<behavior>_<modality>.txt`.

    What is done to the files, each logged:

    * Column two, the trial number, is a key and not a feature.
    * Labels come from `full_annotations_ijcai2016.pickle`, read by a loader that can make numbers
      and nothing else, in the order of the words of `test_full.csv`; its keys 0..31 are the object
      numbers 1..32. The crowd's `labels.csv` was not used by the experiments and is not read.
    * Kept as they are: objects 22 and 24 are both heavy and light.
    """
    numbers = _read_objects(folder / "object_list.csv")
    objects = tuple(numbers.values())
    recordings = dict.fromkeys(objects, RECORDINGS)
    files = read_contexts(domain, folder / "corl_features", "{}_{}.txt", ("object", "trial"))
    features = {
        context: join_features(rows, _name_objects(rows, numbers), recordings)
        for context, rows in files
    }
    log.info("ispy32: used column two, the trial number, as key and not as feature")
    return Dataset(domain, objects, features, _labels(folder, domain, objects))


def _read_objects(path: Path) -> dict[str, str]:
    numbers: dict[str, str] = {}
    for line, cells in read_rows(path):
        expected = f"name,{len(numbers) + 1}"
        if len(cells) != 2 or cells[1] != str(len(numbers) + 1):  # name, number
            raise bad_line(path, line, f"{','.join(cells)[:60]!r}", expected, "restore the row")
        numbers[cells[1]] = cells[0]
    return numbers


def _name_objects(rows: FeatureRows, numbers: dict[str, str]) -> list[tuple[str, str]]:
    for line, (number, _) in zip(rows.lines, rows.keys, strict=True):
        if number not in numbers:
            expected = f"1 to {len(numbers)}"
            raise bad_line(rows.path, line, f"object {number!r}", expected, "restore the number")
    return [(numbers[number], trial) for number, trial in rows.keys]


def _labels(folder: Path, domain: Domain, objects: tuple[str, ...]) -> NDArray[np.int8]:
    words = [word.strip() for word in split_line(read_text(folder / "test_full.csv").strip())]
    path = folder / "full_annotations_ijcai2016.pickle"
    table = read_label_pickle(path, len(objects), len(words))
    log.info("ispy32: read labels with a loader that makes numbers only, keys 0.. = objects 1..")
    check_labeled(domain, words, "ISPY32")
    labels = table[:, [words.index(attribute) for attribute in domain.attributes]]
    if {"heavy", "light"} <= set(domain.attributes):
        heavy, light = domain.columns(("heavy", "light"))
        both = np.flatnonzero(labels[:, heavy] & labels[:, light])
        names = ", ".join(objects[o] for o in both)
        log.info("ispy32: kept objects that are both heavy and light: %s", names)
    return labels

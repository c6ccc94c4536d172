"""ROC36: 36 containers = 3 weights x 3 colors x 4 contents, 10 recordings a behavior."""

import logging
from collections import Counter
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
)
from meal_bayes.domain import Domain

log = logging.getLogger("meal_bayes.datasets")

RECORDINGS = tuple(str(number) for number in range(1, 11))
WORDS_IN_NAME = 3  # weight_color_content


def load_roc36(domain: Domain, folder: Path) -> Dataset:
    """Read `objects.txt` and `sensorimotor_features/<behavior>-<modality>.txt`.

    What is done to the files, each logged:

    * Rows name their object but not their recording: rows of one object are numbered 1 to 10 in
      file order.
    * Labels are the three words of an object's name (weight_color_content); every other attribute
      is false.
    * Kept, as it cannot be undone: the features are principal components fitted on all 36 objects,
      held-out ones too, without labels.
    """
    objects = _read_objects(folder / "objects.txt")
    recordings = dict.fromkeys(objects, RECORDINGS)
    files = read_contexts(domain, folder / "sensorimotor_features", "{}-{}.txt", ("object",))
    features = {
        context: join_features(rows, _number_recordings(rows), recordings)
        for context, rows in files
    }
    log.info("roc36: numbered each object's rows 1 to 10 in file order (the files name no number)")
    log.info("roc36: kept features that were principal components of all 36 objects, held-out too")
    return Dataset(domain, objects, features, _labels(domain, objects))


def _read_objects(path: Path) -> tuple[str, ...]:
    names = []
    for number, cells in read_rows(path):
        name = ",".join(cells)
        if len(name.split("_")) != WORDS_IN_NAME:
            raise bad_line(path, number, f"{name!r}", "weight_color_content", "restore the name")
        if name in names:
            raise bad_line(path, number, f"{name!r} again", "each object once", "remove one")
        names.append(name)
    return tuple(names)


def _number_recordings(rows: FeatureRows) -> list[tuple[str, str]]:
    rows_of: Counter[str] = Counter()
    keys = []
    for line, (name,) in zip(rows.lines, rows.keys, strict=True):
        rows_of[name] += 1
        if rows_of[name] > len(RECORDINGS):
            found = f"row {rows_of[name]} of {name}"
            expected = f"{len(RECORDINGS)} rows an object"
            raise bad_line(rows.path, line, found, expected, "remove the row that comes twice")
        keys.append((name, str(rows_of[name])))
    return keys


def _labels(domain: Domain, objects: tuple[str, ...]) -> NDArray[np.int8]:
    words = {word for name in objects for word in name.split("_")}
    check_labeled(domain, words, "ROC36")
    rows = [[word in name.split("_") for word in domain.attributes] for name in objects]
    return np.array(rows, dtype=np.int8)

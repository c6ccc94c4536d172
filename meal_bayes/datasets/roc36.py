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
    join_features,
    read_features,
    read_text,
)
from meal_bayes.domain import Domain, unknown
from meal_bayes.errors import DataError

log = logging.getLogger("meal_bayes.datasets")

RECORDINGS = tuple(str(number) for number in range(1, 11))
WORDS_IN_NAME = 3  # weight_color_content


def load_roc36(domain: Domain, folder: Path) -> Dataset:
    """Read `objects.txt` and `sensorimotor_features/<behavior>-<modality>.txt`.

    What is done to the files, each told to the log:

    * Rows name their object but not their recording: rows of one object are numbered 1 to 10 in
      file order.
    * Labels are the three words of an object's name (weight_color_content); every other attribute
      is false.
    * Not mended, as it cannot be undone: the features are principal components fitted on all 36
      objects, so that a held-out object had a (label-free) part in them.
    """
    objects = _read_objects(folder / "objects.txt")
    features = {}
    for behavior in domain.behaviors:
        for modality in behavior.modalities:
            path = folder / "sensorimotor_features" / f"{behavior.name}-{modality}.txt"
            rows = read_features(path, ("object",))
            keys = _number_recordings(rows)
            features[behavior.name, modality] = join_features(
                rows, keys, dict.fromkeys(objects, RECORDINGS)
            )
    log.info("roc36: numbered each object's rows 1 to 10 in file order (the files name no number)")
    log.info("roc36: kept features that were principal components of all 36 objects, held-out too")
    return Dataset(domain, objects, features, _labels(domain, objects))


def _read_objects(path: Path) -> tuple[str, ...]:
    names = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        name = line.strip()
        if not name:
            continue
        if len(name.split("_")) != WORDS_IN_NAME:
            raise bad_line(path, number, f"{name!r}", "weight_color_content", "restore the name")
        if name in names:
            raise bad_line(path, number, f"{name!r} again", "each object once", "remove one")
        names.append(name)
    return tuple(names)


def _number_recordings(rows: FeatureRows) -> list[tuple[str, str]]:
    seen: Counter[str] = Counter()
    keys = []
    for line, (name,) in zip(rows.lines, rows.keys, strict=True):
        seen[name] += 1
        if seen[name] > len(RECORDINGS):
            found = f"row {seen[name]} of {name}"
            expected = f"{len(RECORDINGS)} rows an object"
            raise bad_line(rows.path, line, found, expected, "remove the row that comes twice")
        keys.append((name, str(seen[name])))
    return keys


def _labels(domain: Domain, objects: tuple[str, ...]) -> NDArray[np.int8]:
    words = {word for name in objects for word in name.split("_")}
    for attribute in domain.attributes:
        if attribute not in words:
            raise DataError(f"ROC36 has no labels of it. {unknown('word', attribute, words)}")
    rows = [[word in name.split("_") for word in domain.attributes] for name in objects]
    return np.array(rows, dtype=np.int8)

"""ROC36: 36 containers = 3 weights x 3 colors x 4 contents, 10 recordings a behavior."""

import logging
from collections import Counter
from pathlib import Path

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_file import (
    FeatureRows,
    fault,
    join_features,
    labels_by_words,
    read_contexts,
    read_rows,
)
from meal_bayes.domain import Domain

log = logging.getLogger("meal_bayes.datasets")


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
    words: dict[str, list[str]] = {}
    for place, cells in read_rows(folder / "objects.txt"):
        name, where = ",".join(cells), f"{folder / 'objects.txt'}, {place}"
        if len(name.split("_")) != 3:
            raise fault(where, f"{name!r}", "weight_color_content", "restore the name")
        if name in words:
            raise fault(where, f"{name!r} again", "each object once", "remove one")
        words[name] = name.split("_")
    contexts = read_contexts(domain, folder / "sensorimotor_features", "{}-{}.txt", ("object",))
    numbered = ((context, _number_recordings(rows)) for context, rows in contexts)
    features = join_features(list(words), numbered, [str(k) for k in range(1, 11)])
    log.info("roc36: numbered each object's rows 1 to 10 in file order (the files name no number)")
    log.info("roc36: kept features that were principal components of all 36 objects, held-out too")
    return Dataset(domain, tuple(words), features, labels_by_words(domain, words, "ROC36"))


def _number_recordings(rows: FeatureRows) -> FeatureRows:
    so_far: Counter[str] = Counter()
    keys = []
    for (name,) in rows.keys:
        so_far[name] += 1
        keys.append((name, str(so_far[name])))
    return rows._replace(keys=keys)

"""CY101: 100 household objects (the 101st, `no_object`, is left out), 5 recordings a behavior."""

import logging
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_file import (
    Context,
    FeatureRows,
    fault,
    join_features,
    labels_by_words,
    read_contexts,
    read_rows,
)
from meal_bayes.domain import Domain
from meal_bayes.errors import DataError

log = logging.getLogger("meal_bayes.datasets")

_OVERFLOW = 2.0**31  # a 32-bit count whose sign bit is set lies this much too low


def load_cy101(domain: Domain, folder: Path) -> Dataset:
    """Read `objects.txt`, `cy101_labels.csv` and `normalized_data_without_noobject/`.

    What is done to the files, each logged:

    * Rows come in another order in each file; they are joined by their key `<object>_t<k>`.
    * `no_object` has labels but no recordings and is left out.
    * One look_color count (`smallstuffedanimal_moose_t2`) has its 32-bit sign bit set
      (-2147483519); 2^31 is added, which gives 129.
    * Kept: recordings that are copies of another, of the same object (`basket_cylinder_t5` of
      nearly all behaviors, `ball_blue` look, `noodle_1` tap, `smallstuffedanimal_otter` hold) or of
      another object (crush_vibro: `cannedfood_tomato_paste_t1` equals `ball_base_t1`).
    * An absent word counts as false; repeated words count once; spaces around a word are removed.
    """
    listed = (cells[0] for _, cells in read_rows(folder / "objects.txt"))
    objects = tuple(name for name in listed if name != "no_object")
    labels = _read_labels(folder / "cy101_labels.csv", objects, domain)
    data = folder / "normalized_data_without_noobject"
    contexts = read_contexts(domain, data, "{}_{}.txt", ("object_t<k>",))
    features = join_features(
        objects, (_corrected(*file) for file in contexts), [str(k) for k in range(1, 6)]
    )
    copies: dict[tuple[str, str], list[str]] = {}  # (copy, original) -> contexts
    for context, values in features.items():
        for pair in _find_copies(values, objects):
            copies.setdefault(pair, []).append("_".join(context))
    for (copy, original), names in copies.items():
        log.info("cy101: kept %s, a copy of %s, in %s", copy, original, ", ".join(names))
    return Dataset(domain, objects, features, labels)


def _corrected(context: Context, rows: FeatureRows) -> tuple[Context, FeatureRows]:
    """Split the keys `<object>_t<k>`, and mend counts (in double precision: single rounds)."""
    keys = [key.rpartition("_t")[::2] if "_t" in key else (key, "") for (key,) in rows.keys]
    if context[1] != "color":
        return context, rows._replace(keys=keys)
    low = rows.values < -_OVERFLOW / 2
    for row, column in np.argwhere(low):
        where = f"{Path(rows.source).name}, {rows.places[row]}, feature {column + 1}"
        log.info("cy101: added 2^31 to the count of %s in %s", rows.keys[row][0], where)
    values = np.where(low, rows.values + _OVERFLOW, rows.values)
    return context, rows._replace(keys=keys, values=values)


def _find_copies(
    values: NDArray[np.float32], objects: tuple[str, ...]
) -> Iterator[tuple[str, str]]:
    """Yield recordings equal to an earlier one, and that; rows of zeros do not count."""
    first: dict[bytes, str] = {}
    for o, r in np.ndindex(values.shape[:2]):
        if values[o, r].any():
            key = f"{objects[o]}_t{r + 1}"
            original = first.setdefault(values[o, r].tobytes(), key)
            if original != key:
                yield key, original


def _read_labels(path: Path, objects: tuple[str, ...], domain: Domain) -> NDArray[np.int8]:
    words: dict[str, set[str]] = {}
    repeated, padded = [], []
    for place, cells in read_rows(path):
        if cells == ["object", "words"]:
            continue
        if len(cells) != 2:  # object, words
            expected = 'object,"word, word, ..."'
            raise fault(f"{path}, {place}", f"{len(cells)} columns", expected, "quote the words")
        name, listed = cells[0], cells[1].split(", ")
        if name in words:
            raise fault(f"{path}, {place}", f"{name!r} again", "each object once", "remove one")
        words[name] = {word.strip() for word in listed} - {""}
        repeated += [name] * (len(words[name]) < len([word for word in listed if word]))
        padded += [name] * (listed != [word.strip() for word in listed])
    for name in objects:
        if name not in words:
            raise DataError(f"{path}: found no row of object {name!r}; add {name},<words>.")
    log.info("cy101: counted once the words that these objects repeat: %s", ", ".join(repeated))
    log.info("cy101: removed a leading space of a label of %s", ", ".join(padded))
    return labels_by_words(domain, {name: words[name] for name in objects}, "CY101")

"""A user's own data: a folder of CSV files that any program can write."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_file import (
    bad_line,
    join_features,
    read_contexts,
    read_rows,
)
from meal_bayes.domain import Domain, unknown
from meal_bayes.files import write_whole

log = logging.getLogger("meal_bayes.datasets")

_KEYS = ("object", "recording")
_VALUES = {"1": 1, "0": 0, "": -1}


def load_csv_folder(domain: Domain, folder: Path) -> Dataset:
    """Read `labels.csv` and one `<behavior>_<modality>.csv` for each context of the domain.

    `labels.csv` has the header ``object,<attribute>,...`` and a row an object: 1 true, 0 false,
    empty unknown. A feature file has the header ``object,recording,<feature>,...`` and a row a
    recording; the files of one behavior are joined by (object, recording) and hold the same rows.
    An object may lack a behavior, or have another number of recordings of it than others.

    Raises
    ------
    DataError : the first line that is wrong, with its file, number, and how to repair it.
    """
    objects, labels = _read_labels(folder / "labels.csv", domain)
    features: dict[tuple[str, str], NDArray[np.float32]] = {}
    recordings: dict[str, dict[str, tuple[str, ...]]] = {}
    for context, rows in read_contexts(domain, folder, "{}_{}.csv", _KEYS, header=True):
        keys = [(name, recording) for name, recording in rows.keys]
        own = recordings.setdefault(context[0], _by_object(objects, keys))
        features[context] = join_features(rows, keys, own)
    most = max(values.shape[1] for values in features.values())
    log.info("%s: read %d objects, up to %d recordings each", folder, len(objects), most)
    padded = {context: _padded(values, most) for context, values in features.items()}
    return Dataset(domain, objects, padded, labels)


def save_csv_folder(dataset: Dataset, folder: Path) -> None:
    """Write a data set as `load_csv_folder` reads it; `labels.csv` comes last.

    Numbers are written so that they read back equal.
    """
    import pandas as pd  # noqa: PLC0415  takes half a second

    objects = np.array(dataset.objects)
    for (behavior, modality), values in dataset.features.items():
        counts = dataset.recording_counts[:, dataset.domain.behavior_index(behavior)]
        o, r = np.nonzero(np.arange(values.shape[1]) < counts[:, None])
        names = [f"f{i}" for i in range(values.shape[2])]
        index = pd.MultiIndex.from_arrays([objects[o], r + 1], names=_KEYS)
        frame = pd.DataFrame(values[o, r], index, names)
        text = frame.to_csv(float_format="%.9g", lineterminator="\n")
        write_whole(folder / f"{behavior}_{modality}.csv", text)
    labels = pd.DataFrame(
        dataset.labels, pd.Index(objects, name="object"), dataset.domain.attributes
    )
    text = labels.astype("Int8").where(labels >= 0).to_csv(lineterminator="\n")
    write_whole(folder / "labels.csv", text)


def _by_object(objects: tuple[str, ...], keys: list[tuple[str, str]]) -> dict[str, tuple[str, ...]]:
    """Return each object's recordings in order, 2 before 10."""
    found: dict[str, set[str]] = {name: set() for name in objects}
    for name, recording in keys:
        if name in found:  # others are refused with their line
            found[name].add(recording)
    return {
        name: tuple(sorted(own, key=lambda text: (len(text), text))) for name, own in found.items()
    }


def _padded(values: NDArray[np.float32], most: int) -> NDArray[np.float32]:
    missing = ((0, 0), (0, most - values.shape[1]), (0, 0))
    return np.pad(values, missing, constant_values=np.nan)


def _read_labels(path: Path, domain: Domain) -> tuple[tuple[str, ...], NDArray[np.int8]]:
    header, rows = list[str](), dict[str, list[int]]()
    for number, cells in read_rows(path):
        if not header:
            header = cells
            _check_header(path, number, header, domain)
            continue
        if len(cells) != len(header):
            found, expected = f"{len(cells)} columns", f"{len(header)} as in the header"
            raise bad_line(path, number, found, expected, "leave unknown values empty: a,1,,0")
        if cells[0] in rows:
            found = f"object {cells[0]!r} again"
            raise bad_line(path, number, found, "each object once", "remove one of the rows")
        for column, cell in enumerate(cells[1:], start=2):
            if cell not in _VALUES:
                found = f"{cell!r} in column {column} ({header[column - 1]})"
                raise bad_line(path, number, found, "1, 0 or nothing", "write one of them")
        rows[cells[0]] = [_VALUES[cell] for cell in cells[1:]]
    if not rows:
        raise bad_line(path, 1, "no rows under the header", "a row an object", "add the rows")
    columns = [header.index(attribute) - 1 for attribute in domain.attributes]
    return tuple(rows), np.array(list(rows.values()), dtype=np.int8)[:, columns]


def _check_header(path: Path, line: int, header: list[str], domain: Domain) -> None:
    expected = f"object,{','.join(domain.attributes[:3])},..."
    if header[0] != "object":
        repair = "write it so (commas, not semicolons)"
        raise bad_line(path, line, f"the header {header[0][:40]!r}", expected, repair)
    for attribute in domain.attributes:
        if header.count(attribute) != 1:
            found = f"{header.count(attribute)} columns {attribute!r}"
            hint = unknown("column", attribute, header[1:]).removesuffix(".")
            raise bad_line(path, line, found, "one", f"add or rename one ({hint})")

"""A user's own data: a folder of CSV files that any program can write."""

import logging
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from meal_bayes.datasets.dataset import Dataset
from meal_bayes.datasets.feature_file import fault, join_features, read_features, read_rows
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
    An object may lack a behavior, or have another number of recordings of it than others. The first
    line that is wrong is a `DataError` with its file, number, and how to repair it.
    """
    objects, labels = _read_labels(folder / "labels.csv", domain)
    files = ((context, folder / "{}_{}.csv".format(*context)) for context in domain.contexts)
    contexts = ((context, read_features(path, _KEYS, header=True)) for context, path in files)
    dataset = Dataset(domain, objects, join_features(objects, contexts), labels)
    log.info(
        "%s: read %d objects, up to %d recordings each", folder, len(objects), dataset.recordings
    )
    return dataset


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


def _read_labels(path: Path, domain: Domain) -> tuple[tuple[str, ...], NDArray[np.int8]]:
    (place, header), *rows = read_rows(path)
    where = f"{path}, {place}"
    if header[0] != "object":
        expected = f"object,{','.join(domain.attributes[:3])},..."
        repair = "write it so (commas, not semicolons)"
        raise fault(where, f"the header {header[0][:40]!r}", expected, repair)
    for attribute in domain.attributes:
        if header.count(attribute) != 1:
            hint = unknown("column", attribute, header[1:]).removesuffix(".")
            columns = f"{header.count(attribute)} columns {attribute!r}"
            raise fault(where, columns, "one", f"add or rename one ({hint})")
    labels: dict[str, list[int]] = {}
    for place, cells in rows:
        where = f"{path}, {place}"
        if len(cells) != len(header):
            expected = f"{len(header)} as in the header"
            repair = "leave unknown values empty: a,1,,0"
            raise fault(where, f"{len(cells)} columns", expected, repair)
        if cells[0] in labels:
            again = f"object {cells[0]!r} again"
            raise fault(where, again, "each object once", "remove one of the rows")
        for column, cell in enumerate(cells[1:], start=1):
            if cell not in _VALUES:
                value = f"{cell!r} in column {column + 1} ({header[column]})"
                raise fault(where, value, "1, 0 or nothing", "write one of them")
        labels[cells[0]] = [_VALUES[cells[header.index(name)]] for name in domain.attributes]
    if not labels:
        raise fault(where, "no rows under the header", "a row an object", "add the rows")
    return tuple(labels), np.array(list(labels.values()), dtype=np.int8)

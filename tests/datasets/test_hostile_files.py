"""Feature files and percept tables that are not what they seem."""

import json
import os
import tracemalloc
import zipfile
from importlib import resources

import numpy as np
import pytest

from meal_bayes.datasets import load_percepts
from meal_bayes.datasets.feature_file import read_features, read_rows, read_text
from meal_bayes.errors import DataError


@pytest.mark.parametrize(
    "cell", ["3_4", "\N{FULLWIDTH DIGIT THREE}", "\N{ARABIC-INDIC DIGIT THREE}", "0x1p3", "", '"1']
)
def test_what_only_python_takes_for_a_number_is_refused(cell, tmp_path):
    path = tmp_path / "look_color.csv"
    path.write_text(f"object,recording,a,b\nmug,1,0.5,{cell}\n", encoding="utf-8")
    with pytest.raises(DataError, match=r"look_color\.csv, line 2"):
        read_features(path, ("object", "recording"), header=True)


def test_numbers_in_every_usual_form_are_read(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text('object,recording,a,b,c,d\nmug,1, -.5 ,1e-3,+2.,"7"\n')
    rows = read_features(path, ("object", "recording"), header=True)
    assert rows.values.tolist() == [[-0.5, 1e-3, 2.0, 7.0]]


def test_a_quote_in_the_middle_joins_no_cells(tmp_path):
    (tmp_path / "a.csv").write_text('"a"b,1\n"a,b",1\n')
    cells = [cells for _, cells in read_rows(tmp_path / "a.csv")]
    assert cells == [['"a"b,1'], ["a,b", "1"]]


def test_endless_files_are_not_read(tmp_path):
    os.mkfifo(tmp_path / "pipe.csv")
    with pytest.raises(DataError, match="no regular file"):
        read_text(tmp_path / "pipe.csv")


@pytest.fixture
def rewrite(tmp_path):
    """Return a function that writes the shipped table with other members."""
    source = resources.files("meal_bayes.datasets")
    with zipfile.ZipFile(str(source / "tables" / "roc36.npz")) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}

    def write(**changed):
        path = tmp_path / "own.npz"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, data in members.items():
                archive.writestr(name, data)
            for name, values in changed.items():
                with archive.open(f"{name}.npy", "w", force_zip64=True) as file:
                    np.lib.format.write_array(file, values, version=(1, 0))
        return path

    return write


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_small_file_asks_for_no_great_memory(rewrite):
    path = rewrite(training_bins=np.zeros((70, 1000, 1000, 1, 1), np.uint8))
    assert path.stat().st_size < 10 << 20
    tracemalloc.start()
    with pytest.raises(DataError, match="claims 70"):
        load_percepts(path)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20 << 20


@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_domain_that_blows_its_table_up_is_refused(rewrite):
    with zipfile.ZipFile(rewrite()) as archive:
        data = archive.read("meta.npy")
    meta = json.loads(data[data.index(b"{", 100) :])
    names = [f"b{i}" for i in range(980)]
    meta["domain_table"] = {
        "name": "own",
        "attributes": meta["attributes"],
        "behaviors": [
            *({"name": name, "cost": 1, "modalities": ["all"]} for name in meta["behaviors"]),
            *({"name": name, "cost": 1} for name in names),
        ],
        "diagram": {
            "states": ["x"],
            "start": "x",
            "effects": [{"from": "*", "do": n, "to": "*"} for n in (*meta["behaviors"], *names)],
        },
    }
    path = rewrite(
        meta=np.frombuffer(json.dumps(meta).encode(), np.uint8),
        training_bins=np.zeros((36, 10, len(meta["behaviors"]), 36, 100), np.uint8),
    )
    with pytest.raises(DataError, match="fits in no memory"):
        load_percepts(path)


def test_a_file_beyond_all_tables_is_not_opened(tmp_path):
    path = tmp_path / "own.npz"
    path.write_bytes(b"PK")
    os.truncate(path, 1 << 40)
    with pytest.raises(DataError, match="not a whole percept table"):
        load_percepts(path)
